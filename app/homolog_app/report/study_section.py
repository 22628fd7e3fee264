"""The section of a report on one study: results, regions, figures; and the description of samples."""

from collections.abc import Sequence

import numpy as np

from homolog.analysis.cautions import p_number
from homolog.analysis.comparison import Comparison
from homolog.analysis.design import lookalikes
from homolog.analysis.effects import Effect
from homolog.files.results import Result
from homolog_app.report.covariates import covariate_rows
from homolog_app.report.figures import ReportFigure
from homolog_app.report.findings import LEVEL, shown_variance, shows_size, size_variance_text
from homolog_app.report.page import Page
from homolog_app.report.request import SHAPE_SIZE
from homolog_app.report.sample import VOXEL, SampleRow, sample_rows
from homolog_app.report.study import Study
from homolog_app.report.study_parts import (
    add_regions,
    effect_cell,
    interval_cell,
    mean_text,
    tested_comparisons,
)
from homolog_app.report.surface_maps import SurfaceCarrier

__all__ = ["add_samples", "add_study"]


def add_study(
    page: Page, study: Study, number: int, carrier: SurfaceCarrier, figures: Sequence[ReportFigure]
) -> None:
    """Add a study by its number: tables of effects, separation and regions, and figures."""
    page.heading(f"Study {number}. {study.request.title}")
    page.study = f"Study\u00a0{number}"
    tested = list(tested_comparisons(study))
    page.table(
        [
            "comparison", "modes (variance)", f"D (SD{_per(study)}, 95 % CI)", "ω² (95 % CI)", "p of the "
            "whole shape",
            "significant particles", "area (mm²; %)", "smallest p of a particle",
        ],
        (_effect_row(study, *item) for item in tested),
        as_text=True,
        caption="Effects; all p corrected",
    )  # fmt: skip
    rows = [_further_row(study, *item) for item in tested]
    page.table(
        [
            "comparison", f"size (mm{_per(study)}, 95 % CI)", "standardized size (95 % CI)", "p of size",
            "balanced accuracy (%, 95 % CI)", "p of accuracy", "AUC (95 % CI)", "p of AUC",
        ],
        [row for row in rows if any(cell != "–" for cell in row[1:])],
        as_text=True,
        omit="–",
        caption=_further_caption(rows),
    )  # fmt: skip
    page.table(
        [
            "covariate", "modes", "D (SD, 95 % CI)", "p", f"significant particles (p ≤ {LEVEL:g})",
            "area (%)", "smallest p", "size (mm, 95 % CI)", "p of size",
        ],
        covariate_rows(study),
        as_text=True,
        omit="–",
        caption="Covariates, each adjusted for the groups and the others; p of size not corrected"
        if study.request.kind == "groups"
        else "Covariates, each adjusted for the variable and the others; p of size not corrected",
    )  # fmt: skip
    page.figures([figure for figure in figures if figure.small])
    add_regions(page, study, carrier)
    for figure in figures:
        if not figure.small:
            page.figures([figure])
    page.study = ""


def _further_caption(rows: Sequence[tuple[str, ...]]) -> str:
    """Return the title of a table of size, separation or both."""
    size, separation = (any(row[k] != "–" for row in rows) for k in (1, 4))
    if size and separation:
        return "Size, and separation by the linear discriminant"
    return "Separation by the linear discriminant" if separation else "Size"


def _per(study: Study) -> str:
    return f" per unit of {study.request.column}" if study.request.kind == "regression" else ""


def _effect_row(study: Study, title: str, comparison: Comparison) -> tuple[str, ...]:
    test, local = comparison.test, comparison.pointwise
    significant = comparison.p_fwe <= LEVEL
    area, whole = float(study.areas[significant].sum()), float(study.areas.sum())
    of_shape = ("0", "–", "–", "–")
    if test.modes:
        of_shape = (
            f"{test.modes} ({shown_variance(comparison):.0f} %)",
            "–" if comparison.distance is None else effect_cell(study, comparison.distance),
            "–" if comparison.explained is None else interval_cell(comparison.explained),
            p_number(comparison.p_adjusted, test.permutations),
        )
    return (
        title,
        *of_shape,
        f"{np.count_nonzero(significant)} of {len(significant)}",
        f"{area:.0f} ({100.0 * area / max(whole, 1e-300):.1f} %)",
        p_number(float(comparison.p_fwe.min()), local.permutations),
    )


