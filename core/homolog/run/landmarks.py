"""The subjects' landmarks: positions of the first particles, and errors of the correspondence."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

from homolog.arrays import FloatArray, frozen
from homolog.cluster import each_read
from homolog.cohort import Cohort
from homolog.correspondence import Shape
from homolog.errors import InputError
from homolog.geometry import rms_radius
from homolog.io.markups import Markups, landmark_table, read_markups
from homolog.io.meshes import read_mesh
from homolog.io.project import ProjectFolder
from homolog.io.results import read_result, surface_file
from homolog.progress import no_tick
from homolog.statistics.thin_plate import landmark_errors
from homolog.surfaces.closest import closest_points
from homolog.surfaces.mesh import TriangleMesh

__all__ = [
    "LandmarkErrors",
    "check_landmarks",
    "project_landmark_errors",
    "with_landmarks",
    "with_landmarks_of_structures",
]

NOTHING_KNOWN: Mapping[str, Markups] = {}
_FAR = 0.25  # largest distance of landmarks from their surface, relative to its size


def with_landmarks(
    shapes: Sequence[Shape], cohort: Cohort, known: Mapping[str, Markups] = NOTHING_KNOWN
) -> list[Shape]:
    """Return the shapes with the landmarks that exist on all subjects.

    Those that are `known`, by subject, are not read again.

    Raises
    ------
    InputError
        If a subject has no landmarks, they are not on its surface, or no landmark exists on all subjects.
    """
    files, table = _table(cohort, known)
    everywhere = np.isfinite(table).all(axis=(0, 2))
    if not everywhere.any():
        raise _no_common(cohort)
    marked = table[:, everywhere]
    for shape, points in zip(shapes, marked, strict=True):
        check_landmarks(files[shape.name], shape.name, points, shape.mesh)
    return [replace(shape, landmarks=points) for shape, points in zip(shapes, marked, strict=True)]


def with_landmarks_of_structures(
    structures: Mapping[str, Sequence[Shape]], cohort: Cohort, known: Mapping[str, Markups] = NOTHING_KNOWN
) -> dict[str, list[Shape]]:
    """Return the shapes of several structures with the landmarks that exist on all subjects of a structure.

    A landmark belongs to the structure that is nearest to it on most subjects.

    Raises
    ------
    InputError
        See `with_landmarks`.
    """
    files, table = _table(cohort, known)
    row = {subject.name: number for number, subject in enumerate(cohort.subjects)}
    gaps = np.full((len(structures), *table.shape[:2]), np.inf)
    for own, shapes in zip(gaps, structures.values(), strict=True):
        for shape in shapes:
            points = table[row[shape.name]]
            there = np.isfinite(points).all(axis=1)
            own[row[shape.name], there] = KDTree(shape.mesh.vertices).query(points[there])[0]
    votes = (gaps.argmin(axis=0) == np.arange(len(structures))[:, None, None]) & np.isfinite(table).all(
        axis=2
    )
    owner = votes.sum(axis=1).argmax(axis=0)  # (L,)
    result = {}
    for number, (name, shapes) in enumerate(structures.items()):
        marked = table[[row[shape.name] for shape in shapes]]
        own = marked[:, (owner == number) & np.isfinite(marked).all(axis=(0, 2))]
        for shape, points in zip(shapes, own, strict=True):
            if len(points):
                check_landmarks(files[shape.name], shape.name, points, shape.mesh)
        result[name] = [
            replace(shape, landmarks=points if len(points) else None)
            for shape, points in zip(shapes, own, strict=True)
        ]
    if all(shape.landmarks is None for shapes in result.values() for shape in shapes):
        raise _no_common(cohort)
    return result


def _no_common(cohort: Cohort) -> InputError:
    return InputError(
        f"{cohort.folder}: no landmark exists on all subjects; give the same points the same names"
    )


def _read(files: Mapping[str, Path]) -> dict[str, Markups]:
    """Read subjects' landmarks in workers."""
    return {
        name: future.result() for name, future in each_read(read_markups, files, files, "reading", no_tick)
    }


def _table(cohort: Cohort, known: Mapping[str, Markups]) -> tuple[dict[str, Path], FloatArray]:
    """Return the files of the subjects' landmarks, and these as (M, L, 3), NaN where one is missing."""
    files = {subject.name: subject.landmarks for subject in cohort.subjects if subject.landmarks is not None}
    without = [subject.name for subject in cohort.subjects if subject.name not in files]
    if without:
        raise InputError(
            f"{', '.join(without)}: has no landmarks; place them in 3D Slicer and save them as NAME.mrk.json "
            "next to the file, or run without landmarks"
        )
    markups = {**known, **_read({name: file for name, file in files.items() if name not in known})}
    return files, landmark_table([markups[subject.name] for subject in cohort.subjects])[1]


def check_landmarks(path: Path, name: str, points: FloatArray, mesh: TriangleMesh) -> None:
    """Refuse landmarks (n, 3) of another frame or subject: most lie far from the subject's surface.

    Parameters
    ----------
    path : Path
        File of the landmarks, for messages.
    name : str
        Name of the subject.
    points : (n, 3) array
        The landmarks [mm].
    mesh : TriangleMesh
        The subject's surface [mm].

    Raises
    ------
    InputError
        With the file, the subject and the distance.
    """
    gap = float(np.median(KDTree(mesh.vertices).query(points)[0]))
    size = rms_radius(mesh.vertices)
    if gap > _FAR * size:
        raise InputError(
            f"{path}: its landmarks lie {gap:.0f} mm from the surface of {name}; use landmarks of this "
            "subject, in the frame of its file"
        )


@dataclass(frozen=True, slots=True, eq=False)
class LandmarkErrors:
    """Errors of landmarks that are transferred between subjects by the correspondence.

    Attributes
    ----------
    names : tuple of str
        The L landmarks that exist on two or more subjects.
    subjects : tuple of str
        The subjects with landmarks.
    errors : (M, M, L) array
        Distances [mm] by source, target and landmark; NaN for missing landmarks.
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


def project_landmark_errors(project: ProjectFolder) -> LandmarkErrors | None:
    """Transfer every subject's landmarks to all others; None if fewer than two subjects share any.

    Parameters
    ----------
    project : ProjectFolder
        A project with a result. Landmarks are read from the markups files of its cohort.

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
    files = {
        subject.name: subject.landmarks
        for subject in project.cohort().subjects
        if subject.landmarks is not None
    }
    chosen = [index for index, name in enumerate(result.names) if name in files]
    markups = _read({result.names[index]: files[result.names[index]] for index in chosen})
    names, table = landmark_table([markups[result.names[index]] for index in chosen])
    if not names:
        return None
    meshes = [read_mesh(surface_file(project, record.subjects[index].file)) for index in chosen]
    for index, points, mesh in zip(chosen, table, meshes, strict=True):
        if len(placed := points[np.isfinite(points[:, 0])]):
            check_landmarks(files[result.names[index]], result.names[index], placed, mesh)
    snap = [partial(closest_points, mesh) for mesh in meshes]
    errors = landmark_errors(result.local[chosen], table, snap)
    return LandmarkErrors(names, tuple(result.names[index] for index in chosen), frozen(errors))
