"""The tables of a report: rows of main results, covariates, regions, sample, measures and details."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from homolog.arrays import FloatArray
from homolog.comparison.answer import Answer
from homolog.comparison.findings import (
    covariate_rows,
    decimals,
    effect_text,
    place_of,
    step_of,
)
from homolog.comparison.formula import FormulaAnswer, difference_rows
from homolog.comparison.places import SurfaceCarrier, significant_regions
from homolog.comparison.sample import SHAPE_SIZE
from homolog.comparison.sample_rows import SampleRow, sample_rows
from homolog.io.results import Result
from homolog.statistics.cautions import p_number, p_text
from homolog.statistics.comparison import Comparison
from homolog.statistics.welch import mean_difference
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.topology import enclosed_volume
from homolog_app.plots import group_order

__all__ = [
    "ANOVA",
    "COVARIATES",
    "DETAILS",
    "DIFFERENCES",
    "MAIN",
    "REGIONS",
    "Measure",
    "anova",
    "apart",
    "covariates",
    "details",
    "main",
    "measure_columns",
    "measure_rows",
    "measures_of",
    "regions",
    "sample",
    "tested_comparisons",
]

_NONE = "–"
_MOST_REGIONS = 2
"""Maximum number of regions of a comparison in the table."""

MAIN = (
    "question",
    "comparison",
    "size (mm, 95 % CI)",
    "p of size",
    "D (90 % CI)",
    "p",
    "particles: FWE; FDR",
    "area (%)",
)
COVARIATES = ("question", "covariate", "D (90 % CI)", "p", "area (%)", "size (mm, 95 % CI)", "p of size")
REGIONS = ("question", "comparison", "region", "area (mm²)", "outward, mean (mm, 95 % CI)", "p at the peak")
ANOVA = ("question", "term", "df", "SS (mm²)", "R²", "F", "Z", "p")
DIFFERENCES = ("question", "difference", "shape (mm, D with 90 % CI), p", "size (mm, 95 % CI)")
DETAILS = (
    "question",
    "comparison",
    "modes (variance)",
    "statistic",
    "T² or Λ",
    "F (df), p",
    "ω² (90 % CI)",
    "accuracy (%, 95 % CI), p",
    "AUC (95 % CI), p",
    "dispersion, p",
    "skewness of size, p",
    "outliers",
)


def main(answers: Sequence[Answer]) -> Iterator[tuple[str, ...]]:
    """Yield the row of each comparison: size, shape and place."""
    for number, answer in enumerate(answers, start=1):
        for comparison in answer.comparisons:
            step, per = step_of(answer, comparison.title)
            size, far, test = comparison.size, comparison.distance, comparison.test
            place = place_of(answer, comparison)
            known = size is not None and np.isfinite(size.value)
            p = comparison.size_p_adjusted
            title = comparison.title if len(comparison.counts) < 3 else "all groups"
            yield (
                str(number),
                f"{title}{per}",
                effect_text(size, edge=answer.edge, step=step, sign=True)
                if size is not None and known
                else _NONE,
                p_number(p, size.permutations) if size is not None and p is not None else _NONE,
                effect_text(far, step=step) if far is not None else _NONE,
                p_number(comparison.p_adjusted, test.permutations),
                f"{place.certain}; {place.likely} of {place.particles}",
                f"{place.percent:.1f}",
            )


def covariates(answers: Sequence[Answer]) -> Iterator[tuple[str, ...]]:
    """Yield the row of each covariate of each question."""
    for number, answer in enumerate(answers, start=1):
        for title, far, p, area, size, of_size in covariate_rows(answer):
            yield str(number), title, far, p.removeprefix("p = "), area, size, of_size.removeprefix("p = ")


def anova(answers: Sequence[Answer]) -> Iterator[tuple[str, ...]]:
    """Yield the analysis of variance of each formula, on all coordinates."""
    for number, answer in enumerate(answers, start=1):
        for row in answer.coordinates if isinstance(answer, FormulaAnswer) else ():
            tested = (
                (_NONE,) * 3
                if row.f is None or row.z is None or row.p is None
                else (f"{row.f:.2f}", f"{row.z:.2f}", p_number(row.p, answer.question.permutations))
            )
            yield str(number), row.term, str(row.dof), f"{row.squares:.5g}", f"{row.r_squared:.3f}", *tested


def apart(answers: Sequence[Answer]) -> Iterator[tuple[str, ...]]:
    """Yield the differences of means and slopes of each formula."""
    for number, answer in enumerate(answers, start=1):
        for row in difference_rows(answer) if isinstance(answer, FormulaAnswer) else ():
            yield str(number), *(cell or _NONE for cell in row)


def regions(answers: Sequence[Answer], carrier: SurfaceCarrier) -> Iterator[tuple[str, ...]]:
    """Yield the largest regions of each comparison."""
    for number, answer in enumerate(answers, start=1):
        for comparison in answer.comparisons:
            step, per = step_of(answer, comparison.title)
            for region in significant_regions(answer, comparison, carrier)[:_MOST_REGIONS]:
                yield (
                    str(number),
                    f"{comparison.title}{per}",
                    region.where,
                    f"{region.area:.0f}",
                    effect_text(region.mean_outward, edge=answer.edge, step=step, sign=True),
                    p_number(region.p, comparison.pointwise.permutations),
                )


def tested_comparisons(answer: Answer) -> Iterator[tuple[str, Comparison]]:
    """Yield each comparison with its title, followed by the comparison without outliers."""
    for comparison in answer.comparisons:
        yield comparison.title, comparison
        if comparison.without_outliers is not None:
            names = ", ".join(answer.names[index] for index in comparison.outliers)
            yield f"{comparison.title}, without {names}", comparison.without_outliers


def details(answers: Sequence[Answer]) -> Iterator[tuple[str, ...]]:
    """Yield all tests of the whole shape, and their assumptions."""
    for number, answer in enumerate(answers, start=1):
        for title, comparison in tested_comparisons(answer):
            test, line = comparison.test, comparison.discriminant
            spread, skewness = comparison.dispersion, comparison.size_skewness
            eigenvalues = test.parallel.eigenvalues
            explained = 100.0 * float(eigenvalues[: test.modes].sum() / max(eigenvalues.sum(), 1e-300))
            rates = [
                _NONE
                if p is None
                else f"{effect_text(effect, step=scale)}, {p_number(p, effect.permutations)}"
                for effect, p, scale in (
                    (
                        (line.accuracy, comparison.accuracy_p_adjusted, 100.0),
                        (line.auc, comparison.auc_p_adjusted, 1.0),
                    )
                    if line is not None
                    else ()
                )
            ] or [_NONE, _NONE]
            yield (
                str(number),
                title,
                f"{test.modes} ({explained:.0f} %)",
                f"{test.studentized:.2f}",
                f"T² {test.t_squared:.1f}" if test.t_squared is not None else f"Λ {test.wilks:.3f}",
                f"{test.f:.2f} ({test.dof[0]:g}, {test.dof[1]:.4g}), {p_number(test.p)}",
                _NONE if comparison.explained is None else effect_text(comparison.explained),
                *rates,
                _NONE
                if spread is None or spread.effect is None
                else f"{effect_text(spread.effect)}, {p_number(spread.p, spread.permutations)}",
                _NONE if skewness is None else f"{skewness.value:.2f}, {p_number(skewness.p)}",
                ", ".join(answer.names[index] for index in comparison.outliers) or "none",
            )


def sample(answers: Sequence[Answer], result: Result) -> tuple[list[str], list[tuple[str, ...]]]:
    """Return columns and rows that describe the subjects of all questions, by group or all together."""
    cells: dict[str, dict[str, str]] = {}
    for answer in answers:
        rows = sample_rows(answer, result)
        sizes = {row.group: row.count for row in rows if row.variable == "subjects"}
        for row in rows:
            unit = f" ({row.unit})" if row.unit else ""
            title = f"{row.variable}{unit}{f': {row.category}' if row.category else ''}"
            edge = answer.edge if row.variable == SHAPE_SIZE else 0.0
            cells.setdefault(title, {}).setdefault(row.group, _sample_cell(row, sizes[row.group], edge))
    groups = list(dict.fromkeys(group for own in cells.values() for group in own))
    groups = [
        *group_order([group for group in groups if group != "all"]),
        *(["all"] if "all" in groups else []),
    ]
    return ["", *groups], [
        (title, *(own.get(group, _NONE) for group in groups)) for title, own in cells.items()
    ]


def _sample_cell(row: SampleRow, of: int, edge: float) -> str:
    if row.category:
        return f"{row.count} ({100.0 * row.count / max(of, 1):.0f} %)"
    if row.mean is None or row.least is None or row.largest is None:
        return str(row.count)
    value = f"{row.mean:.3g}"
    if row.spread is not None:
        digits = decimals(2.0 * row.spread, edge)
        mean, spread, *ends = (
            f"{number:.{digits}f}" for number in (row.mean, row.spread, row.least, row.largest)
        )
        value = f"{mean} ± {spread} ({' to '.join(ends)})"
    return value if row.count == of else f"{value}, of {row.count}"


@dataclass(frozen=True, slots=True)
class Measure:
    """A measure of each subject at its own size, with its name in tables and in the report."""

    column: str
    title: str
    values: FloatArray


def measures_of(meshes: Sequence[TriangleMesh], *, hollow: bool) -> list[Measure]:
    """Measure the surfaces of the subjects in the coordinates of their files.

    Parameters
    ----------
    meshes : sequence of TriangleMesh
        One for each subject; volumes are left out if one of them is open.
    hollow : bool
        Whether the shapes have a cavity, so that wall thickness is of interest: the thickness at each
        point, averaged over the surface's area.

    Returns
    -------
    list of Measure
        Empty without surfaces.
    """
    if not meshes:
        return []
    from homolog.surfaces.walls import mean_over_area, wall_thickness  # loads Warp

    volumes = np.array([enclosed_volume(mesh) / 1000.0 for mesh in meshes])
    measures = [] if np.isnan(volumes).any() else [Measure("volume_ml", "volume (ml)", volumes)]
    measures.append(
        Measure("area_cm2", "surface area (cm²)", np.array([mesh.area / 100.0 for mesh in meshes]))
    )
    if hollow:
        walls = np.array([mean_over_area(mesh, wall_thickness(mesh)) for mesh in meshes])
        measures.append(Measure("wall_mm", "mean wall thickness (mm)", walls))
    return measures


def measure_columns(answer: Answer) -> list[str]:
    """Return the heads of `measure_rows`."""
    names = answer.question.between
    return ["", *names, *(f"{second} - {first} (95 % CI)" for first, second in combinations(names, 2))]


def measure_rows(answer: Answer, measures: Sequence[Measure]) -> Iterator[tuple[str, ...]]:
    """Yield mean ± standard deviation of each measure by group, and differences with Welch's p."""
    for item in measures:
        own = {
            group: item.values[
                [
                    index
                    for index, (name, label) in enumerate(zip(answer.names, answer.labels, strict=True))
                    if label == group and name not in answer.left_out
                ]
            ]
            for group in answer.question.between
        }
        edge = answer.edge if item.column == "wall_mm" else 0.0
        cells = []
        for values in own.values():
            known = values[np.isfinite(values)]
            spread = float(known.std(ddof=1)) if len(known) > 1 else 0.0
            digits = decimals(2.0 * spread, edge)
            cells.append(f"{known.mean():.{digits}f} ± {spread:.{digits}f}" if spread else _NONE)
        for first, second in combinations(own, 2):
            difference = mean_difference(own[first], own[second])
            p = "" if difference is None or difference.p is None else f", {p_text(difference.p)}"
            cells.append(
                _NONE if difference is None else f"{effect_text(difference, edge=edge, sign=True)}{p}"
            )
        yield item.title, *cells
