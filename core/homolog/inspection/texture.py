"""A pattern on the consensus that particles transfer to every surface; it is torn where they are wrong."""

import numpy as np
from scipy.interpolate import RBFInterpolator

from homolog.arrays import FloatArray
from homolog.geometry import transform_points
from homolog.inspection.located_particles import LocatedParticles
from homolog.inspection.neighbourhood import Neighbourhood

__all__ = ["carried_places", "checkerboard", "stripes"]

_MOST = 2048
"""Largest number of particles that carry the pattern together."""
_GUIDES = 60
"""Of more particles: the number nearest to a vertex that carry it there."""


def carried_places(located: LocatedParticles, consensus: Neighbourhood, subject: int) -> FloatArray:
    """Return the position of each vertex of a subject's mesh on the consensus shape.

    A thin-plate spline through the particles takes the subject to the consensus.

    Parameters
    ----------
    located : LocatedParticles
        Particles of the result, with the meshes.
    consensus : Neighbourhood
        That of all subjects.
    subject : int
        Index of the subject.

    Returns
    -------
    (V, 3) array
        Positions [mm].
    """
    matrix, mesh = located.alignments[subject], located.meshes[subject]
    few = _GUIDES if len(consensus.shape) > _MOST else None
    carry = RBFInterpolator(located.world[subject], consensus.shape, neighbors=few, kernel="linear", degree=1)
    return np.asarray(carry(transform_points(matrix, mesh.vertices)), np.float64)


def stripes(carried: FloatArray, shape: FloatArray, blur: float, bands: int = 8) -> FloatArray:
    """Return bands across the longest axis of the consensus; parameters and result as of `checkerboard`."""
    sign, gap = _cells(carried, shape, bands)
    return np.asarray(np.clip(0.5 + 0.5 * sign[:, 0] * gap[:, 0] / blur, 0.0, 1.0))


def checkerboard(carried: FloatArray, shape: FloatArray, blur: float, bands: int = 8) -> FloatArray:
    """Return the tones of cubes along the principal axes of the consensus.

    Parameters
    ----------
    carried : (V, 3) array
        Places on the consensus [mm], as `carried_places` gives them.
    shape : (N, 3) array
        The consensus.
    blur : float
        Half of the width in which a tone changes into the other [mm]: a mesh's edge, so that borders between
        vertices come out straight.
    bands : int
        Cubes along the longest axis.

    Returns
    -------
    (V,) float64 array
        From 0 to 1, most of them either.
    """
    sign, gap = _cells(carried, shape, bands)
    return np.asarray(np.clip(0.5 + 0.5 * sign.prod(axis=1) * gap.min(axis=1) / blur, 0.0, 1.0))


def _cells(located: FloatArray, shape: FloatArray, bands: int) -> tuple[FloatArray, FloatArray]:
    """Return along each principal axis the sign of the band, in turn, and the distance to its border [mm]."""
    middle = shape.mean(axis=0)
    axes = np.linalg.svd(shape - middle, full_matrices=False)[2]
    width = np.ptp((shape - middle) @ axes[0]) / bands
    along = (located - middle) @ axes.T / width
    whole = np.floor(along)
    return 1.0 - 2.0 * (whole % 2.0), width * (0.5 - np.abs(along - whole - 0.5))
