"""Tables as files: scores, modes and measures of the subjects."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from homolog.arrays import FloatArray
from homolog.cohort import Cohort
from homolog.comparison.answer import Answer
from homolog.comparison.ask import ask
from homolog.comparison.places import SurfaceCarrier, directions_of
from homolog.comparison.question import Question
from homolog.comparison.sample import Sample, at_own_size
from homolog.comparison.stored import (
    Provenance,
    StoredAnswer,
    folder_of,
    is_primary,
    stored_answers,
    stored_poses,
)
from homolog.comparison.tables import data_digest
from homolog.comparison.tables import write_tables as write_answer_tables
from homolog.errors import InputError
from homolog.io.atomic import write_text
from homolog.io.names import file_stems
from homolog.io.project import ProjectFolder
from homolog.io.report_details import read_details
from homolog.io.results import Result, read_result, read_whole_surface
from homolog.io.tables import write_table
from homolog.progress import Tick, no_tick, part_of
from homolog.statistics.assumptions import shape_outliers
from homolog.statistics.cautions import p_text
from homolog.statistics.parallel import parallel_analysis
from homolog.statistics.procrustes import Alignment, rms_radii
from homolog.statistics.shape_model import ShapeModel
from homolog.statistics.welch import compare_measure
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.topology import enclosed_volume
from homolog_app.exports.settings import TableSettings
from homolog_app.scenes.loaded_result import LoadedResult
from homolog_app.scenes.model_shape import ModelShape

__all__ = [
    "Measures",
    "cohort_rows",
    "compare",
    "distances",
    "group_lines",
    "measure_meshes",
    "measures_along",
    "measures_of",
    "structure_measures",
    "write_cohort",
    "write_measures",
    "write_tables",
]


def compare(
    result: Result,
    groups: tuple[str, str, str],
    permutations: int,
    seed: int,
    tick: Tick = no_tick,
    *,
    alignment: Alignment = Alignment.FORM,
) -> Answer:
    """Compare two groups of a column: (column, first, second); raises as `ask` does."""
    column, first, second = groups
    request = Question(
        column=column,
        between=(first, second),
        alignment=alignment,
        permutations=permutations,
        seed=seed,
    )
    return ask(Sample.of(result), request, tick)


def write_tables(
    project: ProjectFolder,
    folder: Path,
    settings: TableSettings,
    groups: tuple[str, str, str] | None = None,
    tick: Tick = no_tick,
) -> None:
    """Write ``scores.csv``, ``modes.csv``, ``subjects.csv``, and a folder of tables for each study.

    Parameters
    ----------
    project : ProjectFolder
        A project with a result.
    folder : Path
        An existing empty folder.
    settings : TableSettings
        Settings of the comparison of `groups`.
    groups : (str, str, str), optional
        Column and two groups to compare. By default, the studies stored by ``homolog analyze``; their stored
        tables are copied if they belong to this result. What can't be answered any more is named in
        ``left_out.txt``.
    tick : Tick
        Progress and cancellation.

    Raises
    ------
    InputError
        If there is no result or group, or the folder can't be written to.
    """
    tick(0.0, "reading the result")
    result = read_result(project)
    model = ShapeModel().fit(result.world, names=result.names)
    _write_scores(folder / "scores.csv", result, model)
    tick(0.05, "parallel analysis")
    _write_modes(folder / "modes.csv", result, model)
    _write_subjects(folder / "subjects.csv", project, result, model, part_of(tick, 0.1, 0.3))
    rest = part_of(tick, 0.3, 1.0)
    if groups is not None:
        study = compare(result, groups, settings.permutations, settings.seed, rest)
        _write_study(project, folder / study.question.name, study, result)
        return
    kept, lost = stored_answers(project)
    stems = file_stems([item.question.name for item in kept])
    for index, (item, stem) in enumerate(zip(kept, stems, strict=True)):
        if not _copied(project, item, result, folder / stem):
            part = part_of(rest, index / len(kept), (index + 1) / len(kept))
            try:
                answer = ask(Sample.of(result), item.question, part)
            except InputError as error:  # such as a value that a subject added later lacks
                lost.append(f"{item.question.title}: {error}")
                continue
            _write_study(project, folder / stem, answer, result)
    for item in stored_poses(project):
        if item.is_outdated:
            lost.append(f"{item.question.title}: is of earlier particles; analyze again")
            continue
        for path in sorted(folder_of(project, item.question).glob("*.csv")):
            write_text(folder / item.question.name / path.name, path.read_text(encoding="utf-8"))
    if lost:
        write_text(folder / "left_out.txt", "\n".join(lost) + "\n")


def _copied(project: ProjectFolder, stored: StoredAnswer, result: Result, folder: Path) -> bool:
    """Copy a study's stored tables, and return True, if they belong to this result, data and version."""
    directions = directions_of(read_details(project))
    now = Provenance.now(project, data_digest(result, directions))
    if stored.is_outdated or stored.provenance.model_copy(update={"date": now.date}) != now:
        return False
    for path in sorted(folder_of(project, stored.question).glob("*.csv")):
        write_text(folder / path.name, path.read_text(encoding="utf-8"))
    return True


