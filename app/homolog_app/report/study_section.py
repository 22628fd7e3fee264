"""The part of a report on one study: sample, results, where, assumptions, figures."""

from collections.abc import Iterator, Sequence
from math import floor, log10
from pathlib import Path

import numpy as np

from homolog.analysis.cautions import p_number
from homolog.analysis.comparison import Comparison
from homolog.analysis.design import lookalikes
from homolog.analysis.effects import Effect
from homolog.files.results import Result
from homolog_app.report.assumptions_section import add_assumptions, add_false_positives
from homolog_app.report.figures import ReportFigure
from homolog_app.report.findings import (
    LEVEL,
    classified_text,
    corrections_text,
    size_variance_text,
)
from homolog_app.report.page import Page
from homolog_app.report.request import SHAPE_SIZE
from homolog_app.report.sample import VOXEL, SampleRow, sample_rows
from homolog_app.report.seeds import read_spread, spread_text
from homolog_app.report.study import Study
from homolog_app.report.surface_maps import Region, SurfaceCarrier, significant_regions

__all__ = ["add_study"]


def add_study(
    page: Page,
    study: Study,
    result: Result,
    carrier: SurfaceCarrier,
    figures: Sequence[ReportFigure],
    kept: tuple[Path, str],
    before: Sequence[Study] = (),
) -> None:
    """Add a study; `kept` is the folder of its tables and the fingerprint of the result.

    The sample is not described again if one of the studies `before` has the same.
    """
    page.heading(f"Study: {study.request.title}")
    same = [item.request.title for item in before if _sample_of(item, result) == _sample_of(study, result)]
    if same:
        page.paragraph(f"The sample is that of the study \u201c{same[0]}\u201d.")
    else:
        _sample(page, study, result)
    page.heading("Results", 3)
    _results(page, study)
    _where(page, study, carrier)
    spread = spread_text(read_spread(*kept))
    page.paragraph(
        "The seed of the correspondence is part of the uncertainty. "
        + (" ".join(spread) or "Its share was not computed; homolog analyze --seeds 5 computes it.")
    )
    add_assumptions(page, study)
    for figure in figures:
        if figure.heading:
            page.heading(figure.heading, 3)
        page.figures([figure])
    add_false_positives(page, study)


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
            "whole shape", "modes", f"D (SD{_per(study)}, 95 % CI)", "p", "p, not corrected",
            "studentized statistic", "T² or Λ", "F (df)", "p (F)",
        ],
        (_whole_shape_row(study, *item) for item in tested),
    )  # fmt: skip
    page.paragraph(
        f"{_DISTANCE[study.request.kind]} The studentized statistic, by which p was found, is "
        f"{_STATISTIC[study.request.kind == 'groups' and not study.request.covariates]}. T² is Hotelling's, "
        "Λ is Wilks' lambda. df: degrees of freedom. p (F) assumes normal data and equal covariances and is "
        "not corrected."
    )
    page.table(
        [
            "particles", f"significant (p ≤ {LEVEL:g})", "area (mm²)", "area (%)", "smallest p",
            f"q ≤ {LEVEL:g}", "smallest q",
        ],
        (_particles_row(study, *item) for item in tested),
    )  # fmt: skip
    page.paragraph(
        "p of particles is corrected over the surface (family-wise error). q is the false discovery rate "
        "over the surface (Benjamini and Hochberg), not corrected for pairs or analyses."
    )
    rows = [_separation_row(study, *item) for item in tested]
    if any(cell != "–" for row in rows for cell in row[1:]):
        page.table(
            [
                "size and separation", f"size (mm{_per(study)}, 95 % CI)", "p",
                "balanced accuracy (%, 95 % CI)", "p", "classified correctly", "AUC (95 % CI)", "p",
            ],
            rows,
            as_text=True,
            omit="–",
        )  # fmt: skip
    if any(comparison.discriminant is not None for comparison in study.comparisons):
        page.paragraph(
            "Accuracy, AUC and the numbers of those classified correctly are cross-validated and means over "
            "the repeats."
        )


_DISTANCE = {
    "groups": "D is the Mahalanobis distance of the group means in the retained modes, in standard "
    "deviations within groups (pooled covariance), corrected for bias.",
    "regression": "D is the length of the change per unit of the variable in the retained modes, in standard "
    "deviations of what the model leaves unexplained, corrected for bias.",
    "pairs": "D is the length of the mean difference of the pairs in the retained modes, in standard "
    "deviations of the differences, corrected for bias.",
}
_STATISTIC = {
    True: "Welch's F, summed over the modes",
    False: "the tested sum of squares in the modes divided by its expectation without an effect",
}
"""By whether groups are compared without covariates."""


