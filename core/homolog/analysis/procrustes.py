"""Generalized Procrustes alignment: position, rotation and, optionally, size removed from particles."""

from enum import StrEnum

import numpy as np

from homolog.arrays import FloatArray
from homolog.geometry import fit_rotation, rms_radius

__all__ = ["Alignment", "align", "aligned", "rms_radii"]


class Alignment(StrEnum):
    """How shapes are aligned before they are compared."""

    AS_IT_LIES = "as-it-lies"
    """As the run left them: position, rotation, size and shape are compared together."""
    RIGID = "rigid"
    """Position and rotation are taken out: size and shape are compared (form)."""
    SIMILARITY = "similarity"
    """Position, rotation and size are taken out: shape alone is compared."""


def aligned(particles: FloatArray, alignment: Alignment) -> FloatArray:
    """Return the particles (M, N, 3) as they are compared [mm]."""
    if alignment is Alignment.AS_IT_LIES:
        return particles
    return align(particles, scaling=alignment is Alignment.SIMILARITY)


def rms_radii(particles: FloatArray) -> FloatArray:
    """Return the root mean square distance of each shape's particles from their centroid [mm].

    This is the centroid size divided by the root of the number of particles.

    Parameters
    ----------
    particles : (M, N, 3) array
        Positions [mm].

    Returns
    -------
    (M,) array
        Sizes [mm].
    """
    return rms_radius(particles)


def align(
    particles: FloatArray, *, scaling: bool, tolerance: float = 1e-10, iterations: int = 100
) -> FloatArray:
    """Return all shapes aligned to their mean (Gower 1975; reflections are not allowed).

    Parameters
    ----------
    particles : (M, N, 3) array
        Positions [mm].
    scaling : bool
        Also bring every shape to the mean size of the cohort.
    tolerance : float
        Ends when the mean moves by less than this part of its size.
    iterations : int
        Largest number of iterations.

    Returns
    -------
    (M, N, 3) array
        Positions [mm]; their mean lies as the mean of the given shapes does.
    """
    place = particles.mean(axis=0)
    middle = place.mean(axis=0)
    shapes = particles - particles.mean(axis=1, keepdims=True)
    size = rms_radii(shapes)
    if scaling:
        shapes = shapes * (size.mean() / size)[:, None, None]
    target = shapes[0]
    for _ in range(iterations):
        shapes = shapes @ _rotations(shapes, target)
        moved = shapes.mean(axis=0)
        change = np.sqrt(np.square(moved - target).sum(axis=1).mean())
        target = moved
        if change < tolerance * size.mean():
            break
    aligned: FloatArray = shapes @ _rotations(target[None], place - middle)[0] + middle
    return aligned


def _rotations(shapes: FloatArray, target: FloatArray) -> FloatArray:
    """Return the rotation that brings each centred shape nearest to the target (Kabsch 1976), (M, 3, 3)."""
    left, right, _ = fit_rotation(np.einsum("mni,nj->mij", shapes, target))
    rotations: FloatArray = left @ right
    return rotations
