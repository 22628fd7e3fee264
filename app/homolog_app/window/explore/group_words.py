"""The test of two groups as rows of names and values."""

from typing import TYPE_CHECKING

import numpy as np

from homolog_app.rendering.text import short, signed
from homolog_app.report.findings import (
    LEVEL,
    correction_text,
    interval_text,
    p_text,
    percent_text,
    region_text,
)
from homolog_app.report.request import SIZE_WORDS, StudyRequest

if TYPE_CHECKING:
    from homolog_app.window.explore.group_answer import GroupAnswer

__all__ = ["effect_line", "number_rows", "question_text"]


def effect_line(answer: "GroupAnswer") -> str:
    """Return p of the whole shape and the size of the effect, as they stand below the headline."""
    pair, test = answer.pair, answer.pair.test
    if not test.modes:
        return "No mode has more variance than chance gives; nothing was tested."
    corrected = ", corrected" if correction_text(answer.study) else ""
    parts = [f"{p_text(pair.p_adjusted, test.permutations)}{corrected}"]
    if pair.distance is not None:
        slope = answer.values is not None
        name = "change per unit" if slope else "Mahalanobis D"
        parts.append(f"{name} {interval_text(pair.distance, 3 if slope else 2)} SD")
    return " · ".join(parts)


def question_text(request: StudyRequest) -> str:
    """Return alignment, covariates and who is left out, as they stand below the headline."""
    how = SIZE_WORDS[request.alignment]
    parts = [f"{how[0].upper()}{how[1:]}"]
    parts += [f"adjusted for {', '.join(request.covariates)}"] if request.covariates else []
    parts += ["subjects with missing values excluded"] if request.complete_cases else []
    return f"{', '.join(parts)}."


def number_rows(answers: "list[GroupAnswer]") -> list[tuple[str, ...]]:
    """Return what stands in the table: a name and a value for each answer."""
    columns = [dict(_rows(answer)) for answer in answers]
    names = list(dict.fromkeys(name for column in columns for name in column))
    return [(name, *(column.get(name, "–") for column in columns)) for name in names]


def _rows(answer: "GroupAnswer") -> list[tuple[str, str]]:
    from homolog.analysis.null_simulation import WHOLE_SHAPE_F

    pair, test, study = answer.pair, answer.pair.test, answer.study
    slope, kind = answer.values is not None, answer.study.request.kind
    counts = ", ".join(f"{count}{'' if slope else f' {name}'}" for name, count in pair.counts.items())
    rows = [("Subjects", counts)]
    if study.left_out and study.request.complete_cases:
        gone = sum(why.startswith("no value") for why in study.left_out.values())
        rows.append(("Left out", f"{gone} with missing values"))
    rows.append(("Modes retained (parallel analysis)", str(test.modes)))
    if pair.distance is not None and test.modes:
        text = interval_text(pair.distance, 3 if slope else 2)
        rows.append(("Change per unit" if slope else "Mahalanobis D", f"{text} SD"))
    if test.modes:
        how = (
            f"All {test.permutations + 1} permutations" if test.exact else f"{test.permutations} permutations"
        )
        rows.append((how, p_text(test.p_permutation, test.permutations)))
        if correction := correction_text(study):
            rows.append(("Corrected", f"{p_text(pair.p_adjusted, test.permutations)}, {correction}"))
    if test.t_squared is not None and test.modes:
        rows += [
            ("Hotelling's T²", f"{test.t_squared:.1f}"),
            (f"F({test.dof[0]:g}, {test.dof[1]:.4g})", f"{test.f:.2f}, {p_text(test.p)}"),
        ]
    if pair.dispersion is not None:
        mean = ", ".join(f"{name} {value:.2f} mm" for name, value in pair.dispersion.by_group.items())
        p = p_text(pair.dispersion.p, pair.dispersion.permutations)
        rows.append(("Dispersion", f"{mean}, {p}" if mean else p))
    rows.append((f"Significant area (FWE-corrected p ≤ {LEVEL:g})", region_text(study, pair)))
    if slope:
        most = float(np.linalg.norm(answer.difference.ways, axis=1).max())
        rows.append(("Change", f"up to {short(most)} mm from {answer.first} to {answer.second}"))
    if study.request.covariates:
        rows.append(("Adjusted for", ", ".join(study.request.covariates)))
    if pair.discriminant is not None:
        discriminant = pair.discriminant
        known = ((p, discriminant.auc.permutations) for p in (pair.accuracy_p_adjusted, pair.auc_p_adjusted))
        accuracy, auc = ("" if p is None else f", {p_text(p, count)}" for p, count in known)
        rows.append(("Balanced accuracy", f"{percent_text(discriminant.accuracy)}{accuracy}"))
        rows.append(("AUC", f"{interval_text(discriminant.auc)}{auc}"))
    if pair.size is not None and np.isfinite(pair.size.value) and pair.size_p_adjusted is not None:
        unit = f"mm per unit of {study.request.column}" if kind == "regression" else "mm"
        low, high = signed(pair.size.low), signed(pair.size.high)
        p = p_text(pair.size_p_adjusted, pair.size.permutations)
        rows.append(("Size", f"{signed(pair.size.value)} {unit} (95 % CI {low} to {high}), {p}"))
    for simulated in pair.false_positives[:1]:
        assert simulated.test == WHOLE_SHAPE_F
        bounds = f"{short(100 * simulated.low)}–{short(100 * simulated.high)}"
        rows.append(("Type I error (F test)", f"{100 * simulated.rate:.1f} % ({bounds})"))
    return rows