def _write_study(project: ProjectFolder, folder: Path, answer: Answer, result: Result) -> None:
    directions = directions_of(read_details(project))
    write_answer_tables(
        folder,
        answer,
        result,
        SurfaceCarrier.of(result, directions),
        Provenance.now(project),
        is_primary=is_primary(folder_of(project, answer.question)),
    )


def _columns(result: Result) -> list[str]:
    return list(dict.fromkeys(name for columns in result.columns for name in columns))


def _write_scores(path: Path, result: Result, model: ShapeModel) -> None:
    modes = [f"mode_{number}_rms_mm" for number in range(1, len(model.explained_variance_) + 1)]
    rows = zip(result.names, result.groups, model.scores_.tolist(), strict=True)
    write_table(path, ["name", "group", *modes], ([name, group, *scores] for name, group, scores in rows))


def _write_modes(path: Path, result: Result, model: ShapeModel) -> None:
    parallel = parallel_analysis(result.world)
    columns = [
        "mode",
        "eigenvalue_mm2",
        "standard_deviation_rms_mm",
        "share",
        "cumulative_share",
        "chance_eigenvalue_mm2",
        "above_chance",
    ]
    shares, eigenvalues = model.explained_variance_ratio_, len(model.mean_) * model.explained_variance_
    rows = zip(
        eigenvalues.tolist(),
        model.standard_deviations_.tolist(),
        shares.tolist(),
        np.cumsum(shares).tolist(),
        parallel.threshold.tolist(),
        strict=False,
    )
    write_table(
        path,
        columns,
        ([mode, *row, int(mode <= parallel.n_retained)] for mode, row in enumerate(rows, start=1)),
    )


def _write_subjects(
    path: Path, project: ProjectFolder, result: Result, model: ShapeModel, tick: Tick
) -> None:
    """Write the measures of each subject's groomed surface at its own size, with the cohort's columns."""
    record = project.read().result
    assert record is not None, "a result that was read has a record"
    far = set(shape_outliers(result.world).tolist())
    apart = np.sqrt(np.square(result.world - model.mean_).sum(axis=2).mean(axis=1))
    own, sizes = _columns(result), rms_radii(at_own_size(result.world, result.alignments)).tolist()
    rows, several, names = [], list[dict[str, FloatArray]](), list(result.structures)
    for index, subject in enumerate(record.subjects):
        tick(index / len(record.subjects), f"measuring {subject.name}")
        mesh = read_whole_surface(project, record, subject)
        several.append(structure_measures([mesh], names) if names else {})
        measures = [enclosed_volume(mesh), mesh.area, sizes[index], float(apart[index]), int(index in far)]
        rows.append([subject.name, subject.group, *(subject.columns.get(name) for name in own), *measures])
    titles = list(dict.fromkeys(title for values in several for title in values))
    rows = [
        [*row, *(float(values[title][0]) if title in values else None for title in titles)]
        for row, values in zip(rows, several, strict=True)
    ]
    measured = ["volume_mm3", "area_mm2", "size_mm", "distance_from_mean_mm", "outlier"]
    heads = ["name", "group", *own, *measured, *titles]
    write_table(path, *_without_volumes(heads, rows, "volume_mm3"))


def _without_volumes(
    heads: list[str], rows: list[list[Any]], volume: str
) -> tuple[list[str], list[list[Any]]]:
    """Return a table whose open surfaces have no volume, without its column if all are open."""
    column = heads.index(volume)
    blank = [[None if value != value else value for value in row] for row in rows]
    if any(row[column] is not None for row in blank):
        return heads, blank
    return heads[:column] + heads[column + 1 :], [row[:column] + row[column + 1 :] for row in blank]


def write_cohort(path: Path, cohort: Cohort) -> None:
    """Write a cohort as CSV; the file can be read as a cohort again.

    Parameters
    ----------
    path : Path
        File to create or replace. Its paths are relative to its folder.
    cohort : Cohort

    Raises
    ------
    InputError
        If the file can't be written.
    """
    heads, *rows = cohort_rows(cohort, path.parent)
    write_table(path, heads, rows)


