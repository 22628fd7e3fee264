"""Volume, surface area and wall thickness of the subjects, by group: means, differences, intervals, p."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np

from homolog.analysis.cautions import p_text
from homolog.analysis.effects import Effect
from homolog.analysis.welch import mean_difference
from homolog.arrays import FloatArray
from homolog.files.results import Result
from homolog.files.tables import write_table
from homolog.surfaces.mesh import TriangleMesh
from homolog_app.report.page import Page
from homolog_app.report.study import Study
from homolog_app.report.study_parts import decimals_of, interval_cell

__all__ = ["Measure", "add_measures", "measures_of"]

_FILE = "measures.csv"


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
        Closed, one for each subject.
    hollow : bool
        Whether the shapes have a cavity, so that wall thickness is of interest: the mean over the surface's
        area of the thickness at each point.

    Returns
    -------
    list of Measure
        Empty without surfaces.
    """
    if not meshes:
        return []
    from homolog.surfaces.walls import mean_over_area, wall_thickness  # loads Warp

    measures = [
        Measure("volume_ml", "volume (ml)", np.array([mesh.volume / 1000.0 for mesh in meshes])),
        Measure("area_cm2", "surface area (cm²)", np.array([mesh.area / 100.0 for mesh in meshes])),
    ]
    if hollow:
        walls = np.array([mean_over_area(mesh, wall_thickness(mesh)) for mesh in meshes])
        measures.append(Measure("wall_mm", "mean wall thickness (mm)", walls))
    return measures


def add_measures(
    page: Page, folder: Path, result: Result, studies: Sequence[Study], measures: Sequence[Measure]
) -> None:
    """Add a table of the measures for each set of groups that was compared; write those of all subjects."""
    if not measures:
        return
    rows = zip(result.names, *(item.values.tolist() for item in measures), strict=True)
    write_table(folder / _FILE, ["name", *(item.column for item in measures)], rows)
    done = set()
    for study in studies:
        question = study.request.column, study.request.between, tuple(study.left_out)
        if study.request.kind != "groups" or question in done:
            continue
        done.add(question)
        _table(page, study, measures)


def _table(page: Page, study: Study, measures: Sequence[Measure]) -> None:
    members = {
        group: [
            index
            for index, (name, label) in enumerate(zip(study.names, study.labels, strict=True))
            if label == group and name not in study.left_out
        ]
        for group in study.request.between
    }
    pairs = list(combinations(members, 2))
    rows = []
    for item in measures:
        own = {name: item.values[index] for name, index in members.items()}
        decimals = decimals_of(float(np.nanstd(item.values)))
        cells = [_mean_cell(values, decimals) for values in own.values()]
        for first, second in pairs:
            difference = mean_difference(own[first], own[second])
            cells.append("–" if difference is None else _difference_cell(difference, decimals))
        rows.append((item.title, *cells))
    page.table(
        ["", *(f"{name} (n = {len(index)})" for name, index in members.items()),
         *(f"{second} - {first}" for first, second in pairs)],
        rows,
        as_text=True,
        omit="–",
        caption="Measures of the subjects' surfaces at their own size",
    )  # fmt: skip
    page.paragraph(
        "Mean ± standard deviation; differences with 95 % CI and p of Welch's t-test, not corrected for "
        "pairs or measures, not adjusted."
    )


def _difference_cell(difference: Effect, decimals: int) -> str:
    p = "" if difference.p is None else f", {p_text(difference.p)}"
    return f"{interval_cell(difference, decimals)}{p}"


def _mean_cell(values: FloatArray, decimals: int) -> str:
    there = values[np.isfinite(values)]
    return f"{there.mean():.{decimals}f} ± {there.std(ddof=1):.{decimals}f}" if len(there) > 1 else "–"
