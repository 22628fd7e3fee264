"""The subjects of a report: numbers, sizes, covariates, voxels and measures of surfaces by group."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np

from homolog.arrays import FloatArray
from homolog.comparison.answer import Answer
from homolog.comparison.sample import SHAPE_SIZE, VOXEL, SampleRow, sample_rows
from homolog.io.records import ResultRecord
from homolog.io.report_details import ReportDetails
from homolog.io.results import Result
from homolog.io.tables import write_table
from homolog.statistics.cautions import p_text
from homolog.statistics.design import lookalikes
from homolog.statistics.effects import Effect
from homolog.statistics.welch import mean_difference
from homolog.surfaces.mesh import TriangleMesh
from homolog_app.report.page import Page
from homolog_app.report.study_section import decimals_of, interval_cell, mean_text

__all__ = ["Measure", "add_measures", "add_missing", "add_samples", "measures_of"]


def add_missing(
    page: Page, record: ResultRecord, details: ReportDetails, *, one_seed: bool, primary: bool | None
) -> None:
    """Add a list of information that a paper needs and only its authors have.

    `one_seed`: a study has a single seed. `primary`: one of several studies is primary; None for one study.
    """
    points = [] if details.structure else ["the anatomical structure (--structure)"]
    if not details.cohort:
        points.append(
            "the cohort (--cohort): where and when subjects were recruited, criteria of inclusion and "
            "diagnosis, definition of the groups"
        )
    if not any(subject.voxel for subject in record.subjects):
        points.append("voxel size")
    points += [
        "scanner, protocol, phase or time of imaging, and the spacing of slices before any resampling",
        "who segmented, how, and how well segmentations of one subject agree",
        "units of columns whose names do not contain them",
        "reasons for the numbers of subjects and particles",
        "ethics approval",
    ]
    if primary is not None:
        points.append(
            "whether the primary study was chosen before the results were seen"
            if primary
            else "which study and which tests were chosen as primary before the results were seen"
        )
    if one_seed:
        points.append(
            "for studies of one seed, how answers vary with the seed of the correspondence (homolog analyze "
            "--seeds 5)"
        )
    given = "" if not details.cohort else " unless the description of the cohort contains it"
    page.paragraph(f"A paper also needs, and the program does not know{given}: {'; '.join(points)}.")


def add_samples(page: Page, studies: Sequence[Answer], result: Result) -> None:
    """Describe the sample of each study; studies with the same sample share a description."""
    numbers_of: dict[str, list[int]] = {}
    first: dict[str, Answer] = {}
    for number, study in enumerate(studies, start=1):
        key = repr(_sample_of(study, result))
        numbers_of.setdefault(key, []).append(number)
        first.setdefault(key, study)
    for key, own in numbers_of.items():
        _sample(page, first[key], result, ", ".join(map(str, own)) if len(numbers_of) > 1 else "")


def _sample_text(row: SampleRow, of: int) -> str:
    if row.category:
        return f"{row.count} ({100.0 * row.count / max(of, 1):.0f} %)"
    if row.mean is None or row.least is None or row.largest is None:
        return str(row.count)
    value = f"{row.mean:.3g}"
    if row.spread is not None:
        value = f"{mean_text(row.mean, row.spread)} ({_range_text(row.least, row.largest)})"
    return value if row.count == of else f"{value}, of {row.count}"


def _range_text(least: float, largest: float) -> str:
    """Return a range with four digits and the same decimals at both ends."""
    ends = (f"{least:.4g}", f"{largest:.4g}")
    decimals = max(0 if "e" in end else len(end.partition(".")[2]) for end in ends)
    return f"{least:.{decimals}f} to {largest:.{decimals}f}"


def _sample_of(study: Answer, result: Result) -> tuple[list[SampleRow], dict[str, str]]:
    return sorted(sample_rows(study, result), key=repr), dict(study.left_out)


def _sample(page: Page, study: Answer, result: Result, of: str) -> None:
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
        "Mean ± standard deviation (minimum to maximum), or number of subjects (percentage of the group)."
    )
    categories: dict[str, list[str]] = {}
    for row in rows:
        categories.setdefault(row.variable, []).append(row.category)
    for variable, values in categories.items():
        for alike in lookalikes(values):
            page.caution(
                f"{variable} contains {' and '.join(map(repr, alike))}, counted as different values."
            )
    listed = [f"{name} ({why})" for name, why in study.left_out.items()]
    excluded = f"Not compared: {len(listed)} of {len(result.names)} subjects. {', '.join(listed)}"
    columns = [variable for variable in categories if variable not in ("subjects", SHAPE_SIZE, VOXEL)]
    untested = ""
    if columns and study.question.kind == "groups":
        untested = f" Whether groups differ in {', '.join(columns)} was not tested."
    page.paragraph(f"{excluded if listed else 'All subjects were compared.'}{untested}")


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
        Closed surfaces, one for each subject.
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

    measures = [
        Measure("volume_ml", "volume (ml)", np.array([mesh.volume / 1000.0 for mesh in meshes])),
        Measure("area_cm2", "surface area (cm²)", np.array([mesh.area / 100.0 for mesh in meshes])),
    ]
    if hollow:
        walls = np.array([mean_over_area(mesh, wall_thickness(mesh)) for mesh in meshes])
        measures.append(Measure("wall_mm", "mean wall thickness (mm)", walls))
    return measures


def add_measures(
    page: Page, folder: Path, result: Result, studies: Sequence[Answer], measures: Sequence[Measure]
) -> None:
    """Add a table of the measures for each set of compared groups; write those of all subjects to a file."""
    if not measures:
        return
    rows = zip(result.names, *(item.values.tolist() for item in measures), strict=True)
    write_table(folder / _FILE, ["name", *(item.column for item in measures)], rows)
    done = set()
    for study in studies:
        question = study.question.column, study.question.between, tuple(study.left_out)
        if study.question.kind != "groups" or question in done:
            continue
        done.add(question)
        _table(page, study, measures)


def _table(page: Page, study: Answer, measures: Sequence[Measure]) -> None:
    members = {
        group: [
            index
            for index, (name, label) in enumerate(zip(study.names, study.labels, strict=True))
            if label == group and name not in study.left_out
        ]
        for group in study.question.between
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
    finite = values[np.isfinite(values)]
    return f"{finite.mean():.{decimals}f} ± {finite.std(ddof=1):.{decimals}f}" if len(finite) > 1 else "–"
