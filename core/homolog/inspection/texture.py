"""A pattern on the consensus that particles transfer to every surface; wrong particles distort it."""

import numpy as np
from scipy.interpolate import RBFInterpolator

from homolog.arrays import FloatArray
from homolog.geometry import transform_points
from homolog.inspection.located_particles import LocatedParticles
from homolog.inspection.neighbourhood import Neighbourhood

__all__ = ["carried_places", "checkerboard", "stripes"]

_MOST = 2048
"""Largest number of particles that define a single spline."""
_GUIDES = 60
"""Number of nearest particles that define the spline at a vertex, if there are more particles."""


def carried_places(located: LocatedParticles, consensus: Neighbourhood, subject: int) -> FloatArray:
    """Return the position of each vertex of a subject's mesh on the consensus shape.

    A thin-plate spline through the particles maps the subject to the consensus.

    Parameters
    ----------
    located : LocatedParticles
        Particles of the result, with the meshes.
    consensus : Neighbourhood
        Consensus of all subjects.
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
    """Return bands across the longest axis of the consensus; otherwise like `checkerboard`."""
    sign, gap = _cells(carried, shape, bands)
    return np.asarray(np.clip(0.5 + 0.5 * sign[:, 0] * gap[:, 0] / blur, 0.0, 1.0))


def checkerboard(carried: FloatArray, shape: FloatArray, blur: float, bands: int = 8) -> FloatArray:
    """Return the tones of cubes along the principal axes of the consensus.

    Parameters
    ----------
    carried : (V, 3) array
        Positions on the consensus [mm], from `carried_places`.
    shape : (N, 3) array
        Particles of the consensus [mm].
    blur : float
        Half the width of the transition between tones [mm]: a mesh's edge, so that borders between vertices
        are straight.
    bands : int
        Number of cubes along the longest axis.

    Returns
    -------
    (V,) float64 array
        Tones from 0 to 1, mostly one of these.
    """
    sign, gap = _cells(carried, shape, bands)
    return np.asarray(np.clip(0.5 + 0.5 * sign.prod(axis=1) * gap.min(axis=1) / blur, 0.0, 1.0))


def _cells(located: FloatArray, shape: FloatArray, bands: int) -> tuple[FloatArray, FloatArray]:
    """Return the alternating sign of the band along each principal axis, and the distance to its border."""
    middle = shape.mean(axis=0)
    axes = np.linalg.svd(shape - middle, full_matrices=False)[2]
    width = np.ptp((shape - middle) @ axes[0]) / bands
    along = (located - middle) @ axes.T / width
    whole = np.floor(along)
    return 1.0 - 2.0 * (whole % 2.0), width * (0.5 - np.abs(along - whole - 0.5))
