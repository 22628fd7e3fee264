"""Detection and relocation of misplaced particles: on the wrong wall of a shape, or swapped with another.

No force returns a particle that has slipped over a rim onto the opposite wall. If the other shapes agree,
they predict its position.
"""

from collections.abc import Callable

import numpy as np
from scipy.spatial import cKDTree

from homolog.arrays import BoolArray, FloatArray, IntArray
from homolog.correspondence.engine import Engine
from homolog.correspondence.exchanges import EnsembleRows, Exchanges
from homolog.correspondence.initialization.registration import features, snap_to_mesh
from homolog.correspondence.near_pairs import N_NEIGHBOURS, expected_positions
from homolog.correspondence.schedule import Weights
from homolog.errors import InputError
from homolog.geometry import farthest_point_sampling, inverse_matrices, rotation_of, transform_points
from homolog.threads import blas_threads

__all__ = [
    "MAX_MISPLACED_FRACTION",
    "exchange",
    "find_misplaced",
    "find_swapped",
    "is_misplaced",
    "predict_positions",
    "relocate",
    "relocate_misplaced",
    "repairs_text",
]

MIN_ANGLE = np.radians(45.0)  # between a misplaced particle's normal and the mean normal
MIN_MEDIAN_RATIO = 3.0  # of that angle to its median over the shapes
MIN_SHAPES = 3  # with fewer, none of them is the exception
MANY_SHAPES = 2000  # whose matrices are inverted sooner on several threads
MAX_MISPLACED_FRACTION = 0.1  # of a shape's particles; beyond it the whole shape is matched differently
# Two particles are swapped if an exchange reduces the sum of their errors, and each error, to these ratios.
MAX_PAIR_ERROR_RATIO, MAX_ERROR_RATIO = 0.5, 0.8
N_NEAR_CONTROL_POINTS = 300  # of the map that predicts positions, around the misplaced particles
N_FAR_CONTROL_POINTS = 100  # and spread over the whole shape


def find_misplaced(normals: FloatArray, means: FloatArray) -> BoolArray:
    """Return the particles whose normal disagrees with that on most shapes, (M, N).

    Parameters
    ----------
    normals : (M, N, 3) array
        Aligned unit normals.
    means : (N, 3) array
        Their Fréchet means over the shapes.
    """
    angles = np.arccos(np.clip(np.einsum("mnd,nd->mn", normals, means), -1.0, 1.0))
    misplaced = is_misplaced(angles, np.median(angles, axis=0))
    misplaced[misplaced.mean(axis=1) > MAX_MISPLACED_FRACTION] = False
    return misplaced & (len(normals) >= MIN_SHAPES)


def is_misplaced(angles: FloatArray, medians: FloatArray) -> BoolArray:
    """Return whether angles (..., N) between normals and their means are far beyond their medians (N,)."""
    misplaced: BoolArray = (angles > MIN_ANGLE) & (angles > MIN_MEDIAN_RATIO * medians)
    return misplaced


def relocate_misplaced(engine: Engine, allowed: BoolArray) -> BoolArray:
    """Move an engine's misplaced particles to their predicted positions; return which moved, (M, N).

    Parameters
    ----------
    engine : Engine
    allowed : (M, N) bool array
        Particles that may be moved.
    """
    aligned, normals, means = engine.aligned_positions(), engine.aligned_normals(), engine.host_means()
    misplaced = find_misplaced(normals, means) & allowed
    partners = find_swapped(aligned, means, engine.launch.device)
    swapped = (partners != np.arange(aligned.shape[1])) & allowed & ~misplaced
    swapped &= np.take_along_axis(swapped, partners, axis=1)
    if swapped.any():
        order = np.where(swapped, partners, np.arange(aligned.shape[1]))
        engine.set_positions(
            np.take_along_axis(engine.host_positions().astype(np.float64), order[..., None], axis=1)
        )
    if misplaced.any():
        relocate(engine, misplaced)
    moved: BoolArray = misplaced | swapped
    return moved


def exchange(engine: Engine, weights: Weights, allowed: BoolArray) -> BoolArray:
    """Exchange particles of a shape where that lowers the objective; return which, (M, N).

    Parameters
    ----------
    engine : Engine
    weights : Weights
        Of the objective.
    allowed : (M, N) or (M, 1) bool array
        Particles that may be exchanged.
    """
    rows = EnsembleRows(
        engine.aligned_positions(),
        engine.aligned_normals(),
        engine.host_means(),
        engine.host_openings(),
        (weights.ensemble, weights.normals),
    )
    with blas_threads(len(allowed), MANY_SHAPES):
        exchanges = Exchanges(rows)
        if len(allowed) >= MIN_SHAPES:
            movable = np.broadcast_to(allowed, exchanges.order.shape)
            exchanges.make_all(movable, engine.launch.poll_cancel, engine.launch.device)
    moved: BoolArray = exchanges.order != np.arange(exchanges.order.shape[1])
    if moved.any():
        positions = engine.host_positions().astype(np.float64)
        engine.set_positions(np.take_along_axis(positions, exchanges.order[..., None], axis=1))
    return moved


def repairs_text(repaired: IntArray) -> str:
    """Return how many particles were relocated or exchanged, for the end of a progress message."""
    count, shapes = np.count_nonzero(repaired), np.count_nonzero(repaired.any(axis=1))
    return f", {count} repaired on {shapes} shape{'s' if shapes > 1 else ''}" if count else ""


def find_swapped(aligned: FloatArray, means: FloatArray, device: str = "cpu") -> IntArray:
    """Return for each particle the one it is swapped with, or itself, (M, N).

    The expected position of a particle is its mean over the shapes plus the median deviation of its
    neighbours. Two particles are swapped if they lie much closer to each other's expected position than to
    their own.

    Parameters
    ----------
    aligned : (M, N, 3) array
        Particles in the coordinates in which they are compared.
    means : (N, 3) array
        Mean unit normals.
    device : str
        Warp device that finds the expected positions.
    """
    n_shapes, count = aligned.shape[:2]
    partners = np.tile(np.arange(count), (n_shapes, 1))
    if n_shapes < MIN_SHAPES or count <= N_NEIGHBOURS + 2:
        return partners
    mean = aligned.mean(axis=0)
    neighbours = np.asarray(
        cKDTree(features(mean, means)).query(features(mean, means), k=N_NEIGHBOURS + 1)[1]
    )[:, 1:]

    expected, nearest = expected_positions(aligned, mean, neighbours, device)
    own = np.arange(count)
    is_mutual = (np.take_along_axis(nearest, nearest, axis=1) == own) & (own < nearest)
    k, i = np.nonzero(is_mutual)
    j = nearest[k, i]

    def distances(of: IntArray, to: IntArray) -> FloatArray:
        return np.asarray(np.linalg.norm(aligned[k, of] - expected[k, to], axis=1))

    error_i, error_j, other_i, other_j = distances(i, i), distances(j, j), distances(j, i), distances(i, j)
    is_swap = other_i + other_j < MAX_PAIR_ERROR_RATIO * (error_i + error_j)
    is_swap &= (other_i < MAX_ERROR_RATIO * error_i) & (other_j < MAX_ERROR_RATIO * error_j)
    k, i, j = k[is_swap], i[is_swap], j[is_swap]
    partners[k, i], partners[k, j] = j, i
    return partners


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