def cohort_rows(cohort: Cohort, folder: Path) -> list[list[str]]:
    """Return a cohort as rows of a table, the headings first, with paths relative to a folder."""
    described = ProjectFolder(folder).describe(cohort)
    structures = list(dict.fromkeys(name for item in described for name in item.structures))
    columns = list(dict.fromkeys(name for item in described for name in item.columns))
    further = [name for name in ("landmarks", "image") if any(getattr(item, name) for item in described)]
    single = any(not item.structures for item in described)
    heads = ["name", *(["path"] if single else []), *(f"path:{name}" for name in structures), "group"]
    rows = [[*heads, *further, *columns]]
    for item in described:
        cells = [item.name, *([item.path if not item.structures else ""] if single else [])]
        cells += [item.structures.get(name, "") for name in structures]
        cells += [item.group or "", *(getattr(item, name) or "" for name in further)]
        rows.append([*cells, *(item.columns.get(name, "") for name in columns)])
    return rows


_MM3_IN_ML, _MM2_IN_CM2 = 1000.0, 100.0


@dataclass(frozen=True, slots=True, eq=False)
class Measures:
    """Volume, area, mean wall thickness and mean distance from the mean surface, shape (n,) each.

    Units are ml, cm² and mm. The volume of an open surface is NaN. The distance is that of
    `distances_from_mean`. `structures` are those of `structure_measures`.
    """

    volumes: FloatArray
    areas: FloatArray
    walls: FloatArray
    from_mean: FloatArray
    structures: Mapping[str, FloatArray] = field(default_factory=dict)

    def columns(self, apart: FloatArray) -> tuple[FloatArray, ...]:
        """Return distances of two particles [mm], shape (M,), and the four measures."""
        return apart, self.volumes, self.areas, self.walls, self.from_mean


def structure_measures(
    meshes: Sequence[TriangleMesh], names: Sequence[str], tick: Tick = no_tick
) -> dict[str, FloatArray]:
    """Measure the structures of surfaces, and the space between them.

    Parameters
    ----------
    meshes : sequence of TriangleMesh
        Each of as many parts as there are names.
    names : sequence of str
    tick : Tick

    Returns
    -------
    dict of str to (n,) array
        By the title of the column: the volumes of closed structures [ml], and the smallest distance between
        the surfaces of each two [mm], negative where one enters the other, by its depth.
    """
    from homolog.surfaces.closest import distances_to, signed_distances_to

    values = dict[str, list[float]]()
    for index, mesh in enumerate(meshes):
        tick(index / len(meshes), "measuring structures")
        volumes = [enclosed_volume(part) / _MM3_IN_ML for part in mesh.parts]
        for name, volume in zip(names, volumes, strict=True):
            values.setdefault(f"volume_{name}_ml", []).append(volume)
        for (first, a), (second, b) in combinations(enumerate(mesh.parts), 2):
            apart = [
                (distances_to if np.isnan(volumes[other]) else signed_distances_to)(whole, part.vertices)
                for part, other, whole in ((a, second, b), (b, first, a))
            ]
            title = f"distance_{names[first]}_{names[second]}_mm"
            values.setdefault(title, []).append(float(np.concatenate(apart).min()))
    return {title: column for title, row in values.items() if np.isfinite(column := np.array(row)).any()}


def measure_meshes(
    meshes: Sequence[TriangleMesh],
    from_mean: FloatArray,
    tick: Tick = no_tick,
    structures: Sequence[str] = (),
) -> Measures:
    """Measure surfaces.

    Parameters
    ----------
    meshes : sequence of TriangleMesh
    from_mean : (n,) array
        Distances of the shapes from the mean surface [mm].
    tick : Tick
    structures : sequence of str
        Names of their parts, if there are several.
    """
    from homolog.surfaces.walls import mean_over_area, wall_thickness

    volumes, areas, walls = (np.empty(len(meshes)) for _ in range(3))
    for index, mesh in enumerate(meshes):
        tick(0.5 * index / len(meshes), "measuring")
        volumes[index], areas[index] = enclosed_volume(mesh) / _MM3_IN_ML, mesh.area / _MM2_IN_CM2
        walls[index] = mean_over_area(mesh, wall_thickness(mesh))
    own = structure_measures(meshes, structures, part_of(tick, 0.5, 1.0)) if structures else {}
    return Measures(volumes, areas, walls, from_mean, own)


