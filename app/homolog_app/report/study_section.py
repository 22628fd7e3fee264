"""The section of a report on one study: sample, results, regions, assumptions, figures."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import floor, log10

import numpy as np

from homolog.analysis.cautions import p_number
from homolog.analysis.comparison import Comparison
from homolog.analysis.design import lookalikes
from homolog.analysis.effects import Effect
from homolog.files.results import Result
from homolog_app.report.covariates import covariate_rows
from homolog_app.report.figures import ReportFigure
from homolog_app.report.findings import (
    LEVEL,
    classified_text,
    corrections_text,
    shown_variance,
    shows_size,
    size_variance_text,
)
from homolog_app.report.page import Page
from homolog_app.report.request import SHAPE_SIZE
from homolog_app.report.sample import VOXEL, SampleRow, sample_rows
from homolog_app.report.seeds import SeedAnswer, add_seeds
from homolog_app.report.study import Study
from homolog_app.report.study_parts import (
    add_assumptions,
    add_false_positives,
    add_regions,
    effect_cell,
    interval_cell,
    scale_text,
)
from homolog_app.report.surface_maps import SurfaceCarrier

__all__ = ["add_study"]


def add_study(
    page: Page,
    study: Study,
    number: int,
    result: Result,
    carrier: SurfaceCarrier,
    figures: Sequence[ReportFigure],
    answers: Sequence[SeedAnswer],
    before: Sequence[Study] = (),
) -> None:
    """Add a study by its number, with its answers of other seeds, if there are any.

    The sample is not described again if one of the studies `before` has the same.
    """
    page.heading(f"Study {number}. {study.request.title}")
    page.study = f"Study\u00a0{number}"
    own = _sample_of(study, result)
    same = [index for index, item in enumerate(before, start=1) if _sample_of(item, result) == own]
    if same:
        page.paragraph(f"The sample is that of Study {same[0]}.")
    else:
        _sample(page, study, result)
    page.heading("Results", 3)
    _results(page, study)
    pictured = {
        figure.heading: page.following("Figure", after)
        for after, figure in enumerate(figures, start=1)
        if figure.shows_regions
    }
    _covariates(page, study)
    tables = add_regions(page, study, carrier, pictured)
    add_seeds(page, answers)
    add_assumptions(page, study)
    heading = ""
    for figure in figures:
        if figure.heading != heading:
            heading = figure.heading
            page.heading(heading, 3)
        caption = figure.caption.replace("those of the table", f"those of {tables.get(heading, 'the table')}")
        page.figures([replace(figure, caption=caption)])
    add_false_positives(page, study)
    page.study = ""


def _results(page: Page, study: Study) -> None:
    """Add effects with their intervals and p-values: whole shape, particles, size and separation."""
    sentences = [
        "Effects come with 95 % confidence intervals, which are not corrected for pairs or analyses.",
        corrections_text(study),
    ]
    tested = list(_tested(study))
    if any(comparison is not None for _, comparison in tested if comparison not in study.comparisons):
        sentences.append(
            "Where subjects lie far from the rest, whole shape, particles, size and classification are given "
            "without them, too."
        )
    page.paragraph(" ".join(sentences))
    page.table(
        [
            "comparison", "modes (variance)", f"D (SD{_per(study)}, 95 % CI)", "ω² (95 % CI)", "p, corrected",
            "p, not corrected",
        ],
        (_whole_shape_row(study, *item) for item in tested),
        caption="Effects on the whole shape",
    )  # fmt: skip
    several = _OF_SEVERAL * bool(study.pairwise)
    page.paragraph(
        f"{_DISTANCE[study.request.kind]}{several} ω² is the share of the generalised variance in these "
        f"modes that {_EXPLAINS[study.request.kind]}, estimated from Wilks' lambda and corrected for bias. "
        "Intervals of D and ω² come from the noncentral F distribution and assume equal covariances. Modes "
        "are those that the comparison was tested in, with their share of the variance of its subjects."
    )
    page.table(
        ["comparison", "studentized statistic", "T² or Λ", "F (df)", "p (F)"],
        (_statistics_row(*item) for item in tested if item[1].test.modes),
        caption="Test statistics of the whole shape",
    )
    page.paragraph(
        "The permutation p comes from the studentized statistic: "
        f"{_STATISTIC[study.request.kind == 'groups' and not study.request.covariates]}. T² is Hotelling's, "
        "Λ is Wilks' lambda, df are degrees of freedom. p (F) assumes normal data and equal covariances and "
        "is not corrected. The effects that belong to these statistics are D and ω²; statistics of different "
        "numbers of modes can't be compared."
    )
    page.table(
        [
            "comparison", f"significant particles (p ≤ {LEVEL:g})", "area (mm²)", "area (%)",
            "smallest p, corrected", f"q ≤ {LEVEL:g}", "smallest q",
        ],
        (_particles_row(study, *item) for item in tested),
        caption="Tests of particles",
    )  # fmt: skip
    page.paragraph(
        "Areas are of the whole surface, of hollow shapes its inner and outer side together. p of particles "
        "is corrected over the surface (family-wise error), pairs and analyses; it is the one to report, and "
        "maps and regions use it. q is the false discovery rate over the surface (Benjamini and Hochberg), "
        "not corrected for pairs or analyses. It only describes how widespread an effect is: of the "
        "particles with q ≤ 0.05 one in twenty is expected to be false. Since q is computed from the "
        "permutation p of single particles, few permutations can make it larger than the corrected p."
        + scale_text(study)
    )
    _size_and_separation(page, study, tested)


def _covariates(page: Page, study: Study) -> None:
    """Add a table of the effects of a study's covariates, if it has any."""
    rows = covariate_rows(study)
    if not rows:
        return
    page.heading("Covariates", 3)
    page.paragraph(
        "Each covariate was tested like the study's own effect, adjusted for that and for the other "
        "covariates, in the modes that its own residuals retained. Effects of numbers are per unit; D is the "
        "length of the change in standard deviations of what the model leaves unexplained, of three and more "
        "categories the root mean square distance of their means from the common mean. p values are "
        "corrected for analyses and, of particles, for the surface, not for the number of covariates."
    )
    page.table(
        [
            "covariate", "modes", "D (SD, 95 % CI)", "p", f"significant particles (p ≤ {LEVEL:g})",
            "area (%)", "smallest p", "size (mm, 95 % CI)", "p of size",
        ],
        rows,
        as_text=True,
        omit="–",
        caption="Effects of the covariates",
    )  # fmt: skip


