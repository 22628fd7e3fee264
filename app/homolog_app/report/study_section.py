"""The part of a report on one study: sample, results, where, assumptions, figures."""

from collections.abc import Iterator, Sequence
from math import floor, log10
from pathlib import Path

import numpy as np

from homolog.analysis.comparison import Comparison
from homolog.analysis.design import lookalikes
from homolog.analysis.effects import Effect
from homolog.files.results import Result
from homolog_app.report.figures import ReportFigure
from homolog_app.report.findings import (
    LEVEL,
    classified_text,
    corrections_text,
    p_text,
    size_variance_text,
)
from homolog_app.report.page import Page
from homolog_app.report.sample import VOXEL, SampleRow, sample_rows
from homolog_app.report.seeds import read_spread, spread_text
from homolog_app.report.study import SHAPE_SIZE, Study
from homolog_app.report.surface_maps import SurfaceCarrier, significant_regions

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
    checks = [
        _check_row(study, comparison) for comparison in study.comparisons if comparison.dispersion is not None
    ]
    if checks:
        page.heading("Assumptions", 3)
        page.paragraph(
            "Permutation tests assume that without an effect subjects are exchangeable between groups (with "
            "covariates: their residuals). Equal dispersion is tested by the permuted distance to the "
            "centroid (PERMDISP), skewness of size by D'Agostino's test. Outliers have r above median(r) + "
            "7.4 MAD(r): r is the distance from the mean over the group's median distance, MAD the median "
            "absolute deviation."
        )
        page.table(
            ["comparison", "dispersion (mm)", "F", "p", "skewness of size", "outliers"], checks, as_text=True
        )
    for figure in figures:
        if figure.heading:
            page.heading(figure.heading, 3)
        page.figures([figure])
    false_positives = [
        (
            comparison.title,
            test.test,
            f"{100 * test.rate:.1f}",
            f"{100 * test.low:.1f} – {100 * test.high:.1f}",
        )
        for comparison in study.comparisons
        for test in comparison.false_positives
    ]
    if false_positives:
        page.heading("Type I error rates on this cohort", 3)
        page.paragraph(
            f"The labels were permuted {study.request.null_repeats} times, so that there is nothing to "
            "find. Permutation tests then have a type I error rate of 5 % by construction: their rows check "
            "the software and do not validate the comparison. The bounds of about one row in twenty miss its "
            "true rate by chance. The rows of F show whether normal distributions may be "
            "assumed. The table can't show what differences in dispersion do; see Assumptions."
        )
        page.table(["comparison", "test", "type I error (%)", "95 % bounds"], false_positives, as_text=True)


def _results(page: Page, study: Study) -> None:
    """Add effects with their intervals and p-values: whole shape, particles, size and separation."""
    sentences = [
        "Effects come with 95 % confidence intervals, which are not corrected for pairs or analyses.",
        corrections_text(study),
    ]
    tested = list(_tested(study))
    if any(comparison is not None for _, comparison in tested if comparison not in study.comparisons):
        sentences.append("Where subjects lie far from the rest, all results are given without them, too.")
    page.paragraph(" ".join(sentences))
    page.table(
        [
            "whole shape", "modes", f"D (SD{_per(study)}, 95 % CI)", "p", "p, not corrected",
            "studentized statistic", "T² or Λ", "F (df)", "p (F)",
        ],
        (_whole_shape_row(study, *item) for item in tested),
    )  # fmt: skip
    page.paragraph(
        "df: degrees of freedom. D is the Mahalanobis distance of the means, corrected for bias. T² is "
        "Hotelling's, Λ is Wilks' lambda. p (F) assumes normal data and equal covariances and is not "
        "corrected."
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
        )  # fmt: skip
    if any(comparison.discriminant is not None for comparison in study.comparisons):
        page.paragraph(
            "Accuracy, AUC and the numbers of those classified correctly are cross-validated and means over "
            "the repeats."
        )


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
    digits = 3 if study.request.kind == "regression" else 2
    return (
        title,
        str(test.modes),
        _interval(comparison.distance, digits) if comparison.distance is not None else "–",
        _p(comparison.p_adjusted, test.permutations),
        _p(test.p_permutation, test.permutations),
        f"{test.studentized:.2f}",
        f"T² {test.t_squared:.1f}" if test.t_squared is not None else f"Λ {test.wilks:.3f}",
        f"{test.f:.2f} ({test.dof[0]:g}, {test.dof[1]:.4g})",
        _p(test.p),
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
        _p(float(comparison.p_fwe.min()), local.permutations),
        f"{np.count_nonzero(local.q <= LEVEL)} of {len(significant)}",
        _p(float(local.q.min())),
    )


