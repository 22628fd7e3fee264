"""Subjects that occur twice: the same surface under two names, also if it was moved."""

from collections.abc import Iterator, Sequence
from hashlib import sha256

import numpy as np

from homolog.arrays import FloatArray
from homolog.grooming.subject import GroomedSubject
from homolog.registration.icp import candidates, gap, oriented_points

__all__ = ["twins"]

_SURELY = 3.0
"""Standard deviations of the sampling's error within which two measures are equal."""


def twins(groomed: Sequence[GroomedSubject]) -> dict[str, str]:
    """Return notes, by name, on each subject whose surface is that of an earlier one, identical or moved.

    A moved shape that is sampled anew keeps volume and moments up to the error of the sampling: each of the N
    cells at its surface is filled by a fraction, uniformly distributed, that is rounded (standard deviation
    ``sqrt(N / 12)`` cells). Those that are equal so far are registered. Two samplings of one surface have a
    mean distance of ``h / 3``, that of two numbers which are uniform within ``h / 2`` of the truth.
    """
    notes: dict[str, str] = {}
    first: dict[bytes, GroomedSubject] = {}
    for subject in groomed:
        mesh = subject.mesh
        key = sha256(mesh.vertices.tobytes() + mesh.faces.tobytes()).digest()
        twin = first.setdefault(key, subject)
        if twin is not subject:
            notes[subject.name] = (
                f"its surface is identical to that of {twin.name}; exclude one of them, or correct its file"
            )
    for twin, subject in _alike(list(first.values())):
        if subject.name not in notes and _are_one(twin, subject):
            notes[subject.name] = (
                f"its surface is that of {twin.name} in another place, as far as the sampling tells; exclude "
                "one of them, or correct its file"
            )
    return notes


def _alike(subjects: Sequence[GroomedSubject]) -> Iterator[tuple[GroomedSubject, GroomedSubject]]:
    """Yield pairs of closed shapes whose volumes and moments differ by the sampling's error at most."""
    closed = [subject for subject in subjects if not subject.report.rims]
    if not closed:
        return
    values, errors = (np.array(item) for item in zip(*map(_measures, closed), strict=True))
    order = np.argsort(values[:, 0], kind="stable")
    for place, index in enumerate(order):
        later = order[place + 1 :]
        most = values[index, 0] + _SURELY * np.hypot(errors[index, 0], errors[:, 0].max())
        later = later[: np.searchsorted(values[later, 0], most, side="right")]
        near = np.abs(values[later] - values[index]) <= _SURELY * np.hypot(errors[later], errors[index])
        for other in later[near.all(axis=1)]:
            yield closed[min(index, other)], closed[max(index, other)]


def _measures(subject: GroomedSubject) -> tuple[FloatArray, FloatArray]:
    """Return integrals over a solid that its pose does not change, and their standard errors.

    They are the volume, the principal second moments, and those of ``x |x|^2`` (its length) and ``|x|^4``
    about the centre [mm^3 to mm^7]. That of a function of degree k is ``3 / (k + 3)`` times the sum of its
    mean on each face times the volume of the face's tetrahedron.
    """
    corners = subject.mesh.vertices[subject.mesh.faces]
    corners = corners - corners.mean(axis=(0, 1))
    volumes = np.einsum("fi,fi->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0
    centre = volumes @ corners.sum(axis=1) / (4.0 * volumes.sum())
    between = (corners + np.roll(corners, 1, axis=1)) / 2.0 - centre  # means over these are exact to degree 2
    volumes = volumes - np.einsum("i,fi->f", centre, _normals(corners)) / 3.0
    squares = (between**2).sum(axis=2)
    second = np.einsum("f,fpi,fpj->ij", volumes, between, between) / 5.0
    third = np.einsum("f,fp,fpi->i", volumes, squares, between) / 6.0
    moments, axes = np.linalg.eigh(second)
    values = (volumes.sum(), *moments, np.linalg.norm(third), volumes @ (squares**2).mean(axis=1) * 3.0 / 7.0)
    cell = float(np.prod(_cell(subject)))
    along = ((between @ axes) ** 4).mean(axis=1)
    powers = np.column_stack(
        [np.ones(len(along)), along, (squares**3).mean(axis=1), (squares**4).mean(axis=1)]
    )
    areas = np.linalg.norm(_normals(corners), axis=1)
    return np.array(values), cell ** (2.0 / 3.0) * np.sqrt(areas @ powers / 12.0)


def _normals(corners: FloatArray) -> FloatArray:
    """Return normals of faces, as long as their areas."""
    normals: FloatArray = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2.0
    return normals


def _cell(subject: GroomedSubject) -> tuple[float, ...]:
    """Return the edges of what samples a shape [mm]: the voxels of its image, its grid, or its triangles."""
    edge = subject.mesh.mean_edge if subject.field is None else subject.field.spacing
    return subject.report.voxel or (edge,) * 3


def _are_one(first: GroomedSubject, second: GroomedSubject) -> bool:
    """Return whether two shapes are as near, once registered, as two samplings of one."""
    fixed, moving = oriented_points(first.coarse_mesh), oriented_points(second.coarse_mesh)
    size = fixed.size
    fixed, moving = fixed.scaled(1.0 / size), moving.scaled(1.0 / size)
    nearest = min(gap(moving, fixed, fit.pose) for fit in candidates(moving, fixed))
    return size * nearest <= max(*_cell(first), *_cell(second)) / 3.0
