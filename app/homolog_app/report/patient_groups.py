"""How typical a patient is of several groups, in rows and sentences."""

from collections.abc import Callable, Sequence

from homolog.errors import InputError, NumericalError
from homolog.patient import PatientComparison, Reference, Typicality, typicality

__all__ = ["GROUP_CAUTION", "GROUP_COLUMNS", "GroupRow", "group_rows", "group_sentence"]

GroupRow = tuple[str, int, float | None, float | None, float | None, int | None, int | None, str]
"""A line of ``groups.csv``."""

GROUP_COLUMNS = (
    "group", "controls", "p_modes", "p_outside", "p", "controls_within_modes", "controls_within_outside",
    "problem",
)  # fmt: skip

GROUP_CAUTION = (
    "Not a diagnosis: a shape can be typical of several groups or of none, and groups that were scanned or "
    "segmented otherwise differ for that. p is the probability that a member of the group is as far from its "
    "mean; members have 0.05 or less in 5 % of cases or fewer."
)
_LEVEL = 0.05


def group_rows(
    comparison: PatientComparison,
    reference: Reference,
    others: Sequence[Reference],
    compare: Callable[..., PatientComparison],
) -> list[GroupRow]:
    """Return how typical a patient is of a reference's group and of those of others; none without others.

    Parameters
    ----------
    comparison : PatientComparison
        With `reference`.
    reference : Reference
    others : sequence of Reference
    compare : callable
        Compares the patient with the reference that it is given as ``reference``.
    """
    if not others:
        return []
    rows = [_row(typicality(comparison, reference))]
    for other in others:
        about = other.provenance
        try:
            rows.append(_row(typicality(compare(reference=other), other)))
        except (InputError, NumericalError) as error:
            name = about.group or about.project
            rows.append((name, about.controls, None, None, None, None, None, str(error)))
    return rows


def group_sentence(row: GroupRow) -> str:
    """Say how typical a patient is of a group, and how well that is calibrated."""
    group, controls, modes, outside, p, held_modes, held_outside, problem = row
    if p is None:
        return f"{group}: can't be compared: {problem}"
    verdict = "within" if p > _LEVEL else "beyond"
    return (
        f"{group}: p = {p:.2g} (modes {modes:.2g}, outside of them {outside:.2g}), {verdict} what 95 % of "
        f"the group are. Left out one by one, {held_modes} and {held_outside} of {controls} controls are "
        "within."
    )


def _row(item: Typicality) -> GroupRow:
    return (
        item.group, item.controls, item.modes, item.outside, item.p, item.held_modes, item.held_outside, "",
    )  # fmt: skip