def _further_row(study: Study, title: str, comparison: Comparison) -> tuple[str, ...]:
    """Return size, where it is tested and not told by the study of form, and separation."""
    size, p, line = comparison.size, comparison.size_p_adjusted, comparison.discriminant
    of_size, separation = ("–", "–", "–"), ("–", "–", "–", "–")
    if shows_size(study) and size is not None and p is not None:
        between, own = comparison.size_variance, comparison.size_standardized
        of_size = (
            effect_cell(study, size) if between is None else size_variance_text(between),
            "–" if own is None else effect_cell(study, own),
            p_number(p, size.permutations),
        )
    if line is not None:
        separation = (
            interval_cell(line.accuracy, 0, 100.0),
            _known(comparison.accuracy_p_adjusted, line.accuracy),
            interval_cell(line.auc),
            _known(comparison.auc_p_adjusted, line.auc),
        )
    return title, *of_size, *separation


def _known(p: float | None, effect: Effect) -> str:
    return "–" if p is None else p_number(p, effect.permutations)


def add_samples(page: Page, studies: Sequence[Study], result: Result) -> None:
    """Describe the sample of each study, the same one once."""
    numbers_of: dict[str, list[int]] = {}
    first: dict[str, Study] = {}
    for number, study in enumerate(studies, start=1):
        key = repr(_sample_of(study, result))
        numbers_of.setdefault(key, []).append(number)
        first.setdefault(key, study)
    for key, numbers in numbers_of.items():
        _sample(page, first[key], result, ", ".join(map(str, numbers)) if len(numbers_of) > 1 else "")


def _sample_text(row: SampleRow, of: int) -> str:
    if row.category:
        return f"{row.count} ({100.0 * row.count / max(of, 1):.0f} %)"
    if row.mean is None or row.least is None or row.largest is None:
        return str(row.count)
    value = f"{row.mean:.3g}"
    if row.spread is not None:
        value = f"{mean_text(row.mean, row.spread)} ({row.least:.4g} to {row.largest:.4g})"
    return value if row.count == of else f"{value}, of {row.count}"


def _sample_of(study: Study, result: Result) -> tuple[list[SampleRow], dict[str, str]]:
    return sorted(sample_rows(study, result), key=repr), dict(study.left_out)


def _sample(page: Page, study: Study, result: Result, of: str) -> None:
    rows = sample_rows(study, result)
    groups = list(dict.fromkeys(row.group for row in rows))
    cells: dict[str, dict[str, str]] = {}
    sizes = {row.group: row.count for row in rows if row.variable == "subjects"}
    for row in rows:
        unit = " (mm)" if row.variable in (SHAPE_SIZE, VOXEL) else ""
        title = f"{row.variable}{unit}{f': {row.category}' if row.category else ''}"
        cells.setdefault(title, {})[row.group] = _sample_text(row, sizes[row.group])
    page.table(
        ["", *groups],
        ([title, *(own.get(group, "–") for group in groups)] for title, own in cells.items()),
        caption=f"Subjects of Study {of}" if of else "Subjects",
    )
    page.paragraph(
        "Mean ± standard deviation (least to largest), or number of subjects (share of the group)."
    )
    categories: dict[str, list[str]] = {}
    for row in rows:
        categories.setdefault(row.variable, []).append(row.category)
    for variable, values in categories.items():
        for alike in lookalikes(values):
            page.caution(
                f"{variable} contains {' and '.join(map(repr, alike))}, counted as different values."
            )
    gone = [f"{name} ({why})" for name, why in study.left_out.items()]
    excluded = f"Not compared: {len(gone)} of {len(result.names)} subjects. {', '.join(gone)}"
    columns = [variable for variable in categories if variable not in ("subjects", SHAPE_SIZE, VOXEL)]
    untested = ""
    if columns and study.request.kind == "groups":
        untested = f" Whether groups differ in {', '.join(columns)} was not tested."
    page.paragraph(f"{excluded if gone else 'All subjects were compared.'}{untested}")
