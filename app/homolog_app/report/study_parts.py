"""Parts of a study's report: where it found something, and what its tests assume."""

from collections.abc import Iterator, Sequence
from math import floor, log10

from homolog.analysis.assumptions import Dispersion
from homolog.analysis.cautions import p_number
from homolog.analysis.comparison import Comparison
from homolog.analysis.effects import Effect
from homolog_app.report.findings import LEVEL, p_text
from homolog_app.report.page import Page
from homolog_app.report.study import Study
from homolog_app.report.surface_maps import EDGE, INNER, OUTER, Region, SurfaceCarrier, significant_regions

__all__ = [
    "add_assumptions", "add_regions", "add_statistics", "axes_text", "decimals_of", "digits_of",
    "effect_cell", "interval_cell", "mean_text", "tested_comparisons",
]  # fmt: skip

_MOST_REGIONS = 3
"""Of a comparison, in the table of regions."""


def tested_comparisons(study: Study) -> Iterator[tuple[str, Comparison]]:
    """Yield each comparison with its title, followed by the same without its outliers."""
    for comparison in study.comparisons:
        yield comparison.title, comparison
        if comparison.without_outliers is not None:
            names = ", ".join(study.names[index] for index in comparison.outliers)
            yield f"{comparison.title}, without {names}", comparison.without_outliers


def add_regions(page: Page, study: Study, carrier: SurfaceCarrier) -> None:
    """Add a table of the largest regions where particles are significant, and one of walls."""
    rows = []
    for comparison in study.comparisons:
        regions = significant_regions(study, comparison, carrier)
        rows += [
            _region_row(study, comparison, region, f"{number} of {len(regions)}")
            for number, region in enumerate(regions[:_MOST_REGIONS], start=1)
        ]
    if not rows:
        return
    per = f" per unit of {study.request.column}" if study.request.kind == "regression" else ""
    page.table(
        [
            "comparison", "region", "area (mm²)", "place of the peak", f"outward, mean (mm{per}, "
            "95 % CI)",
            f"peak moves by (mm{per})", "p at the "
            "peak",
        ],
        rows,
        as_text=True,
        caption=f"Where: the largest regions, {_MOST_REGIONS} of a comparison at most (all: regions.csv)",
    )  # fmt: skip
    if carrier.is_hollow:
        _add_walls(page, study, carrier)


def axes_text(carrier: SurfaceCarrier, *, confirmed: bool) -> str:
    """Return what places are called by, and whether authors have confirmed it."""
    if carrier.directions.are_the_patients:
        unsure = (
            ""
            if confirmed
            else " Headers can be wrong after resampling or export, and nobody has confirmed these (--axes "
            "patient): compare the figures with the anatomy before a place is published."
        )
        return (
            "Places are directions from the middle of the mean shape along the patient's axes, as the files "
            "state them: left is towards the patient's left, anterior towards the front, superior towards "
            f"the head.{unsure}"
        )
    if carrier.directions.are_named:
        sides = zip(carrier.directions.sides, "xyz", strict=True)
        named = ", ".join(f"{low} and {high} of smaller and larger {axis}" for (low, high), axis in sides)
        return (
            f"Places are sides of the mean shape, seen from its middle, as the authors named them: {named}."
        )
    return (
        "Places are directions from the middle of the mean shape along the axes of the coordinates (of "
        "images: x to the left, y to the back, z to the head, as their headers have it), which are not "
        "taken to be those of the patient: +z is the side of larger z. Describe parts by their anatomical "
        "names from the figures."
    )


def _region_row(study: Study, comparison: Comparison, region: Region, number: str) -> tuple[str, ...]:
    return (
        comparison.title,
        number,
        f"{region.area:.0f}",
        region.where,
        effect_cell(study, region.mean_outward),
        f"{region.length:.{digits_of(study, region.outward.high - region.outward.low)}f}",
        p_number(region.p, comparison.pointwise.permutations),
    )


def _add_walls(page: Page, study: Study, carrier: SurfaceCarrier) -> None:
    """Add how much of each wall of a hollow shape is significant, and moves which way."""
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
                        f"{areas[some].sum():.0f} ({100.0 * areas[some].sum() / whole:.1f} %)"
                        for some in (inside, *(inside & (ways[own] == way) for way in (1, -1, 0)))
                    ),
                )
            )  # fmt: skip
    page.table(
        ["comparison", "wall", "area (mm²)", "significant (mm²)", "out of the tissue (mm²)",
         "into the tissue (mm²)", "neither clearly (mm²)"],
        rows,
        as_text=True,
        caption="Significant area of each wall, and which way it moves",
    )  # fmt: skip


def interval_cell(effect: Effect, digits: int = 2, scale: float = 1.0) -> str:
    """Return an estimate with its interval as tables have it, such as ``"1.27 (0.41 to 2.02)"``."""
    value, low, high = (f"{scale * item:.{digits}f}" for item in (effect.value, effect.low, effect.high))
    return f"{value} ({low} to {high})"


def effect_cell(study: Study, effect: Effect) -> str:
    """Return an effect with its interval; changes per unit have three digits of the interval's width."""
    return interval_cell(effect, digits_of(study, effect.high - effect.low))


def mean_text(mean: float, spread: float) -> str:
    """Return mean and standard deviation with the same decimals, three digits of the latter."""
    decimals = decimals_of(spread or abs(mean))
    return f"{mean:.{decimals}f} ± {spread:.{decimals}f}"


def decimals_of(spread: float) -> int:
    """Return the decimals of numbers with such a standard deviation, so that it has three digits."""
    return max(0, 2 - floor(log10(spread))) if spread > 0.0 else 0


def digits_of(study: Study, width: float) -> int:
    """Return the decimals of an effect whose interval is so wide."""
    if study.request.kind != "regression" or not width > 0.0:
        return 2
    return max(2, 2 - floor(log10(width)))


def add_statistics(page: Page, studies: Sequence[Study]) -> None:
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


def add_assumptions(page: Page, studies: Sequence[Study]) -> None:
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


def _assumptions_row(study: Study, comparison: Comparison) -> tuple[str, ...]:
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
            f"{study.names[index]} (r {far:.2f}; limit {comparison.outlier_limit:.2f})"
            for index, far in zip(comparison.outliers, comparison.outlier_distances, strict=True)
        )
        or "none",
    )


def _ratio_cell(study: Study, dispersion: Dispersion) -> str:
    if dispersion.effect is None:
        return "–"
    return effect_cell(study, dispersion.effect)
