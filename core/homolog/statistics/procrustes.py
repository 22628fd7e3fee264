"""Generalized Procrustes alignment: position, rotation and, optionally, size removed from particles."""

from enum import StrEnum

import numpy as np

from homolog.arrays import FloatArray
from homolog.geometry import fit_rotation, rms_radius

__all__ = ["Alignment", "align", "aligned", "rms_radii", "superimposed"]


class Alignment(StrEnum):
    """How shapes are aligned before they are compared."""

    AS_IT_LIES = "as-it-lies"
    """Not aligned further: position, rotation, size and shape are compared together."""
    FORM = "form"
    """Position and rotation are removed: size and shape are compared (form)."""
    SHAPE = "shape"
    """Position, rotation and size are removed: shape alone is compared."""

    @classmethod
    def _missing_(cls, value: object) -> "Alignment | None":
        """Read what projects and scripts of earlier versions say."""
        return {"rigid": cls.FORM, "similarity": cls.SHAPE}.get(str(value))


def aligned(particles: FloatArray, alignment: Alignment) -> FloatArray:
    """Return the particles (M, N, 3) in the alignment of a comparison [mm]."""
    if alignment is Alignment.AS_IT_LIES:
        return particles
    return align(particles, scaling=alignment is Alignment.SHAPE)


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
        Whether to scale every shape to the mean size of the cohort.
    tolerance : float
        Iterations end when the mean moves by less than this fraction of its size.
    iterations : int
        Largest number of iterations.

    Returns
    -------
    (M, N, 3) array
        Positions [mm]; their mean has the pose of the mean of the given shapes.
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


def superimposed(shapes: FloatArray, mean: FloatArray, size: float) -> FloatArray:
    """Return shapes (..., N, 3) at one size, aligned to a mean (N, 3) as `align` does [mm]."""
    flat = shapes.reshape(-1, *mean.shape)
    centred = flat - flat.mean(axis=1, keepdims=True)
    scaled = centred * (size / rms_radii(centred))[:, None, None]
    middle = mean.mean(axis=0)
    aligned: FloatArray = scaled @ _rotations(scaled, mean - middle) + middle
    return aligned.reshape(shapes.shape)


def _rotations(shapes: FloatArray, target: FloatArray) -> FloatArray:
    """Return the rotations that best align each centred shape with the target (Kabsch 1976), (M, 3, 3)."""
    left, right, _ = fit_rotation(np.einsum("mni,nj->mij", shapes, target))
    rotations: FloatArray = left @ right
    return rotations
