"""Landmarks carried from subject to subject by the correspondence, and how far they miss."""

from collections.abc import Callable, Sequence

import numpy as np

from homolog.analysis.thin_plate import MOST_CENTRES, farthest_points, thin_plate_operator
from homolog.arrays import FloatArray

__all__ = ["landmark_errors"]


def landmark_errors(
    particles: FloatArray,
    landmarks: FloatArray,
    snap: Sequence[Callable[[FloatArray], FloatArray]] | None = None,
) -> FloatArray:
    """Return how far each landmark of each subject, carried to each other subject, is from that one's own.

    A landmark is carried by the thin-plate spline that takes the one subject's particles to the other's.

    Parameters
    ----------
    particles : (M, N, 3) array
        Corresponding particles, each subject's in its own frame [mm].
    landmarks : (M, L, 3) array
        The same landmarks of each subject, in the frame of its particles [mm]; NaN where one was not placed.
    snap : sequence of M functions, optional
        Take points (L, 3) to the nearest ones of the subject's surface.

    Returns
    -------
    (M, M, L) array
        Distances [mm] by source, target and landmark; NaN from a subject to itself and where one is missing.

    Raises
    ------
    NumericalError
        If particles of a subject coincide or lie in one plane.
    """
    count = len(particles)
    errors = np.full((count, *landmarks.shape[:2]), np.nan)
    centres = farthest_points(particles.mean(axis=0), MOST_CENTRES)
    for source in range(count):
        placed = np.isfinite(landmarks[source]).all(axis=1)
        if not placed.any():
            continue
        operator = thin_plate_operator(particles[source, centres], landmarks[source, placed])
        for target in range(count):
            if target == source:
                continue
            carried = operator @ particles[target, centres]
            if snap is not None:
                carried = snap[target](carried)
            gaps = np.linalg.norm(carried - landmarks[target, placed], axis=1)
            errors[source, target, placed] = gaps
    return errors
