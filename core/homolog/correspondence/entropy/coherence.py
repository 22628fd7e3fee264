"""Coherence: particles that are neighbours on the mean shape move from it together.

H(Z) sees particles one by one. If the shapes vary in as many ways as there are shapes, it does not tell the
variation of an anatomy, which is smooth at the distance of two particles, from particles that go their own
ways: each shape spreads its particles evenly, in an arrangement of its own, and arrangements drift apart.

So a particle's deviation from the mean shape is compared with the one that its neighbours predict, by
coefficients that reproduce every affine deformation of their tangent plane. The difference R is penalized as
if it were normally distributed, with standard deviation s / sqrt(weight) in every coordinate; s is the radius
of a particle's share of the surface. With weight one this is the width of the Parzen windows of Eq. 1. The
default, four, keeps two standard deviations within the share, where this particle is nearer than any other.

A smooth deformation has R close to zero and costs nothing, whatever its size: unlike a larger weight of H(Z),
the term does not draw particles to places that vary little. It is a thin plate (Bookstein 1989) on a graph.
"""

from typing import Any, TypeAlias

import numpy as np
import warp as wp
from scipy.sparse import csr_array, eye_array
from scipy.spatial import cKDTree

from homolog.arrays import DeviceArray, Float32Array, FloatArray, IntArray
from homolog.correspondence.kernels import coherence as kernels
from homolog.correspondence.kernels.particles import Layout
from homolog.correspondence.launcher import Launcher

__all__ = ["Coherence", "Neighbourhoods", "find_neighbourhoods"]

N_NEIGHBOURS = 8  # six surround a particle of an even layout, and two more one beside a gap
N_CANDIDATES = 4 * N_NEIGHBOURS  # nearest in space, of which those of the other side of a wall are left out
POWER_ITERATIONS = 12  # for the largest eigenvalue, of which a bound from below by a tenth will do

Neighbourhoods: TypeAlias = tuple[IntArray, Float32Array]
"""Neighbours (n, k) of each particle, and the weights (n, k) with which they predict its deviation."""


def find_neighbourhoods(centres: FloatArray, normals: FloatArray) -> Neighbourhoods:
    """Return the neighbours of particles on the mean shape, and their weights.

    Parameters
    ----------
    centres, normals : (n, 3) arrays
        Mean positions and mean unit normals.

    Returns
    -------
    Neighbourhoods
        The nearest particles whose normals do not oppose, and the smallest weights that sum to one and
        reproduce affine functions of the tangent plane. Where the neighbours do not determine these, nearly.
    """
    n = len(centres)
    k = min(N_NEIGHBOURS, n - 1)
    nearest = cKDTree(centres).query(centres, k=min(n, N_CANDIDATES + 1))
    distances, candidates = np.asarray(nearest[0]), np.asarray(nearest[1])
    others = candidates != np.arange(n)[:, None]
    others[others.all(axis=1), -1] = False  # particles in one place: the tree may list others first
    distances = distances[others].reshape(n, -1)
    candidates = candidates[others].reshape(n, -1)
    opposes = np.einsum("nkd,nd->nk", normals[candidates], normals) <= 0.0
    order = np.lexsort((distances, opposes), axis=1)[:, :k]
    neighbours = np.take_along_axis(candidates, order, axis=1)
    offsets = centres[neighbours] - centres[:, None]
    along = offsets - normals[:, None] * np.einsum("nkd,nd->nk", offsets, normals)[..., None]
    reach = np.sqrt(np.square(along).sum(axis=2).mean(axis=1))
    along /= np.maximum(reach, 1e-9)[:, None, None]
    even = np.full(neighbours.shape, 1.0 / k)
    missing = np.einsum("nkd,nk->nd", along, even)
    centred = along - along.mean(axis=1, keepdims=True)  # so that the weights go on summing to one
    moments = np.einsum("nkd,nke->nde", centred, centred) + 1e-3 * k * np.eye(3)
    correction = np.linalg.solve(moments, missing[..., None])[..., 0]
    weights = even - np.einsum("nkd,nd->nk", centred, correction)
    return neighbours.astype(np.int32), weights.astype(np.float32)


