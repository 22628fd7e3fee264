"""Registration on a GPU: the same as on the CPU, for all shapes at once.

Every point is compared with every vertex, because search trees are slower on a GPU.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from homolog.arrays import DeviceArray, FloatArray, IntArray
from homolog.correspondence.kernels import registration as kernels
from homolog.surfaces.mesh import TriangleMesh

if TYPE_CHECKING:
    from homolog.correspondence.initialization.registration import Registration

__all__ = ["DeviceRegistration", "mean_distances"]


def mean_distances(
    meshes: Sequence[TriangleMesh], candidates: IntArray, samples: int, device: str
) -> FloatArray:
    """Return the mean distances between some shapes and all, both ways, (K, M).

    Parameters
    ----------
    meshes : sequence of TriangleMesh
    candidates : (K,) int array
        Which shapes are compared with all.
    samples : int
        Vertices of each shape that are compared.
    device : str
        Warp device.
    """
    starts, vertices = _joined([mesh.vertices for mesh in meshes], device)
    points = wp.empty((len(meshes), samples), dtype=wp.vec3d, device=device)
    gaps = wp.empty(vertices.size, dtype=wp.float64, device=device)
    wp.launch(kernels.choose_far_points, len(meshes), inputs=[starts, vertices, gaps, points], device=device)
    some, every = (wp.array(rows, dtype=int, device=device) for rows in (candidates, np.arange(len(meshes))))
    result = np.zeros((len(candidates), len(meshes)))
    for of, to in ((every, some), (some, every)):
        distances = wp.empty((of.size, to.size, samples), dtype=wp.float64, device=device)
        inputs = [of, to, points, starts, vertices, distances]
        wp.launch(kernels.nearest_distances, distances.shape, inputs=inputs, device=device)
        means = distances.numpy().mean(axis=2)
        result += means if of is some else means.T
    return result


class DeviceRegistration:
    """A registration whose source is deformed onto many targets at once.

    Parameters
    ----------
    registration : Registration
        With its maps factorized.
    match_width, normal_length : float
        Of its closest points.
    device : str
        Warp device.
    """

    def __init__(
        self, registration: "Registration", *, match_width: float, normal_length: float, device: str
    ) -> None:
        self._device, self._faces = device, registration.source.faces
        self._widths = normal_length, match_width
        incidence = registration.incidence
        indices = (registration.control, incidence.indptr, incidence.indices)
        self._source = [wp.array(item, dtype=wp.int32, device=device) for item in indices]
        self._source.append(wp.array(registration.corners, dtype=wp.vec3i, device=device))
        maps = registration.maps
        self._matrices = [
            wp.array(np.ascontiguousarray(item), dtype=wp.float64, ndim=2, device=device)
            for item in (maps.basis, maps.bending.T, maps.affine.T)
        ]
        self._values = wp.array(maps.values, dtype=wp.float64, device=device)
        self._none = wp.empty(0, dtype=wp.float64, device=device)

    def deform(
        self, targets: Sequence[TriangleMesh], guesses: Sequence[FloatArray], smoothings: Sequence[float]
    ) -> list[TriangleMesh]:
        """Return the source deformed onto each of some targets.

        Parameters
        ----------
        targets : sequence of TriangleMesh
        guesses : sequence of (V, 3) arrays
            The source's vertices, deformed as the first closest points are searched from.
        smoothings : sequence of float
            Of the rounds.
        """
        starts, vertices = _joined([target.vertices for target in targets], self._device)
        _, normals = _joined([target.vertex_normals for target in targets], self._device)
        deformed = wp.array(np.stack(guesses), dtype=wp.vec3d, device=self._device)
        basis, bending, affine = self._matrices
        matched, weights = (
            wp.empty((len(targets), count), dtype=wp.vec3d, device=self._device) for count in basis.shape
        )
        for smoothing in smoothings:
            inputs = [*self._source, deformed, starts, vertices, normals, *self._widths, matched]
            wp.launch(kernels.match_control_points, matched.shape, inputs=inputs, device=self._device)
            self._multiply(basis, matched, weights, divisors=self._values, added=smoothing)
            self._multiply(bending, weights, deformed)
            self._multiply(affine, matched, deformed, keep=1.0)
        return [TriangleMesh(moved, self._faces) for moved in deformed.numpy()]

    def _multiply(
        self,
        transposed: DeviceArray,
        vectors: DeviceArray,
        out: DeviceArray,
        divisors: Any = None,  # noqa: ANN401 - a wp.array
        *,
        added: float = 0.0,
        keep: float = 0.0,
    ) -> None:
        divisors = self._none if divisors is None else divisors
        inputs = [transposed, divisors, added, keep, vectors, out]
        wp.launch(kernels.multiply, out.shape, inputs=inputs, device=self._device)


def _joined(arrays: Sequence[FloatArray], device: str) -> tuple[DeviceArray, DeviceArray]:
    """Return where each of some (n, 3) arrays begins, and all of them one after another."""
    starts = np.concatenate([[0], np.cumsum([len(item) for item in arrays])])
    return (
        wp.array(starts, dtype=wp.int32, device=device),
        wp.array(np.concatenate(arrays), dtype=wp.vec3d, device=device),
    )