def measures_of(loaded: LoadedResult, mean: TriangleMesh, tick: Tick = no_tick) -> Measures:
    """Measure the subjects' own surfaces; their distance is that from a mean surface."""
    world = loaded.result.world
    apart = distances_from_mean(world, world.mean(axis=0), mean)
    meshes = [loaded.surfaces[name][0] for name in loaded.result.names]
    return measure_meshes(meshes, apart, tick, list(loaded.result.structures))


def measures_along(shape: ModelShape, mode: int, amounts: FloatArray, tick: Tick = no_tick) -> Measures:
    """Measure the shapes at positions (n,) [SD] along a mode, counted from 0."""
    steps = [amount * np.eye(mode + 1)[mode] for amount in amounts]
    meshes = [shape.mean.moved(shape.mean.vertices + shape.moved(at)) for at in steps]
    instances = np.stack([shape.particles(at) for at in steps])
    apart = distances_from_mean(instances, shape.model.mean_, shape.mean)
    return measure_meshes(meshes, apart, tick, list(shape.result.structures))


def distances_from_mean(world: FloatArray, centre: FloatArray, mean: TriangleMesh) -> FloatArray:
    """Return the mean absolute distance of each shape's particles from the mean surface.

    The distance of a particle is the component of its displacement from its mean position along the mean
    surface's normal. The distance to the nearest point of the surface would not exceed the thickness of a
    wall, even for large displacements.

    Parameters
    ----------
    world : (M, N, 3) array
        Aligned particles [mm].
    centre : (N, 3) array
        Mean positions of the particles [mm].
    mean : TriangleMesh
        The mean surface.

    Returns
    -------
    (M,) array
        Distances [mm].
    """
    normals = mean.vertex_normals[cKDTree(mean.vertices).query(centre)[1]]
    return np.asarray(np.abs(np.einsum("mni,ni->mn", world - centre, normals)).mean(axis=1))


def group_lines(result: Result, measures: Measures, first: int, second: int) -> list[str]:
    """Describe mean and standard deviation of each measure by group, with Welch's p.

    There is one line per measure, or none without groups. See `write_measures` for the parameters.
    """
    groups = [group or "" for group in result.groups]
    if not any(groups):
        return []
    lines = []
    for name, values in _measured(result, measures, first, second).items():
        if np.isnan(values).all():
            continue  # volumes of open surfaces
        of_groups = compare_measure(values, groups)
        rows = zip(of_groups.groups, of_groups.means, of_groups.deviations, of_groups.counts, strict=True)
        each = (
            f"{group} {mean:.4g}{f' ± {spread:.2g}' if count > 1 else ''} (n = {count})"
            for group, mean, spread, count in rows
        )
        test = "no test" if of_groups.p is None else f"Welch {p_text(of_groups.p)}"
        lines.append(f"{name}: {', '.join(each)}; {test}")
    return lines


def _measured(result: Result, measures: Measures, first: int, second: int) -> dict[str, FloatArray]:
    """Return the measures by their column titles."""
    titles = (f"distance_{first}_{second}_mm", "volume_ml", "area_cm2", "wall_mm")
    columns = measures.columns(distances(result.local, first, second))
    usual = zip((*titles, "distance_from_mean_surface_mm"), columns, strict=True)
    return {**dict(usual), **measures.structures}


def distances(particles: FloatArray, first: int, second: int) -> FloatArray:
    """Return the Euclidean distances (M,) between two particles on each shape (M, N, 3) [mm].

    Raises
    ------
    InputError
        If there is no such particle.
    """
    count = particles.shape[-2]
    for item in (first, second):
        if not 0 <= item < count:
            raise InputError(f"no particle {item}; particles are numbered from 0 to {count - 1}")
    return np.asarray(np.linalg.norm(particles[:, second] - particles[:, first], axis=1))


def write_measures(path: Path, result: Result, measures: Measures, first: int, second: int) -> None:
    """Write each subject's particle distance, volume, area, wall thickness and distance from the mean.

    All but the last refer to the size in the subjects' files.

    Parameters
    ----------
    path : Path
        The CSV file.
    result : Result
    measures : Measures
        Measures of the subjects' surfaces in local coordinates.
    first, second : int
        Indices of the particles, from 0.

    Raises
    ------
    InputError
        If there is no such particle, or the file can't be written.
    """
    measured = _measured(result, measures, first, second)
    rows = zip(result.names, result.groups, *(values.tolist() for values in measured.values()), strict=True)
    heads = ["name", "group", *measured]
    write_table(path, *_without_volumes(heads, [list(row) for row in rows], "volume_ml"))
