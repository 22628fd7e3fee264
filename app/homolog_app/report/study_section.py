"""The section of a report on one study: effects, regions, figures; and the assumptions of all tests."""

from collections.abc import Iterator, Sequence
from math import floor, isfinite, log10

import numpy as np

from homolog.comparison.answer import Answer
from homolog.comparison.findings import (
    LEVEL,
    covariate_area,
    covariate_interval,
    covariate_size,
    covariate_unit,
    p_text,
    shown_variance,
    shows_size,
    size_variance_text,
)
from homolog.comparison.places import EDGE, INNER, OUTER, Region, SurfaceCarrier, significant_regions
from homolog.statistics.assumptions import Dispersion
from homolog.statistics.cautions import p_number
from homolog.statistics.comparison import Comparison
from homolog.statistics.effects import Effect
from homolog_app.report.figures import ReportFigure
from homolog_app.report.page import Page

__all__ = [
    "add_assumptions", "add_regions", "add_statistics", "add_study", "axes_text", "decimals_of",
    "digits_of", "effect_cell", "interval_cell", "mean_text", "tested_comparisons",
]  # fmt: skip


def add_study(
    page: Page, study: Answer, title: str, seed: int | None, carrier: SurfaceCarrier,
    figures: Sequence[ReportFigure],
) -> None:  # fmt: skip
    """Add a study, titled such as "Study 1, primary": tables of effects, separation and regions, figures.

    The seed is that of the correspondence, None if it is from another program.
    """
    page.heading(f"{title}. {study.question.title}")
    page.study = title.replace(" ", "\u00a0", 1) + ("" if seed is None else f", seed\u00a0{seed}")
    tested = list(tested_comparisons(study))
    page.table(
        [
            "comparison", "modes (variance)", f"D (SD{_per(study)}, 90 % CI)", "ω² (90 % CI)", "p of the "
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
            "covariate", "modes", "D (SD, 90 % CI)", "p", f"significant particles (p ≤ {LEVEL:g})",
            "area (%)", "smallest p", "size (mm, 95 % CI)", "p of size",
        ],
        _covariate_rows(study),
        as_text=True,
        omit="–",
        caption="Covariates, each adjusted for the groups and the others; p of size not corrected"
        if study.question.kind == "groups"
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


def _per(study: Answer) -> str:
    return f" per unit of {study.question.column}" if study.question.kind == "regression" else ""


def _effect_row(study: Answer, title: str, comparison: Comparison) -> tuple[str, ...]:
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


def _further_row(study: Answer, title: str, comparison: Comparison) -> tuple[str, ...]:
    """Return a row with size, unless it is in the study of form, and separation."""
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


def _covariate_rows(study: Answer) -> list[tuple[str, ...]]:
    """Return a row for each covariate: title, modes, D, p, particles, area, smallest p, size, p of size."""
    return [_covariate_row(study, effect) for effect in study.overall.covariates]


def _covariate_row(study: Answer, effect: Comparison) -> tuple[str, ...]:
    test, size = effect.test, covariate_size(effect)
    unit = covariate_unit(effect)
    measured = size is not None and np.isfinite(size.value)
    return (
        f"{effect.title}{unit}",
        str(test.modes),
        covariate_interval(effect.distance, "") if effect.distance is not None and test.modes else "–",
        p_number(effect.p_adjusted, test.permutations) if test.modes else "–",
        f"{np.count_nonzero(effect.p_fwe <= LEVEL)} of {len(effect.p_fwe)}",
        f"{covariate_area(study, effect):.1f}",
        p_number(float(effect.p_fwe.min()), effect.pointwise.permutations),
        covariate_interval(size, "") if size is not None and measured else "–",
        p_number(size.p, size.permutations) if size is not None and size.p is not None else "–",
    )


_MOST_REGIONS = 3
"""Maximum number of regions of a comparison in the table."""


def tested_comparisons(study: Answer) -> Iterator[tuple[str, Comparison]]:
    """Yield each comparison with its title, followed by the comparison without outliers."""
    for comparison in study.comparisons:
        yield comparison.title, comparison
        if comparison.without_outliers is not None:
            names = ", ".join(study.names[index] for index in comparison.outliers)
            yield f"{comparison.title}, without {names}", comparison.without_outliers


def add_regions(page: Page, study: Answer, carrier: SurfaceCarrier) -> None:
    """Add a table of the largest significant regions, and one of walls."""
    rows = []
    for comparison in study.comparisons:
        regions = significant_regions(study, comparison, carrier)
        rows += [
            _region_row(study, comparison, region, f"{number} of {len(regions)}")
            for number, region in enumerate(regions[:_MOST_REGIONS], start=1)
        ]
    if not rows:
        return
    per = f" per unit of {study.question.column}" if study.question.kind == "regression" else ""
    page.table(
        [
            "comparison", "region", "area (mm²)", "place of the peak", f"outward, mean (mm{per}, "
            "95 % CI)",
            f"peak moves by (mm{per})", "p at the "
            "peak",
        ],
        rows,
        as_text=True,
        caption=f"Largest regions, at most {_MOST_REGIONS} of a comparison (all: regions.csv)",
    )  # fmt: skip
    if carrier.is_hollow:
        _add_walls(page, study, carrier)


def axes_text(carrier: SurfaceCarrier, *, confirmed: bool) -> str:
    """Return the naming of locations, and whether the authors have confirmed the axes."""
    if carrier.directions.are_the_patients:
        unsure = (
            ""
            if confirmed
            else " Headers can be wrong after resampling or export, and nobody has confirmed these (--axes "
            "patient): compare the figures with the anatomy before a location is published."
        )
        return (
            "Locations are directions from the middle of the mean shape along the patient's axes, as the "
            "files state them: left is towards the patient's left, anterior towards the front, superior "
            f"towards the head.{unsure}"
        )
    if carrier.directions.are_named:
        sides = zip(carrier.directions.sides, "xyz", strict=True)
        named = ", ".join(f"{low} and {high} of smaller and larger {axis}" for (low, high), axis in sides)
        return (
            f"Locations are sides of the mean shape, seen from its middle, as named by the authors: {named}."
        )
    return (
        "Places are directions from the middle of the mean shape along the axes of the coordinates (of "
        "images: x to the left, y to the back, z to the head, as their headers have it), which are not "
        "taken to be those of the patient: +z is the side of larger z. Describe parts by their anatomical "
        "names from the figures."
    )


def _region_row(study: Answer, comparison: Comparison, region: Region, number: str) -> tuple[str, ...]:
    return (
        comparison.title,
        number,
        f"{region.area:.0f}",
        region.where,
        effect_cell(study, region.mean_outward),
        f"{region.length:.{digits_of(study, region.outward.high - region.outward.low)}f}",
        p_number(region.p, comparison.pointwise.permutations),
    )


def _add_walls(page: Page, study: Answer, carrier: SurfaceCarrier) -> None:
    """Add the significant area of each wall of a hollow shape, and its direction of displacement."""
    walls = carrier.walls_at_particles(len(study.areas))
    rows = []
    for comparison in study.comparisons:
        if len(comparison.pointwise.effect) > 1:
            continue
        ways = carrier.ways_at_particles(comparison)
        for wall in (INNER, OUTER, EDGE):
            own = [index for index, name in enumerate(walls) if name == wall]
            if not own:
                continue
            areas, inside = study.areas[own], comparison.p_fwe[own] <= LEVEL
            whole = float(areas.sum())
            rows.append(
                (
                    comparison.title, wall, f"{whole:.0f}",
                    *(
                        f"{areas[part].sum():.0f} ({100.0 * areas[part].sum() / whole:.1f} %)"
                        for part in (inside, *(inside & (ways[own] == way) for way in (1, -1, 0)))
                    ),
                )
            )  # fmt: skip
    page.table(
        ["comparison", "wall", "area (mm²)", "significant (mm²)", "out of the tissue (mm²)",
         "into the tissue (mm²)", "neither clearly (mm²)"],
        rows,
        as_text=True,
        caption="Significant area of each wall, by direction of displacement",
    )  # fmt: skip


def interval_cell(effect: Effect, digits: int = 2, scale: float = 1.0) -> str:
    """Return an estimate with its interval in the format of tables, such as ``"1.27 (0.41 to 2.02)"``."""
    value, low, high = (f"{scale * item:.{digits}f}" for item in (effect.value, effect.low, effect.high))
    return f"{value} ({low} to {high})" if isfinite(effect.low) else value


def effect_cell(study: Answer, effect: Effect) -> str:
    """Return an effect with its interval; changes per unit have three digits of the interval's width."""
    return interval_cell(effect, digits_of(study, effect.high - effect.low))


def mean_text(mean: float, spread: float) -> str:
    """Return mean and standard deviation with the same decimals, three digits of the latter."""
    decimals = decimals_of(spread or abs(mean))
    return f"{mean:.{decimals}f} ± {spread:.{decimals}f}"


def decimals_of(spread: float) -> int:
    """Return the number of decimals at which a standard deviation has three digits."""
    return max(0, 2 - floor(log10(spread))) if spread > 0.0 else 0


def digits_of(study: Answer, width: float) -> int:
    """Return the number of decimals of an effect from the width of its interval."""
    if study.question.kind != "regression" or not width > 0.0:
        return 2
    return max(2, 2 - floor(log10(width)))


def add_statistics(page: Page, studies: Sequence[Answer]) -> None:
    """Add the statistics of the whole shape of all studies."""
    page.table(
        [
            "study", "comparison", "studentized statistic", "T² or Λ", "F (df)", "p (F)",
            "p (permutation), not corrected",
        ],
        (
            (str(number), *_statistics_row(title, comparison))
            for number, study in enumerate(studies, start=1)
            for title, comparison in tested_comparisons(study)
            if comparison.test.modes
        ),
        as_text=True,
        caption="Test statistics of the whole shape",
    )  # fmt: skip


def _statistics_row(title: str, comparison: Comparison) -> tuple[str, ...]:
    test = comparison.test
    return (
        title,
        f"{test.studentized:.2f}",
        f"T² {test.t_squared:.1f}" if test.t_squared is not None else f"Λ {test.wilks:.3f}",
        f"{test.f:.2f} ({test.dof[0]:g}, {test.dof[1]:.4g})",
        p_number(test.p),
        p_number(test.p_permutation, test.permutations),
    )


def add_assumptions(page: Page, studies: Sequence[Answer]) -> None:
    """Add dispersion, skewness and outliers of all comparisons."""
    page.table(
        [
            "study", "comparison", "dispersion: ratio, or mm per unit (95 % CI)", "p of dispersion",
            "skewness of size", "p of skewness of shapes", "outliers",
        ],
        (
            (str(number), *_assumptions_row(study, comparison))
            for number, study in enumerate(studies, start=1)
            for comparison in study.comparisons
        ),
        as_text=True,
        omit="–",
        caption="Assumptions of the tests; p not corrected",
    )  # fmt: skip


def _assumptions_row(study: Answer, comparison: Comparison) -> tuple[str, ...]:
    dispersion, skewness = comparison.dispersion, comparison.size_skewness
    tested = ("–", "–")
    if dispersion is not None:
        tested = (
            _ratio_cell(study, dispersion),
            p_number(dispersion.p, dispersion.permutations),
        )
    return (
        comparison.title,
        *tested,
        "–" if skewness is None else f"{skewness.value:.2f} ({p_text(skewness.p)})",
        "–" if skewness is None else p_number(skewness.shape_p),
        ", ".join(
            f"{study.names[index]} ({_group_of(study, index)}r {far:.2f}; limit "
            f"{comparison.outlier_limit:.2f})"
            for index, far in zip(comparison.outliers, comparison.outlier_distances, strict=True)
        )
        or "none",
    )


def _group_of(study: Answer, subject: int) -> str:
    """Return the group of an outlier, with a comma; an empty text for pairs and regressions."""
    return f"{study.labels[subject]}, " if study.question.kind == "groups" else ""


def _ratio_cell(study: Answer, dispersion: Dispersion) -> str:
    if dispersion.effect is None:
        return "–"
    return effect_cell(study, dispersion.effect)
