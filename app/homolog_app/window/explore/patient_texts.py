"""What the Patient page says of its reference and its patient."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from homolog.patient import PatientComparison, Reference

__all__ = ["about_text", "nearest_text", "verdict_text"]


def verdict_text(comparison: "PatientComparison | None", reference: "Reference | None") -> str:
    """Say what was found; empty without a patient."""
    if comparison is None or reference is None:
        return ""
    from homolog_app.report.patient_words import detectable_text, verdict

    return f"{verdict(comparison, reference)}\n{detectable_text(reference)}"


def nearest_text(comparison: "PatientComparison | None", reference: "Reference | None") -> str:
    """Name the nearest controls; empty without a patient or if they are not kept."""
    if comparison is None or reference is None:
        return ""
    from homolog_app.report.patient_words import nearest_controls_text

    return nearest_controls_text(comparison, reference)


def about_text(reference: "Reference | None") -> str:
    """Describe the reference, or say how to get one."""
    if reference is None:
        return "No reference yet. Make one from this result or open a file."
    from homolog_app.report.patient_words import reference_text

    return "\n".join(reference_text(reference))