def _size_and_separation(page: Page, study: Study, tested: Sequence[tuple[str, Comparison]]) -> None:
    """Add the tests of size, unless the study of form has them, and how well groups can be told apart."""
    if not shows_size(study):
        page.paragraph("Size by itself is the same as in the study of form, and is given there.")
    elif rows := [row for item in tested if (row := _size_row(study, *item))]:
        page.table(
            [
                "comparison",
                f"size (mm{_per(study)}, 95 % CI)",
                "standardized size (95 % CI)",
                _SIZE_P[bool(study.pairwise)],
            ],
            rows,
            omit="–",
            caption="Tests of size",
        )
        page.paragraph(_STANDARDIZED[study.request.kind])
    if rows := [_separation_row(*item) for item in tested if item[1].discriminant is not None]:
        page.table(
            [
                "comparison", "balanced accuracy (%, 95 % CI)", "p of accuracy", "classified correctly",
                "AUC (95 % CI)", "p of AUC",
            ],
            rows,
            as_text=True,
            omit="–",
            caption="Separation by the linear discriminant",
        )  # fmt: skip
        page.paragraph(
            "Accuracy, AUC and the numbers of those classified correctly are cross-validated and means over "
            "the repeats. Accuracy counts subjects on the right side of a threshold and AUC ranks all "
            "scores, so that their p values can differ: report both, or the one that was chosen beforehand. "
            "An interval is that of the estimate, treats left-out subjects as independent and is not "
            "corrected; p comes from permutations of the labels and is corrected. Where an interval includes "
            "50 % or 0.5 although p ≤ 0.05, or excludes it although p is larger, p is the test."
        )


_DISTANCE = {
    "groups": "D is the Mahalanobis distance of the group means in the retained modes, in standard "
    "deviations within groups (pooled covariance), corrected for bias.",
    "regression": "D is the length of the change per unit of the variable in the retained modes, in standard "
    "deviations of what the model leaves unexplained, corrected for bias.",
    "pairs": "D is the length of the mean difference of the pairs in the retained modes, in standard "
    "deviations of the differences, corrected for bias.",
}
_EXPLAINS = {
    "groups": "lies between the groups",
    "regression": "the variable explains",
    "pairs": "the mean difference explains",
}
_OF_SEVERAL = (
    " Of all groups together it is the root mean square distance of their means from the common mean, each "
    "weighted by its number of subjects."
)
_SIZE_P = {True: "p (of pairs corrected)", False: "p"}
_STANDARDIZED = {
    "groups": "Standardized size is Hedges' g: the difference in standard deviations within groups (pooled), "
    "corrected for bias; its interval comes from the noncentral t distribution and assumes equal variances.",
    "pairs": "Standardized size is the mean difference in standard deviations of the differences, corrected "
    "for "
    "bias; its interval comes from the noncentral t distribution.",
    "regression": "Standardized size is the change per unit in standard deviations of what the model leaves "
    "unexplained, corrected for bias; its interval comes from the noncentral t distribution.",
}
_STATISTIC = {
    True: "Welch's F with squared distances in all modes in the place of squared differences, divided by "
    "their "
    "number",
    False: "the tested sum of squares in the modes divided by its expectation without an effect",
}
"""By whether groups are compared without covariates."""