class Coherence:
    """The term for all particles of all shapes.

    Attributes
    ----------
    neighbourhoods : Neighbourhoods or None
        On the mean shape, as last found.
    """

    def __init__(self, layout: Layout, free: DeviceArray, launcher: Launcher) -> None:
        self.layout, self.free, self.launch = layout, free, launcher
        self.shapes, self.count = int(layout.shapes), int(layout.per_shape)
        self.neighbourhoods: Neighbourhoods | None = None
        on_device: dict[str, Any] = {"device": launcher.device}
        shape = (self.count, min(N_NEIGHBOURS, self.count - 1))
        self._neighbours: DeviceArray = wp.zeros(shape, dtype=int, **on_device)
        self._weights: DeviceArray = wp.zeros(shape, dtype=float, **on_device)
        self._starts: DeviceArray = wp.zeros(self.count + 1, dtype=int, **on_device)
        self._predicted: DeviceArray = wp.zeros(shape[0] * shape[1], dtype=int, **on_device)
        self._shares: DeviceArray = wp.zeros(shape[0] * shape[1], dtype=float, **on_device)
        self._stiffness: DeviceArray = wp.zeros(1, dtype=float, **on_device)
        self._residuals: DeviceArray = wp.zeros(self.shapes * self.count, dtype=wp.vec3, **on_device)

    def set(self, neighbourhoods: Neighbourhoods) -> None:
        """Use other neighbourhoods from now on."""
        self.neighbourhoods = neighbourhoods
        neighbours, weights = neighbourhoods
        rows = np.repeat(np.arange(self.count), neighbours.shape[1])
        matrix = csr_array((weights.ravel(), (rows, neighbours.ravel())), shape=(self.count,) * 2)
        back = matrix.T.tocsr()
        self._neighbours.assign(neighbours)
        self._weights.assign(weights)
        self._starts.assign(back.indptr.astype(np.int32))
        self._predicted.assign(back.indices.astype(np.int32))
        self._shares.assign(back.data.astype(np.float32))
        self._stiffness.fill_(0.5 * _largest_eigenvalue(matrix))

    def add_gradient(
        self, stage: DeviceArray, iteration: DeviceArray, centred: DeviceArray, ensemble: DeviceArray
    ) -> None:
        """Add the gradient, for aligned positions minus their mean, to that of H(Z)."""
        total = self.shapes * self.count
        given = [self.layout, self._neighbours, self._weights, centred]
        self.launch(kernels.find_residuals, total, [*given, self._residuals])
        given = [self.layout, stage, iteration, self._starts, self._predicted, self._shares]
        self.launch(kernels.add_gradient, total, [*given, self._residuals, ensemble])

    def damp(self, stage: DeviceArray, iteration: DeviceArray, steps: DeviceArray) -> None:
        """Apply the implicit part of the step."""
        self.launch(
            kernels.damp, self.count, [self.layout, stage, iteration, self._stiffness, self.free, steps]
        )

    def roughness(self) -> float:
        """Return half the mean square of R over particles and shapes, of the last iteration."""
        residuals = self._residuals.numpy().astype(np.float64)
        return 0.5 * float(np.square(residuals).sum(axis=1).mean())


def _largest_eigenvalue(matrix: csr_array) -> float:
    """Return nearly the largest eigenvalue of (I - W)' (I - W)."""
    deviation = (eye_array(matrix.shape[0]) - matrix).tocsr()
    back = deviation.T.tocsr()
    vector = np.random.default_rng(0).normal(size=matrix.shape[0])
    value = 1.0
    for _ in range(POWER_ITERATIONS):
        vector = back @ (deviation @ vector)
        value = float(np.linalg.norm(vector))
        vector /= max(value, 1e-30)
    return max(1.0, value)
