"""Tables with a row a subject: the cohort, and distance of particles, volume, area and wall thickness."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from homolog.arrays import FloatArray
from homolog.cohort import Cohort
from homolog.errors import InputError
from homolog.files.project import ProjectFolder
from homolog.files.results import Result
from homolog.files.tables import write_table
from homolog.progress import Tick, no_tick
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["Measures", "distances", "measure_meshes", "write_cohort", "write_measures"]


def write_cohort(path: Path, cohort: Cohort) -> None:
    """Write a cohort as CSV; the file can be read as a cohort again.

    Parameters
    ----------
    path : Path
        File to make or replace. Paths in it start at its folder.
    cohort : Cohort

    Raises
    ------
    InputError
        If the file can't be written.
    """
    relative = ProjectFolder(path.parent).describe(cohort)
    columns = list(dict.fromkeys(name for item in relative for name in item.columns))
    files = [name for name in ("landmarks", "image") if any(getattr(item, name) for item in relative)]
    write_table(
        path,
        ["name", "path", "group", *files, *columns],
        (
            [
                item.name,
                item.path,
                item.group,
                *(getattr(item, name) for name in files),
                *(item.columns.get(name) for name in columns),
            ]
            for item in relative
        ),
    )


_MM3_IN_ML, _MM2_IN_CM2 = 1000.0, 100.0


@dataclass(frozen=True, slots=True, eq=False)
class Measures:
    """Volume [ml], surface area [cm²] and mean wall thickness [mm] of some surfaces, shape (n,) each."""

    volumes: FloatArray
    areas: FloatArray
    walls: FloatArray


def measure_meshes(meshes: Sequence[TriangleMesh], tick: Tick = no_tick) -> Measures:
    """Measure closed surfaces.

    Parameters
    ----------
    meshes : sequence of TriangleMesh
    tick : Tick
    """
    from homolog.surfaces.walls import mean_thickness, wall_thickness  # loads Warp

    volumes, areas, walls = (np.empty(len(meshes)) for _ in range(3))
    for index, mesh in enumerate(meshes):
        tick(index / len(meshes), "measuring")
        volumes[index], areas[index] = mesh.volume / _MM3_IN_ML, mesh.area / _MM2_IN_CM2
        walls[index] = mean_thickness(mesh, wall_thickness(mesh))
    return Measures(volumes, areas, walls)


def distances(particles: FloatArray, first: int, second: int) -> FloatArray:
    """Return the straight distances (M,) of two particles on each shape (M, N, 3) [mm].

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
    """Write the subjects' distance of two particles, volume, area, wall thickness, in their files' size.

    Parameters
    ----------
    path : Path
        The CSV file.
    result : Result
    measures : Measures
        Of the subjects' surfaces in local coordinates.
    first, second : int
        The particles, counted from 0.

    Raises
    ------
    InputError
        If there is no such particle, or the file can't be written.
    """
    columns = ["name", "group", f"distance_{first}_{second}_mm", "volume_ml", "area_cm2", "wall_mm"]
    numbers = (distances(result.local, first, second), measures.volumes, measures.areas, measures.walls)
    rows = zip(result.names, result.groups, *(number.tolist() for number in numbers), strict=True)
    write_table(path, columns, rows)
