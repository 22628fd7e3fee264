"""A project's landmarks: read from the subjects' markups, compared through the correspondence."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

from homolog.analysis.landmarks import landmark_errors
from homolog.arrays import FloatArray, frozen
from homolog.errors import InputError
from homolog.files.markups import read_markups
from homolog.files.meshes import read_mesh
from homolog.files.project import Project
from homolog.files.results import read_result, surface_file
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["LandmarkErrors", "landmark_table", "project_landmark_errors", "snapping"]

_FAR = 0.25  # of the size: no landmark of the surface is that far from it
_SAMPLES = 12  # points drawn on each face, for nearest points of a surface


@dataclass(frozen=True, slots=True, eq=False)
class LandmarkErrors:
    """How far landmarks miss that the correspondence carries from subject to subject.

    Attributes
    ----------
    names : tuple of str
        The L landmarks that two or more subjects have.
    subjects : tuple of str
        The subjects that have any.
    errors : (M, M, L) array
        Distances [mm] by source, target and landmark; NaN where there is nothing to compare.
    """

    names: tuple[str, ...]
    subjects: tuple[str, ...]
    errors: FloatArray

    @property
    def mean(self) -> float:
        """Mean distance over all pairs and landmarks [mm]."""
        return float(np.nanmean(self.errors))

    @property
    def median(self) -> float:
        """Median distance over all pairs and landmarks [mm]."""
        return float(np.nanmedian(self.errors))

    @property
    def by_landmark(self) -> FloatArray:
        """Mean distance of each landmark over all pairs [mm], (L,)."""
        means: FloatArray = np.nanmean(self.errors, axis=(0, 1))
        return means


def landmark_table(
    markups: Sequence[tuple[tuple[str, ...], FloatArray]],
) -> tuple[tuple[str, ...], FloatArray]:
    """Return the names that two or more subjects have, and all positions (M, L, 3), NaN if missing."""
    every = [name for names, _ in markups for name in names]
    shared = tuple(name for name in dict.fromkeys(every) if every.count(name) > 1)
    table = np.full((len(markups), len(shared), 3), np.nan)
    for row, (names, points) in zip(table, markups, strict=True):
        for name, point in zip(names, points, strict=True):
            if name in shared:
                row[shared.index(name)] = point
    return shared, table


def project_landmark_errors(project: Project) -> LandmarkErrors | None:
    """Carry every subject's landmarks to every other; None if fewer than two subjects have the same ones.

    Parameters
    ----------
    project : Project
        With a result. Landmarks are those of its cohort's markups files.

    Raises
    ------
    InputError
        If there is no result, or a file of landmarks or a surface is missing or damaged.
    NumericalError
        If particles of a subject coincide.
    """
    result = read_result(project)
    record = project.read().result
    assert record is not None, "a result that was read has a record"
    files = {one.name: one.landmarks for one in project.cohort().subjects if one.landmarks is not None}
    chosen = [index for index, name in enumerate(result.names) if name in files]
    found = [read_markups(files[result.names[index]]) for index in chosen]
    names, table = landmark_table([(one.names, one.points) for one in found])
    if not names:
        return None
    snap = [snapping(read_mesh(surface_file(project, record.subjects[index].file))) for index in chosen]
    for index, points, near in zip(chosen, table, snap, strict=True):
        name = result.names[index]
        _check_frame(name, files[name], points[np.isfinite(points[:, 0])], near, result.local[index])
    errors = landmark_errors(result.local[chosen], table, snap)
    return LandmarkErrors(names, tuple(result.names[index] for index in chosen), frozen(errors))


def _check_frame(
    name: str, path: Path, points: FloatArray, snap: Callable[[FloatArray], FloatArray], particles: FloatArray
) -> None:
    """Refuse landmarks of another frame or subject, which lie far from the surface."""
    if not len(points):
        return
    gap = float(np.median(np.linalg.norm(snap(points) - points, axis=1)))
    if gap > _FAR * np.sqrt(np.square(particles - particles.mean(axis=0)).sum(axis=1).mean()):
        raise InputError(
            f"{path}: its landmarks lie {gap:.0f} mm from the surface of {name}; give those of this subject, in "
            "its file's frame"
        )


def snapping(mesh: TriangleMesh) -> Callable[[FloatArray], FloatArray]:
    """Return a function that takes points (n, 3) to near ones of a surface, to a fraction of its edges."""
    weights = np.random.default_rng(0).dirichlet(np.ones(3), _SAMPLES)
    points = np.einsum("sk,fkd->fsd", weights, mesh.vertices[mesh.faces]).reshape(-1, 3)
    tree = KDTree(points)
    return lambda wanted: points[np.asarray(tree.query(wanted)[1])]
