"""A shape model of another program, before it is written into a project."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from homolog.arrays import FloatArray
from homolog.errors import InputError
from homolog.geometry import fit_similarity, rms_radius, transform_points
from homolog.io.particles import read_particles
from homolog.statistics.procrustes import align

__all__ = ["ForeignModel", "ForeignSubject", "particles_of", "with_alignments"]

_FARTHEST = 1e6  # mm
_FITS = 1e-3  # tolerance relative to the size: rounding to six digits, but no other transform


@dataclass(frozen=True, slots=True, eq=False)
class ForeignSubject:
    """A subject of a foreign model.

    Attributes
    ----------
    name : str
    local, world : (N, 3) float64 array or None
        Particles [mm] in the frame of the subject's file and in the common one; at least one is given.
    alignment : (4, 4) float64 array or None
        From local to world, if stored by the other program.
    shapes : tuple of Path
        Files that may contain its surface, the best first.
    group : str or None
    columns : mapping of str to str
    landmarks : Path or None
        File with the positions of its landmarks, in the local frame.
    """

    name: str
    local: FloatArray | None
    world: FloatArray | None
    alignment: FloatArray | None = None
    shapes: tuple[Path, ...] = ()
    group: str | None = None
    columns: Mapping[str, str] = field(default_factory=dict)
    landmarks: Path | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ForeignModel:
    """A foreign model: its subjects, source, and known settings of its optimization.

    Attributes
    ----------
    source : str
    subjects : tuple of ForeignSubject
    geodesic, normals : bool or None
        Whether sampling used geodesic distances, and whether normals were used; None if unknown.
    landmark_names : tuple of str
        Names in the order of the lines of the landmark files.
    notes : tuple of str
        Notes for the user.
    """

    source: str
    subjects: tuple[ForeignSubject, ...]
    geodesic: bool | None = None
    normals: bool | None = None
    landmark_names: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def particles_of(path: Path | None) -> FloatArray | None:
    """Read particles, or return None without a path."""
    return None if path is None else read_particles(path)


def with_alignments(
    subjects: tuple[ForeignSubject, ...],
) -> tuple[list[FloatArray], list[FloatArray], FloatArray]:
    """Return local and world particles and the alignments between them; missing ones are computed.

    Raises
    ------
    InputError
        If subjects have different numbers of particles, or a subject's local and world particles differ in
        shape.
    """
    given = [
        (subject.name, points)
        for subject in subjects
        for points in (subject.local, subject.world)
        if points is not None
    ]
    for name, points in given:
        if len(points) != len(given[0][1]):
            raise InputError(
                f"{name}: has {len(points)} particles, and {given[0][0]} has {len(given[0][1])}; import a "
                "model whose particles correspond"
            )
        _check_near(name, points)
    with np.errstate(all="ignore"):  # for invalid matrices
        world = _world(subjects)
    for item, points in zip(subjects, world, strict=True):
        _check_near(item.name, points)
    local = [
        points if subject.local is None else subject.local
        for subject, points in zip(subjects, world, strict=True)
    ]
    alignments = [
        _alignment(subject, near, common)
        for subject, near, common in zip(subjects, local, world, strict=True)
    ]
    return local, world, np.array(alignments)


def _check_near(name: str, points: FloatArray) -> None:
    if not np.abs(points).max() <= _FARTHEST:
        raise InputError(f"{name}: has particles more than a kilometre away; export the model again in mm")


def _world(subjects: tuple[ForeignSubject, ...]) -> list[FloatArray]:
    if all(subject.world is not None or subject.alignment is not None for subject in subjects):
        return [
            transform_points(subject.alignment, subject.local) if subject.world is None else subject.world  # type: ignore[arg-type]
            for subject in subjects
        ]
    if any(subject.local is None for subject in subjects):
        missing = next(subject.name for subject in subjects if subject.local is None)
        raise InputError(f"{missing}: has no local particles, and others no world particles; export both")
    return list(align(np.array([subject.local for subject in subjects]), scaling=False))


def _alignment(subject: ForeignSubject, local: FloatArray, world: FloatArray) -> FloatArray:
    """Return the similarity from local to world: the other program's if consistent, else a fitted one."""
    size = float(rms_radius(world))
    candidates = [] if subject.alignment is None else [subject.alignment]
    fitted = (fit_similarity(local, world, scaling=True, mirrored=mirrored) for mirrored in (False, True))
    for matrix in (*candidates, *fitted):
        matrix[3] = [0.0, 0.0, 0.0, 1.0]
        with np.errstate(all="ignore"):  # for invalid matrices
            fits = np.abs(transform_points(matrix, local) - world).max() <= _FITS * size
        if fits:
            return matrix
    raise InputError(
        f"{subject.name}: its local and world particles differ in shape; export the model again, or "
        "import its world particles alone"
    )
