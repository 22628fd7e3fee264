"""Particles that have left their surface, or slipped over a rim onto the opposite wall.

No force returns them. If the other shapes agree, they predict the position.
"""

from collections.abc import Callable

import numpy as np
from scipy.spatial import cKDTree

from homolog.arrays import BoolArray, FloatArray, IntArray
from homolog.correspondence.engine import Engine
from homolog.correspondence.initialization.registration import snap_to_mesh
from homolog.errors import InputError
from homolog.geometry import farthest_point_sampling, inverse_matrices, rotation_of, transform_points

__all__ = [
    "MAX_MISPLACED_FRACTION",
    "is_misplaced",
    "predict_positions",
    "relocate",
    "repairs_text",
]

MIN_ANGLE = np.radians(45.0)  # between a misplaced particle's normal and the mean normal
MIN_MEDIAN_RATIO = 3.0  # of that angle to its median over the shapes
MAX_MISPLACED_FRACTION = 0.1  # of a shape's particles; beyond it the whole shape is matched differently
N_NEAR_CONTROL_POINTS = 300  # of the map that predicts positions, around the misplaced particles
N_FAR_CONTROL_POINTS = 100  # and spread over the whole shape


def is_misplaced(angles: FloatArray, medians: FloatArray) -> BoolArray:
    """Return whether angles (..., N) between normals and their means are far beyond their medians (N,)."""
    misplaced: BoolArray = (angles > MIN_ANGLE) & (angles > MIN_MEDIAN_RATIO * medians)
    return misplaced


def repairs_text(repaired: IntArray) -> str:
    """Return how many particles were relocated, for the end of a progress message."""
    count, shapes = np.count_nonzero(repaired), np.count_nonzero(repaired.any(axis=1))
    return f", {count} repaired on {shapes} shape{'s' if shapes > 1 else ''}" if count else ""


def relocate(engine: Engine, misplaced: BoolArray) -> None:
    """Move misplaced particles (M, N) of an engine to the positions that the other shapes predict.

    Not all particles of a shape may be misplaced.
    """
    means = engine.host_means()
    aligned = np.where(misplaced[..., None], 0.0, engine.aligned_positions())  # lost ones may not be finite
    targets = transform_points(
        inverse_matrices(engine.poses), predict_positions(aligned, misplaced, engine.launch.poll_cancel)
    )
    normals = np.einsum("mji,nj->mni", rotation_of(engine.poses), means)
    positions = engine.host_positions().astype(np.float64)
    for k in np.flatnonzero(misplaced.any(axis=1)).tolist():
        engine.launch.poll_cancel()
        moved = misplaced[k]
        positions[k, moved] = snap_to_mesh(targets[k, moved], normals[k, moved], engine.surface_set.meshes[k])
    engine.set_positions(positions)


def predict_positions(
    world: FloatArray, misplaced: BoolArray, poll_cancel: Callable[[], None] = lambda: None
) -> FloatArray:
    """Return the particles with misplaced ones at the positions that the other subjects predict.

    Parameters
    ----------
    world : (M, N, 3) array
        Aligned particles.
    misplaced : (M, N) bool array
        Those to be moved.
    poll_cancel : callable
        Called before each subject; it may raise to stop the work.

    Returns
    -------
    (M, N, 3) array
        The mean of the other subjects, mapped to each subject by a thin-plate map through particles that are
        in place, most of them around the misplaced ones.

    Raises
    ------
    InputError
        If all particles of a subject are misplaced.
    """
    from scipy.interpolate import RBFInterpolator  # slow to import, and rarely needed

    result = world.copy()
    for k in np.flatnonzero(misplaced.any(axis=1)).tolist():
        poll_cancel()
        trusted = ~misplaced
        trusted[k] = False
        trusted[:, ~trusted.any(axis=0)] = True  # misplaced on all other subjects: use them all the same
        trusted[k] = False
        weights = trusted / trusted.sum(axis=0)
        others = np.einsum("mn,mnd->nd", weights, world)
        if misplaced[k].all():
            raise InputError(
                "all particles of one subject are misplaced; fit the subject to the others instead"
            )
        target, source = np.flatnonzero(misplaced[k]), np.flatnonzero(~misplaced[k])
        nearest = np.argsort(cKDTree(others[target]).query(others[source])[0])[:N_NEAR_CONTROL_POINTS]
        far = farthest_point_sampling(others[source], min(N_FAR_CONTROL_POINTS, len(source)))
        control = source[np.union1d(nearest, far)]
        spline = RBFInterpolator(others[control], world[k, control], kernel="linear", degree=1)
        result[k, target] = spline(others[target])
    return result
