"""The part of a report on one study: sample, results, where, assumptions, figures."""

from collections.abc import Sequence
from math import floor, isfinite, log10
from pathlib import Path

from homolog.analysis.comparison import Comparison
from homolog.files.results import Result
from homolog_app.report.figures import ReportFigure
from homolog_app.report.findings import (
    LEVEL,
    correction_text,
    interval_text,
    p_text,
    percent_text,
    region_text,
)
from homolog_app.report.page import Page
from homolog_app.report.seeds import read_spread, spread_text
from homolog_app.report.study import SHAPE_SIZE, Study
from homolog_app.report.surface_maps import SurfaceCarrier, significant_regions
from homolog_app.report.tables import sample_rows

__all__ = ["add_study"]


def add_study(
    page: Page,
    study: Study,
    result: Result,
    carrier: SurfaceCarrier,
    figures: Sequence[ReportFigure],
    kept: tuple[Path, str],
) -> None:
    """Add a study; `kept` is the folder of its tables and the fingerprint of the result."""
    page.heading(f"Study: {study.request.title}")
    _sample(page, study, result)
    page.heading("Results", 3)
    correction = correction_text(study)
    page.paragraph(
        "Effects come with 95 % confidence intervals, which are not corrected for pairs or answers. "
        + (
            f"P-values of the whole shape, of particles and of the discriminant are {correction}; "
            "those of size are " + (f"{correction_text(study, size=True)}. " if study.pairwise else "not. ")
            if correction
            else "P-values are not corrected for other questions. "
        )
        + "p (F) assumes normal data and equal covariances and is not corrected."
    )
    page.table(_COLUMNS, (_row(study, comparison) for comparison in study.comparisons))
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
            "the software and do not validate the comparison. The rows of F show whether "
            "normal distributions may be assumed. The table can't show what differences in dispersion do; "
            "see Assumptions."
        )
        page.table(["comparison", "test", "type I error (%)", "95 % bounds"], false_positives, as_text=True)


def _where(page: Page, study: Study, carrier: SurfaceCarrier) -> None:
    """Add the regions where particles are significant."""
    per = f" per unit of {study.request.column}" if study.request.kind == "regression" else ""
    rows = [
        (
            comparison.title,
            f"{len(region.particles)}",
            f"{region.area:.0f}",
            region.place,
            f"{interval_text(region.outward)}, {region.direction}",
            f"{region.length:.2f}",
            f"{region.mean_outward:.2f}",
            _p(region.p, comparison.pointwise.permutations),
        )
        for comparison in study.comparisons
        for region in significant_regions(study, comparison, carrier)
    ]
    if not rows:
        return
    page.heading("Where", 3)
    page.paragraph(
        f"Connected regions of particles with family-wise p ≤ {LEVEL:g}, corrected. The peak is the "
        "particle with the largest studentized statistic. Outward is along the normal of the mean surface, "
        "positive out of the tissue. The position was tested in all directions: the interval of its outward "
        "part alone may hold zero. Intervals are of the peak by itself, not corrected over the surface; "
        "since the peak was chosen by its statistic, its effect is overestimated. Places follow the axes "
        "of the input files, from the middle of the mean shape: they are anatomical only if those are. On an "
        "inner surface (its normal points to the middle) into the tissue means a wider cavity."
    )
    page.table(
        [
            "comparison", "particles", "area (mm²)", "place of the peak",
            f"outward at the peak (mm{per}, 95 % CI)", f"displacement of the peak (mm{per})",
            f"mean outward (mm{per})", "corrected p at the peak",
        ],
        rows,
        as_text=True,
    )  # fmt: skip


_COLUMNS = (
    "comparison", "modes", "D, corrected for bias (95 % CI)", "studentized statistic", "p (permutation)",
    "p (corrected)",
    "T² or lambda", "F (degrees of freedom)", "p (F)", f"particles p ≤ {LEVEL:g}, corrected",
    "balanced accuracy (95 % CI)", "AUC (95 % CI)", "size (95 % CI)", "size p",
)  # fmt: skip


def _row(study: Study, comparison: Comparison) -> tuple[str, ...]:
    test, line, size = comparison.test, comparison.discriminant, comparison.size
    unit = f"mm per unit of {study.request.column}" if study.request.kind == "regression" else "mm"
    digits = 3 if study.request.kind == "regression" else 2
    return (
        comparison.title,
        str(test.modes),
        interval_text(comparison.distance, digits) if comparison.distance is not None else "–",
        f"{test.studentized:.2f}" if test.modes else "–",
        _p(test.p_permutation, test.permutations),
        _p(comparison.p_adjusted, test.permutations),
        f"T² {test.t_squared:.1f}" if test.t_squared is not None else f"Λ {test.wilks:.3f}",
        f"{test.f:.2f} ({test.dof[0]:g}, {test.dof[1]:.4g})" if test.modes else "–",
        _p(test.p),
        region_text(study, comparison),
        percent_text(line.accuracy) if line is not None else "–",
        interval_text(line.auc) if line is not None else "–",
        f"{interval_text(size)} {unit}" if size is not None and isfinite(size.value) else "–",
        _p(comparison.size_p_adjusted, size.permutations)
        if size is not None and comparison.size_p_adjusted is not None
        else "–",
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


def _sample(page: Page, study: Study, result: Result) -> None:
    page.heading("Sample", 3)
    page.table(
        ["group", "variable", "n", "mean ± SD"],
        (
            (
                group,
                f"{variable} {category}".strip() + (" (mm)" if variable == SHAPE_SIZE else ""),
                str(count),
                "–" if mean is None or spread is None else _mean_text(mean, spread),
            )
            for group, variable, category, count, mean, spread in sample_rows(study, result)
        ),
        as_text=True,
    )
    gone = [f"{name} ({why})" for name, why in study.left_out.items()]
    excluded = f"Not compared: {len(gone)} of {len(result.names)} subjects. {', '.join(gone)}"
    page.paragraph(excluded if gone else "All subjects were compared.")
