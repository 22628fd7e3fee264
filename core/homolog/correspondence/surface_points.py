"""Nearest points of the surface of one shape, in any pose."""

import threading

import numpy as np
import warp as wp

from homolog.arrays import DeviceArray, FloatArray
from homolog.correspondence.initialization.registration import NORMAL_LENGTH
from homolog.correspondence.kernels import particles as kernels
from homolog.correspondence.kernels.functions import stencil_cache
from homolog.correspondence.launcher import load_kernels
from homolog.geometry import inverse_matrices, rotation_of, transform_points
from homolog.surfaces.closest import closest_faces
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.nearest import NearestPoints

__all__ = ["SurfacePoints"]

_PROJECTIONS, _NEWTON_STEPS = 3, 2


class SurfacePoints:
    """Closest points of one shape's surface, on the wall whose normals agree.

    Parameters
    ----------
    fields, opening_fields : wp.array of FieldData
        Distances and opening angles of the shape, on the CPU.
    mesh : TriangleMesh
        Of the surface, in the optimizer's coordinates.
    carrier : TriangleMesh or None
        On which the points of an open shape lie.
    """

    def __init__(
        self,
        fields: DeviceArray,
        opening_fields: DeviceArray,
        mesh: TriangleMesh,
        carrier: TriangleMesh | None = None,
    ) -> None:
        load_kernels("cpu")  # otherwise each thread would load them
        self._fields, self._opening_fields = fields, opening_fields
        self._vertices, self.area = NearestPoints.of(mesh, NORMAL_LENGTH), mesh.area
        self._carrier = carrier
        self._own = threading.local()  # poses are searched for in several threads

    def nearest(
        self, pose: FloatArray, targets: FloatArray, normals: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the points of the posed surface that are nearest to targets.

        Parameters
        ----------
        pose : (4, 4) array
            Similarity from the optimizer's coordinates.
        targets, normals : (n, 3) arrays
            As posed; normals that the surface should have there.

        Returns
        -------
        points, normals : (n, 3) arrays
            As posed.
        openings : (n,) array
            Weighted opening angles.
        """
        rotation = rotation_of(pose[None])[0]
        goals, directions = transform_points(inverse_matrices(pose), targets), normals @ rotation
        first = self._vertices.nearest(goals, directions)[1]
        points, planes = self._vertices.points[first], self._vertices.normals[first]
        for _ in range(_PROJECTIONS):
            points = goals - np.einsum("ni,ni->n", goals - points, planes)[:, None] * planes
            points, planes, openings = self._projected(points)
        return transform_points(pose, points), planes @ rotation.T, openings

    def _projected(self, points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return points on the surface along the field's gradient, their normals and opening angles."""
        if self._carrier is not None:
            faces, weights = closest_faces(self._carrier, points)
            corners = self._carrier.faces[faces]
            both = (self._carrier.vertices, self._carrier.vertex_normals)
            places, normals = (np.einsum("nk,nkd->nd", weights, values[corners]) for values in both)
            return places, normals / np.linalg.norm(normals, axis=1, keepdims=True), np.zeros(len(points))
        own: _Projection | None = getattr(self._own, "projection", None)
        if own is None or own.count != len(points):
            own = self._own.projection = _Projection(self._fields, self._opening_fields, len(points))
        return own.of(points)


class _Projection:
    """A recorded projection of points, with its arrays: making them anew takes as long as the kernel."""

    def __init__(self, fields: DeviceArray, opening_fields: DeviceArray, count: int) -> None:
        self.count = count
        free = wp.array(np.ones(count), dtype=int, device="cpu")
        caches = [stencil_cache(0, "cpu") for _ in range(2)]
        given = [count, _NEWTON_STEPS, 0, free, fields, opening_fields, *caches]
        kinds = (wp.vec3, wp.vec3, wp.mat33, wp.vec4)
        made = [wp.zeros(count, dtype=kind, device="cpu") for kind in kinds]
        self._arrays = given, made  # a recorded launch only has their addresses
        self._positions, self._normals, _, self._openings = (array.numpy() for array in made)
        self._command = wp.launch(
            kernels.project, dim=count, inputs=[0, *given, *made], device="cpu", record_cmd=True
        )

    def of(self, points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return points (n, 3) on the surface, their normals and weighted opening angles."""
        self._positions[:] = points
        self._command.launch()
        ended = (self._positions, self._normals, self._openings[:, 3])
        return tuple(np.array(item, np.float64) for item in ended)  # type: ignore[return-value]
