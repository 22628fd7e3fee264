"""Near particles of a shape whose exchange lowers the objective, of all shapes at once on one device."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from scipy.spatial import cKDTree

from homolog.arrays import BoolArray, DeviceArray, FloatArray, IntArray
from homolog.correspondence.kernels import exchanges as kernels
from homolog.device import launch_on_cores
from homolog.threads import cores, in_threads

__all__ = ["N_NEIGHBOURS", "PlacedParticles", "Survey", "expected_positions", "promising_pairs"]

N_NEIGHBOURS = int(kernels.N_NEIGHBOURS)
"""Number of particles that predict the position of one between them."""


@dataclass(frozen=True, slots=True, eq=False)
class PlacedParticles:
    """Aligned particles in the places that they have after exchanges.

    Attributes
    ----------
    positions, normals : (M, N, 3) arrays
    openings : (M, N) array
    means : (N, 3) array
        Mean normals of the places.
    """

    positions: FloatArray
    normals: FloatArray
    openings: FloatArray
    means: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Survey:
    """What the changes of an entropy by all pairs have in common: they are quadratic in the step of the rows.

    Attributes
    ----------
    own : (M,) array
        p' C^-1 p of each shape.
    rows, pulled : (N, M, 3) arrays
        Rows, and C^-1 times the rows.
    weight : float
        Of the entropy in the objective, times the factor of the logarithm of the determinant.
    """

    own: FloatArray
    rows: FloatArray
    pulled: FloatArray
    weight: float


def promising_pairs(
    placed: PlacedParticles,
    allowed: BoolArray,
    surveys: Sequence[Survey],
    *,
    divisor: float,
    least: float,
    device: str = "cpu",
) -> list[tuple[int, IntArray]]:
    """Return near pairs whose exchange lowers H(Z) and the objective.

    Parameters
    ----------
    placed : PlacedParticles
    allowed : (M, N) bool array
        Particles that may be exchanged.
    surveys : pair of Survey
        Of H(Z) and H(V).
    divisor : float
        c of C = Y Y' / c.
    least : float
        Smallest gain, summed over all particles.
    device : str
        Warp device.

    Returns
    -------
    list of (int, (P, 2) int array)
        Shapes that have such pairs, ascending, and their pairs in ascending order.
    """
    shapes, count = allowed.shape
    nearest = _nearest(placed.positions, device)
    codes = _codes_of_near(nearest.reshape(shapes, count, -1))
    pairs = np.stack(np.divmod(codes, count), axis=1)
    judged = [_part(survey, pairs, device) for survey in surveys]
    promising = wp.zeros(nearest.shape, dtype=bool, device=device)
    inputs = [
        divisor,
        least,
        wp.array(nearest, dtype=wp.int32, device=device),
        wp.array(allowed.ravel(), dtype=bool, device=device),
        wp.array(codes, dtype=wp.int64, device=device),
        *[_vectors(item, device) for item in (placed.means, placed.positions, placed.normals)],
        wp.array(placed.openings.ravel(), dtype=wp.float64, device=device),
        *judged,
        promising,
    ]
    _launch(kernels.find_promising, shapes * count, inputs, device)
    particle, column = np.nonzero(promising.numpy())
    shape, place = np.divmod(particle, count)
    near = nearest[particle, column]
    chosen = np.unique(np.stack([shape, np.minimum(place, near), np.maximum(place, near)], axis=1), axis=0)
    cuts = np.flatnonzero(np.diff(chosen[:, 0])) + 1
    return [(int(group[0, 0]), group[:, 1:]) for group in np.split(chosen, cuts) if len(group)]


def expected_positions(
    aligned: FloatArray, mean: FloatArray, neighbours: IntArray, device: str = "cpu"
) -> tuple[FloatArray, IntArray]:
    """Return where particles are expected, and the nearest other particle of the shape.

    Parameters
    ----------
    aligned : (M, N, 3) array
        Aligned particles.
    mean : (N, 3) array
        Their means over the shapes.
    neighbours : (N, N_NEIGHBOURS) int array
        Whose median deviation from their means is added to a particle's mean.
    device : str
        Warp device.

    Returns
    -------
    expected : (M, N, 3) array
    nearest : (M, N) int array
    """
    shapes, count = aligned.shape[:2]
    expected = wp.empty(shapes * count, dtype=wp.vec3d, device=device)
    nearest = wp.zeros(shapes * count, dtype=wp.int32, device=device)
    inputs = [wp.array(neighbours, dtype=wp.int32, ndim=2, device=device), _vectors(mean, device)]
    inputs += [_vectors(aligned, device), expected, nearest]
    _launch(kernels.find_expected, shapes * count, inputs, device)
    return expected.numpy().reshape(aligned.shape), nearest.numpy().reshape(shapes, count)


def _nearest(positions: FloatArray, device: str) -> IntArray:
    """Return the nearest particles of each on its shape, (M N, k)."""
    shapes, count = positions.shape[:2]
    most = min(int(kernels.NEAREST), count - 1)
    if device == "cpu":

        def of_shape(points: FloatArray) -> IntArray:
            return np.asarray(cKDTree(points).query(points, k=most + 1)[1])[:, 1:]

        return np.concatenate(list(in_threads(of_shape, positions, cores())))
    chosen = wp.zeros((shapes * count, int(kernels.NEAREST)), dtype=wp.int32, device=device)
    _launch(
        kernels.find_nearest,
        shapes * count,
        [count, _vectors(positions, device), chosen],
        device,
    )
    result: IntArray = chosen.numpy()[:, :most]
    return result


def _codes_of_near(nearest: IntArray) -> IntArray:
    """Return count * smaller + larger index of all pairs that are near on some shape, ascending."""
    count = nearest.shape[1]
    is_near, own = np.zeros((count, count), dtype=bool), np.arange(count)[:, None]
    for near in nearest:
        is_near[np.minimum(own, near), np.maximum(own, near)] = True
    return np.flatnonzero(is_near)


def _part(survey: Survey, pairs: IntArray, device: str) -> Any:  # noqa: ANN401 - a wp.struct has no type
    rows, pulled = (_vectors(item, device).reshape(item.shape[:2]) for item in (survey.rows, survey.pulled))
    alone = np.tile(np.arange(len(survey.rows))[:, None], 2)
    products = []
    for selection in (alone, pairs):
        made = wp.empty(len(selection), dtype=wp.mat33d, device=device)
        given = wp.array(selection, dtype=wp.int32, ndim=2, device=device)
        _launch(kernels.multiply_rows, len(selection), [given, rows, pulled, made], device)
        products.append(made)
    part = kernels.EntropyPart()
    part.own, part.pulled = wp.array(survey.own, dtype=wp.float64, device=device), pulled
    part.alone, part.mixed = products
    part.weight = survey.weight
    return part


def _vectors(array: FloatArray, device: str) -> DeviceArray:
    """Return an array (..., 3) on the device, with one dimension."""
    return wp.array(np.ascontiguousarray(array).reshape(-1, 3), dtype=wp.vec3d, device=device)


def _launch(kernel: Any, count: int, inputs: Sequence[Any], device: str) -> None:  # noqa: ANN401
    if device == "cpu":
        launch_on_cores(kernel, count, inputs)
    else:
        wp.launch(kernel, dim=count, inputs=[0, *inputs], device=device)