def _separation_row(study: Study, title: str, comparison: Comparison) -> tuple[str, ...]:
    line, size, size_p = comparison.discriminant, comparison.size, comparison.size_p_adjusted
    digits = 3 if study.request.kind == "regression" else 2
    sizes = ["–", "–"]
    if size is not None and size_p is not None:
        between = comparison.size_variance
        effect = _interval(size, digits) if between is None else size_variance_text(between)
        sizes = [effect, _p(size_p, size.permutations)]
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


def _known(p: float | None, permutations: int) -> str:
    return "–" if p is None else _p(p, permutations)


def _where(page: Page, study: Study, carrier: SurfaceCarrier) -> None:
    """Add the regions where particles are significant."""
    rows = [
        (
            comparison.title,
            f"{number}",
            f"{len(region.particles)}",
            f"{region.area:.0f}",
            region.where,
            f"{_interval(region.outward)}, {region.direction(region.outward.value)}",
            f"{region.length:.2f}",
            f"{region.mean_outward:.2f}",
            _p(region.p, comparison.pointwise.permutations),
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
            f"mean outward (mm{_per(study)})", "p at the peak",
        ],
        rows,
        as_text=True,
    )  # fmt: skip
    page.paragraph(
        "The peak is the particle with the largest studentized statistic. Outward is along the normal of "
        "the mean surface, positive out of the tissue. The position was tested in all directions: the "
        "interval of its outward part alone may hold zero. Intervals are of the peak by itself, not "
        "corrected over the surface; since the peak was chosen by its statistic, its effect is "
        "overestimated."
    )


def _p(p: float, permutations: int | None = None) -> str:
    return p_text(p, permutations).removeprefix("p ").removeprefix("= ")


def _check_row(study: Study, comparison: Comparison) -> tuple[str, ...]:
    dispersion, skewness = comparison.dispersion, comparison.size_skewness
    assert dispersion is not None
    mean = (
        ", ".join(f"{name} {value:.2f}" for name, value in dispersion.by_group.items())
        or "along the variable"
    )
    return (
        comparison.title,
        mean,
        f"{dispersion.f:.2f}",
        _p(dispersion.p, dispersion.permutations),
        "–" if skewness is None else f"{skewness.value:.2f} ({p_text(skewness.p)})",
        ", ".join(study.names[index] for index in comparison.outliers) or "none",
    )


def _mean_text(mean: float, spread: float) -> str:
    """Return mean and standard deviation with the same decimals, three digits of the latter."""
    size = spread or abs(mean)
    decimals = max(0, 2 - floor(log10(size))) if size else 0
    return f"{mean:.{decimals}f} ± {spread:.{decimals}f}"


def _sample_text(count: int, of: int, category: str, mean: float | None, spread: float | None) -> str:
    if category:
        return f"{count} ({100.0 * count / max(of, 1):.0f} %)"
    if mean is None:
        return str(count)
    value = _mean_text(mean, spread) if spread is not None else f"{mean:.3g}"
    return value if count == of else f"{value} (of {count})"


def _sample_of(study: Study, result: Result) -> tuple[list[SampleRow], dict[str, str]]:
    return sorted(sample_rows(study, result), key=repr), dict(study.left_out)


def _sample(page: Page, study: Study, result: Result) -> None:
    page.heading("Sample", 3)
    rows = sample_rows(study, result)
    groups = list(dict.fromkeys(row[0] for row in rows))
    cells: dict[str, dict[str, str]] = {}
    sizes = {row[0]: row[3] for row in rows if row[1] == "subjects"}
    for group, variable, category, count, mean, spread in rows:
        unit = " (mm)" if variable in (SHAPE_SIZE, VOXEL) else ""
        title = f"{variable}{unit}{f': {category}' if category else ''}"
        cells.setdefault(title, {})[group] = _sample_text(count, sizes[group], category, mean, spread)
    page.table(
        ["", *groups], ([title, *(row.get(group, "–") for group in groups)] for title, row in cells.items())
    )
    page.paragraph("Mean ± standard deviation, or number of subjects (share of the group).")
    categories: dict[str, list[str]] = {}
    for _, variable, category, *_ in rows:
        categories.setdefault(variable, []).append(category)
    for variable, values in categories.items():
        for alike in lookalikes(values):
            page.caution(
                f"{variable} contains {' and '.join(map(repr, alike))}, counted as different values."
            )
    gone = [f"{name} ({why})" for name, why in study.left_out.items()]
    excluded = f"Not compared: {len(gone)} of {len(result.names)} subjects. {', '.join(gone)}"
    page.paragraph(excluded if gone else "All subjects were compared.")
    known = any(row[1] == VOXEL for row in rows)
    page.paragraph(
        "Not in the files, for the authors to add: where and when subjects were recruited, criteria of "
        f"inclusion and diagnosis, scanner and protocol{'' if known else ', voxel size'}, who segmented "
        "and how, ethics approval."
    )
