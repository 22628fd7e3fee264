"""The test of two groups as rows of names and values."""

from typing import TYPE_CHECKING

import numpy as np

from homolog_app.report.findings import LEVEL, p_words
from homolog_app.window.explore.questions import SIZE
from homolog_app.window.quantities import short, signed

if TYPE_CHECKING:
    from homolog_app.window.explore.group_answer import GroupAnswer

__all__ = ["number_rows"]


def number_rows(answers: "list[GroupAnswer]") -> list[tuple[str, ...]]:
    """Return what stands in the table: a name and a value for each answer."""
    columns = [dict(_rows(one)) for one in answers]
    names = list(dict.fromkeys(name for column in columns for name in column))
    return [(name, *(column.get(name, "–") for column in columns)) for name in names]


def _rows(answer: "GroupAnswer") -> list[tuple[str, str]]:
    from homolog.analysis.null_simulation import WHOLE_SHAPE_F

    pair, test = answer.pair, answer.pair.test
    slope = answer.values is not None
    counts = ", ".join(f"{count}{'' if slope else f' {name}'}" for name, count in pair.counts.items())
    rows = [
        ("Subjects", counts),
        ("Modes above chance", str(test.modes)),
    ]
    if test.t_squared is not None and test.modes:
        rows += [
            ("Hotelling's T²", f"{test.t_squared:.1f}"),
            (f"F({test.dof[0]:g}, {test.dof[1]:.4g})", f"{test.f:.2f}, {p_words(test.p)}"),
        ]
    rows.append((f"{test.permutations} permutations", p_words(test.p_permutation)))
    if len(answer.study.pairwise) > 1:
        rows.append(
            ("Holm's correction", f"{p_words(pair.p_adjusted)} for {len(answer.study.pairwise)} pairs")
        )
    if test.mahalanobis is not None and test.modes and not slope:
        rows.append(("Effect", f"{test.mahalanobis:.1f} SD apart"))
    share = 100.0 * float((pair.local.p_family <= LEVEL).mean())
    rows.append((f"Local, corrected p ≤ {LEVEL:g}", f"{share:.0f} % of particles"))
    if slope:
        most = float(np.linalg.norm(answer.difference.ways, axis=1).max())
        rows.append(("Change", f"up to {short(most)} mm from {answer.first} to {answer.second}"))
    if answer.study.request.covariates:
        rows.append(("Allowed for", ", ".join(answer.study.request.covariates)))
    if pair.discriminant is not None:
        found = pair.discriminant
        rows.append(("Left-out subjects", f"{100 * found.accuracy:.0f} % right, AUC {found.auc:.2f}"))
    if SIZE not in answer.study.request.covariates and answer.study.request.column != SIZE:
        rows.append(_size_row(answer))
    for one in pair.false_alarms[:2]:
        bounds = f"{short(100 * one.low)}–{short(100 * one.high)}"
        kind = "F" if one.test == WHOLE_SHAPE_F else "permutations"
        rows.append((f"False alarms of {kind}", f"{100 * one.rate:.1f} % ({bounds})"))
    return rows


def _size_row(answer: "GroupAnswer") -> tuple[str, str]:
    """Return the difference in size, or what the whole range of a number changes."""
    pair, values = answer.pair, answer.values
    whole = 1.0 if values is None else float(np.ptp(values))
    return ("Size", f"{signed(whole * float(pair.size_effect[0]))} mm, {p_words(pair.size_p)}")