def _tested(study: Study) -> Iterator[tuple[str, Comparison]]:
    """Yield each comparison with its title, followed by the same without its outliers."""
    for comparison in study.comparisons:
        yield comparison.title, comparison
        if comparison.without_outliers is not None:
            names = ", ".join(study.names[index] for index in comparison.outliers)
            yield f"{comparison.title}, without {names}", comparison.without_outliers


def _per(study: Study) -> str:
    return f" per unit of {study.request.column}" if study.request.kind == "regression" else ""


def _whole_shape_row(study: Study, title: str, comparison: Comparison) -> tuple[str, ...]:
    test = comparison.test
    if not test.modes:
        return (title, "0", *["–"] * 4)
    return (
        title,
        f"{test.modes} ({shown_variance(comparison):.0f} %)",
        effect_cell(study, comparison.distance) if comparison.distance is not None else "–",
        interval_cell(comparison.explained) if comparison.explained is not None else "–",
        p_number(comparison.p_adjusted, test.permutations),
        p_number(test.p_permutation, test.permutations),
    )


def _statistics_row(title: str, comparison: Comparison) -> tuple[str, ...]:
    test = comparison.test
    return (
        title,
        f"{test.studentized:.2f}",
        f"T² {test.t_squared:.1f}" if test.t_squared is not None else f"Λ {test.wilks:.3f}",
        f"{test.f:.2f} ({test.dof[0]:g}, {test.dof[1]:.4g})",
        p_number(test.p),
    )


def _particles_row(study: Study, title: str, comparison: Comparison) -> tuple[str, ...]:
    local = comparison.pointwise
    significant = comparison.p_fwe <= LEVEL
    area, whole = float(study.areas[significant].sum()), float(study.areas.sum())
    return (
        title,
        f"{np.count_nonzero(significant)} of {len(significant)}",
        f"{area:.0f}",
        f"{100.0 * area / max(whole, 1e-300):.1f}",
        p_number(float(comparison.p_fwe.min()), local.permutations),
        f"{np.count_nonzero(local.q <= LEVEL)} of {len(significant)}",
        p_number(float(local.q.min())),
    )


def _size_row(study: Study, title: str, comparison: Comparison) -> tuple[str, ...]:
    """Return a row on size; empty where it is tested or adjusted for itself."""
    size, p = comparison.size, comparison.size_p_adjusted
    if size is None or p is None:
        return ()
    between, own = comparison.size_variance, comparison.size_standardized
    effect = effect_cell(study, size) if between is None else size_variance_text(between)
    relative = "–" if own is None else effect_cell(study, own)
    return title, effect, relative, p_number(p, size.permutations)


def _separation_row(title: str, comparison: Comparison) -> tuple[str, ...]:
    line = comparison.discriminant
    assert line is not None
    return (
        title,
        interval_cell(line.accuracy, 0, 100.0),
        _known(comparison.accuracy_p_adjusted, line.accuracy),
        classified_text(comparison),
        interval_cell(line.auc),
        _known(comparison.auc_p_adjusted, line.auc),
    )


def _known(p: float | None, effect: Effect) -> str:
    return "–" if p is None else p_number(p, effect.permutations)


def _mean_text(mean: float, spread: float) -> str:
    """Return mean and standard deviation with the same decimals, three digits of the latter."""
    size = spread or abs(mean)
    decimals = max(0, 2 - floor(log10(size))) if size else 0
    return f"{mean:.{decimals}f} ± {spread:.{decimals}f}"


def _sample_text(row: SampleRow, of: int) -> str:
    if row.category:
        return f"{row.count} ({100.0 * row.count / max(of, 1):.0f} %)"
    if row.mean is None or row.least is None or row.largest is None:
        return str(row.count)
    value = f"{row.mean:.3g}"
    if row.spread is not None:
        value = f"{_mean_text(row.mean, row.spread)} ({row.least:.4g} to {row.largest:.4g})"
    return value if row.count == of else f"{value}, of {row.count}"


def _sample_of(study: Study, result: Result) -> tuple[list[SampleRow], dict[str, str]]:
    return sorted(sample_rows(study, result), key=repr), dict(study.left_out)


def _sample(page: Page, study: Study, result: Result) -> None:
    page.heading("Sample", 3)
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
        caption="Subjects of the study",
    )
    page.paragraph(
        "Mean ± standard deviation (least to largest), or number of subjects (share of the group). "
        f"{SHAPE_SIZE} is the root mean square distance of a shape's particles from their centroid."
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
    page.paragraph(excluded if gone else "All subjects were compared.")
    columns = [variable for variable in categories if variable not in ("subjects", SHAPE_SIZE, VOXEL)]
    if columns and study.request.kind == "groups":
        page.paragraph(f"Whether groups differ in {', '.join(columns)} was not tested.")
