"""Thin-plate splines in three dimensions: warps of points by displacements of centres.

The spline is the interpolant with the smallest bending energy, kernel ``r`` and an affine part (Bookstein
1989; Wahba 1990). It is linear in the target positions: with fixed centres, any warp is a matrix product.
"""

from collections.abc import Callable, Sequence

import numpy as np
from scipy import linalg
from scipy.spatial.distance import cdist

from homolog.arrays import FloatArray, IntArray
from homolog.errors import NumericalError
from homolog.geometry import farthest_point_sampling
from homolog.progress import Tick, no_tick
from homolog.threads import cores, in_threads, on_one_thread

__all__ = [
    "MOST_CENTRES",
    "evaluate_spline",
    "farthest_points",
    "landmark_errors",
    "spline_weights",
    "thin_plate_operator",
    "warp_displacements",
]

MOST_CENTRES = 2048
"""Largest number of centres; of more particles an evenly spread subset is used, since more do not add
accuracy."""

_CHUNK = 1024  # points; their distances from the centres stay in the processor's cache


def thin_plate_operator(
    centres: FloatArray, points: FloatArray, *, smoothing: float | FloatArray = 0.0
) -> FloatArray:
    """Return the matrix that maps target positions of the centres to those of the points.

    Parameters
    ----------
    centres : (N, 3) array
        Particles before the warp [mm]; not all in one plane.
    points : (V, 3) array
        Vertices before the warp [mm].
    smoothing : float or (N,) array
        Smoothing of each centre [mm]: 0 interpolates, larger values trade fidelity for smoothness.

    Returns
    -------
    (V, N) array
        ``operator @ targets`` are the warped points. The operator includes the affine part, so that an affine
        motion of the particles moves the points by exactly the same motion.

    Raises
    ------
    NumericalError
        If two centres coincide or all lie in one plane.
    """
    weights = spline_weights(centres, np.eye(len(centres)), smoothing)
    return evaluate_spline(centres, points, weights)


def warp_displacements(
    centres: FloatArray,
    points: FloatArray,
    displacements: FloatArray,
    smoothing: float | FloatArray = 0.0,
) -> FloatArray:
    """Return the displacements of points for a few displacements of the centres, without the whole operator.

    Parameters
    ----------
    centres : (N, 3) array
        Particles before the warp [mm]; not all in one plane.
    points : (V, 3) array
        Vertices before the warp [mm].
    displacements : (K, N, 3) array
        K displacements of the centres, such as modes [mm].
    smoothing : float or (N,) array
        See `thin_plate_operator`.

    Returns
    -------
    (K, V, 3) array
        Displacements of the points [mm], as by `thin_plate_operator`.

    Raises
    ------
    NumericalError
        If two centres coincide or all lie in one plane.
    """
    columns = displacements.transpose(1, 0, 2).reshape(len(centres), -1)
    moved = evaluate_spline(centres, points, spline_weights(centres, columns, smoothing))
    return moved.reshape(len(points), -1, 3).transpose(1, 0, 2)


def farthest_points(points: FloatArray, most: int) -> IntArray:
    """Return the indices of at most `most` points, chosen by farthest-point sampling."""
    if len(points) <= most:
        return np.arange(len(points))
    return np.sort(farthest_point_sampling(points, most))


def spline_weights(centres: FloatArray, targets: FloatArray, smoothing: float | FloatArray) -> FloatArray:
    """Return weights of the kernel (N rows) and of the affine part (4 rows) for each column of the targets.

    Parameters
    ----------
    centres : (N, 3) array
        Points that the spline passes through [mm].
    targets : (N, c) array
        Values of the spline at the centres, one column for each coordinate.
    smoothing : float or (N,) array
        See `thin_plate_operator` [mm].

    Returns
    -------
    (N + 4, c) array

    Raises
    ------
    NumericalError
        If two centres coincide or all lie in one plane.
    """
    count = len(centres)
    system = np.zeros((count + 4, count + 4))
    # The kernel r is conditionally negative definite, so that smoothing reduces the diagonal.
    system[:count, :count] = cdist(centres, centres) - np.diag(np.broadcast_to(smoothing, count))
    system[:count, count] = system[count, :count] = 1.0
    middle = centres.mean(axis=0)
    system[:count, count + 1 :] = centres - middle
    system[count + 1 :, :count] = (centres - middle).T
    right = np.vstack([targets, np.zeros((4, targets.shape[1]))])
    try:
        weights: FloatArray = linalg.solve(system, right, assume_a="general")
    except (linalg.LinAlgError, linalg.LinAlgWarning) as error:
        raise NumericalError("thin-plate warp: particles coincide or lie in one plane") from error
    return weights


@on_one_thread
def evaluate_spline(
    centres: FloatArray, points: FloatArray, weights: FloatArray, tick: Tick = no_tick
) -> FloatArray:
    """Evaluate a spline at points.

    Parameters
    ----------
    centres : (N, 3) array
        Centres of `spline_weights` [mm].
    points : (V, 3) array
        Points at which the spline is evaluated [mm].
    weights : (N + 4, c) array
        Result of `spline_weights`.
    tick : Tick
        Progress and cancellation.

    Returns
    -------
    (V, c) array
    """
    middle, (bending, affine) = centres.mean(axis=0), np.split(weights, [len(centres)])

    def values(start: int) -> FloatArray:
        part = points[start : start + _CHUNK]
        linear = np.column_stack([np.ones(len(part)), part - middle]) @ affine
        result: FloatArray = cdist(part, centres) @ bending + linear
        return result

    parts, starts = [], range(0, len(points), _CHUNK)
    for start, part in zip(starts, in_threads(values, starts, cores()), strict=True):
        tick(start / len(points), "carrying the surface")
        parts.append(part)
    return np.concatenate(parts)


def landmark_errors(
    particles: FloatArray,
    landmarks: FloatArray,
    snap: Sequence[Callable[[FloatArray], FloatArray]] | None = None,
) -> FloatArray:
    """Return the distances between warped and placed landmarks for each ordered pair of subjects.

    The warp is the thin-plate spline that maps the particles of one subject to those of the other.

    Parameters
    ----------
    particles : (M, N, 3) array
        Corresponding particles, each subject's in its own frame [mm].
    landmarks : (M, L, 3) array
        The same landmarks of each subject, in the frame of its particles [mm]; NaN for landmarks that were
        not placed.
    snap : sequence of M functions, optional
        Functions that map points (L, 3) to the nearest points of a subject's surface.

    Returns
    -------
    (M, M, L) array
        Distances [mm] by source, target and landmark; NaN from a subject to itself and for missing landmarks.

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