def _tested(study: Study) -> Iterator[tuple[str, Comparison]]:
    """Yield each comparison with its title, and after it the same without its outliers."""
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
        return (title, "0", *["–"] * 7)
    return (
        title,
        str(test.modes),
        _effect(study, comparison.distance) if comparison.distance is not None else "–",
        p_number(comparison.p_adjusted, test.permutations),
        p_number(test.p_permutation, test.permutations),
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


def _separation_row(study: Study, title: str, comparison: Comparison) -> tuple[str, ...]:
    line, size, size_p = comparison.discriminant, comparison.size, comparison.size_p_adjusted
    sizes = ["–", "–"]
    if size is not None and size_p is not None:
        between = comparison.size_variance
        effect = _effect(study, size) if between is None else size_variance_text(between)
        sizes = [effect, p_number(size_p, size.permutations)]
    if line is None:
        return (title, *sizes, *["–"] * 5)
    return (
        title,
        *sizes,
        _interval(line.accuracy, 0, 100.0),
        _known(comparison.accuracy_p_adjusted, line.accuracy.permutations),
        classified_text(comparison),
        _interval(line.auc),
        _known(comparison.auc_p_adjusted, line.auc.permutations),
    )


def _interval(effect: Effect, digits: int = 2, scale: float = 1.0) -> str:
    """Return an estimate with its interval as tables have it, such as ``"1.27 (0.41 to 2.02)"``."""
    value, low, high = (f"{scale * item:.{digits}f}" for item in (effect.value, effect.low, effect.high))
    return f"{value} ({low} to {high})"


def _effect(study: Study, effect: Effect) -> str:
    """Return an effect with its interval; changes per unit have three digits of the interval's width."""
    return _interval(effect, _digits(study, effect.high - effect.low))


def _digits(study: Study, width: float) -> int:
    if study.request.kind != "regression" or not width > 0.0:
        return 2
    return max(2, 2 - floor(log10(width)))


def _known(p: float | None, permutations: int) -> str:
    return "–" if p is None else p_number(p, permutations)


def _where(page: Page, study: Study, carrier: SurfaceCarrier) -> None:
    """Add the regions where particles are significant."""
    rows = [
        (
            comparison.title,
            f"{number}",
            f"{len(region.particles)}",
            f"{region.area:.0f}",
            region.where,
            f"{_effect(study, region.outward)}, {region.direction(region.outward.value)}",
            f"{region.length:.{_digits(study, region.outward.high - region.outward.low)}f}",
            _outward(study, region),
            p_number(region.p, comparison.pointwise.permutations),
        )
        for comparison in study.comparisons
        for number, region in enumerate(significant_regions(study, comparison, carrier), start=1)
    ]
    if not rows:
        return
    page.heading("Where", 3)
    hollow = any("surface" in row[4] for row in rows)
    page.paragraph(
        f"Connected regions of particles with p ≤ {LEVEL:g}, corrected over the surface, pairs and "
        "analyses; the pictures below show them by number. Places are directions from the middle of the "
        "mean shape along the axes of the input files: left is towards the patient's left (file axis +L), "
        "anterior towards the front (+A), superior towards the head (+S). They hold if the files' axes are "
        "those of the patient. Give the parts their anatomical names from the pictures."
        + (
            " The shape is hollow: a region is on its inner surface, which mostly faces itself across the "
            "cavity, or on its outer surface."
            if hollow
            else ""
        )
    )
    page.table(
        [
            "comparison", "region", "particles", "area (mm²)", "place of the peak",
            f"outward at the peak (mm{_per(study)}, 95 % CI)", f"displacement of the peak (mm{_per(study)})",
            f"outward: mean (least to largest) (mm{_per(study)})", "p at the peak",
        ],
        rows,
        as_text=True,
    )  # fmt: skip
    page.paragraph(
        "The peak is the particle with the largest studentized statistic. Outward is along the normal of "
        "the mean surface, positive out of the tissue; its mean over a region's area is given with the least "
        "and the largest of its particles, as parts of a region may move in opposite directions. The "
        "position was tested in all directions: the interval of its outward part alone may hold zero. "
        "Intervals are of the peak by itself, not corrected over the surface; since the peak was chosen by "
        "its statistic, its effect is overestimated."
    )


def _outward(study: Study, region: Region) -> str:
    digits = _digits(study, region.outward.high - region.outward.low)
    low, high = (f"{value:.{digits}f}" for value in region.outward_range)
    mean = f"{region.mean_outward:.{digits}f}"
    return mean if len(region.particles) == 1 else f"{mean} ({low} to {high})"


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
        ["", *groups], ([title, *(own.get(group, "–") for group in groups)] for title, own in cells.items())
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
    known = any(row.variable == VOXEL for row in rows)
    page.paragraph(
        "Not in the files, for the authors to add: where and when subjects were recruited, criteria of "
        f"inclusion and diagnosis, scanner and protocol{'' if known else ', voxel size'}, who segmented "
        "and how, units of columns whose names don't tell them, ethics approval."
    )
