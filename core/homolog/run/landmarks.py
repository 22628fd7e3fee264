"""The subjects' landmarks, as positions of the first particles."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

from homolog.arrays import FloatArray
from homolog.cohort import Cohort
from homolog.correspondence import Shape
from homolog.errors import InputError
from homolog.geometry import rms_radius
from homolog.io.markups import landmark_table, read_markups
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["check_landmarks", "with_landmarks"]

_FAR = 0.25  # largest distance of landmarks from their surface, relative to its size


def with_landmarks(shapes: Sequence[Shape], cohort: Cohort) -> list[Shape]:
    """Return the shapes with the landmarks that exist on all subjects.

    Raises
    ------
    InputError
        If a subject has no landmarks, they are not on its surface, or no landmark exists on all subjects.
    """
    files = {subject.name: subject.landmarks for subject in cohort.subjects if subject.landmarks is not None}
    without = [subject.name for subject in cohort.subjects if subject.name not in files]
    if without:
        raise InputError(
            f"{', '.join(without)}: has no landmarks; place them in 3D Slicer and save them as NAME.mrk.json "
            "next to the file, or run without landmarks"
        )
    _, table = landmark_table([read_markups(files[subject.name]) for subject in cohort.subjects])
    everywhere = np.isfinite(table).all(axis=(0, 2))
    if not everywhere.any():
        raise InputError(
            f"{cohort.folder}: no landmark exists on all subjects; give the same points the same names"
        )
    marked = table[:, everywhere]
    for shape, points in zip(shapes, marked, strict=True):
        check_landmarks(files[shape.name], shape.name, points, shape.mesh)
    return [replace(shape, landmarks=points) for shape, points in zip(shapes, marked, strict=True)]


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
