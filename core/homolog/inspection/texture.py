"""A pattern on the consensus, carried by the particles to every surface; it tears where they are wrong."""

import numpy as np
from scipy.interpolate import RBFInterpolator

from homolog.arrays import FloatArray, IntArray
from homolog.inspection.neighbourhood import Neighbourhood
from homolog.inspection.places import Places

__all__ = ["carried_places", "checkerboard", "stripes"]

_MOST = 2048
"""Particles that carry the pattern together; of more only …"""
_GUIDES = 60
"""… so many, those nearest to a vertex."""


def carried_places(places: Places, usual: Neighbourhood, subject: int) -> FloatArray:
    """Return where each vertex of a subject's mesh lies on the consensus shape, (V, 3) [mm].

    A thin-plate spline through the particles takes the subject to the consensus.
    """
    matrix, mesh = places.alignments[subject], places.meshes[subject]
    few = _GUIDES if len(usual.shape) > _MOST else None
    carry = RBFInterpolator(places.world[subject], usual.shape, neighbors=few, kernel="linear", degree=1)
    return np.asarray(carry(mesh.vertices @ matrix[:3, :3].T + matrix[:3, 3]), np.float64)


def stripes(carried: FloatArray, shape: FloatArray, bands: int = 8) -> IntArray:
    """Return bands 0, 1, 0, … across the longest axis of the consensus, (V,), for places on it (V, 3)."""
    along = _along(carried, shape)[:, 0]
    return np.floor(bands * along).astype(np.int64) % 2


def checkerboard(carried: FloatArray, shape: FloatArray, bands: int = 8) -> IntArray:
    """Return the fields 0 and 1 of cubes along the axes of the consensus, (V,), for places on it (V, 3)."""
    along = _along(carried, shape)
    fields: IntArray = np.floor(bands * along).astype(np.int64).sum(axis=1) % 2
    return fields


def _along(places: FloatArray, shape: FloatArray) -> FloatArray:
    """Return coordinates along the principal axes, in lengths of the longest."""
    middle = shape.mean(axis=0)
    axes = np.linalg.svd(shape - middle, full_matrices=False)[2]
    extent = np.ptp((shape - middle) @ axes[0])
    return np.asarray((places - middle) @ axes.T / extent)
