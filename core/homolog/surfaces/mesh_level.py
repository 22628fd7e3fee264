"""A mesh as a level function on a grid, and winding numbers and rays."""

from collections.abc import Callable

import numpy as np
import warp as wp
from scipy import ndimage

from homolog.arrays import Array, BoolArray, Float32Array, FloatArray, IntArray
from homolog.device import choose_device
from homolog.surfaces.kernels import distances as kernels
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.topology import without_cavities

__all__ = ["BETWEEN", "REACH", "escaping", "mesh_level", "mesh_sides", "winding_around"]

REACH = 2.5
"""Range of exact distances from the mesh [nodes]."""
_BLOCK = 4
"""Edge length of the blocks that are tested or skipped as a whole [nodes]."""
BETWEEN = 1.001
"""Sum of the distances of two neighbours above which no face lies between them [nodes]."""
_COARSE = 3
"""Spacing of the nodes whose side is determined first, far from the mesh [nodes]."""
_UNITS = 1000.0
"""Length of a mesh's diagonal in the kernels' coordinates, suitable for single precision."""


def mesh_level(
    mesh: TriangleMesh,
    start: FloatArray,
    spacing: float,
    shape: tuple[int, ...],
    *,
    bounds: BoolArray | None = None,
    is_closed: bool = True,
) -> Float32Array:
    """Return the signed distance to a mesh on an axis-aligned grid, near the mesh.

    Parameters
    ----------
    mesh : TriangleMesh
        Faces counter-clockwise seen from outside; parts may overlap.
    start : (3,) array
        Position of the first node [mm, LPS].
    spacing : float
        Distance between nodes [mm].
    shape : tuple of int
        Number of nodes along each axis; the border is outside.
    bounds : (F,) bool array, optional
        Faces to which distances are computed, by default all. All faces contribute to winding numbers.
    is_closed : bool
        Whether the side of nodes changes only at those faces. Otherwise the side of every node near them is
        computed.

    Returns
    -------
    (I, J, K) float32 array
        Distance [nodes], negative inside, exact up to `REACH` and clipped there.
    """
    # For single precision, coordinates are nodes from the first one.
    with wp.ScopedDevice(choose_device("cpu")):
        surface = _surface(mesh, start, spacing)
        is_part = bounds is not None and not bounds.all()
        part = (
            _surface(TriangleMesh(mesh.vertices, mesh.faces[bounds]), start, spacing) if is_part else surface
        )
        values = _distances(part, shape)
        if is_closed:
            return np.where(_sides(surface, values), -values, values)
        near = np.argwhere(values < REACH)
        inside = np.zeros(shape, dtype=bool)
        inside[tuple(near.T)] = _are_inside(surface, near)
    values[inside] *= -1.0
    values[without_cavities(inside) & (values == REACH)] = -REACH
    return values


def _distances(surface: wp.Mesh, shape: tuple[int, ...]) -> Float32Array:
    """Return the distances of nodes from a mesh, at most `REACH`; only blocks near it are computed."""
    result = np.full(shape, REACH, np.float32)
    blocks = np.argwhere(np.ones([-(-count // _BLOCK) for count in shape], dtype=bool))
    middles = wp.array((_BLOCK * blocks + 0.5 * (_BLOCK - 1)).astype(np.float32), dtype=wp.vec3)
    apart = wp.empty(len(blocks), dtype=wp.float32)
    reach = REACH + 0.5 * (_BLOCK - 1) * np.sqrt(3.0)
    wp.launch(kernels.distances_within, len(blocks), [surface.id, middles, float(reach), apart])
    near = blocks[apart.numpy() < reach]
    corners = wp.array((_BLOCK * near).astype(np.int32), dtype=wp.vec3i)
    values = wp.array(result, device="cpu", copy=False)
    wp.launch(
        kernels.distances_of_blocks, (len(near), _BLOCK**3), [surface.id, corners, _BLOCK, REACH, values]
    )
    return result


def _sides(surface: wp.Mesh, distances: Float32Array) -> BoolArray:
    """Return which nodes are inside a closed mesh, from their distances to it.

    Two neighbours whose distances sum to more than one node are on the same side, as no face lies between
    them. One test thus suffices for each patch of nodes at least a node away; most other nodes have such a
    neighbour.
    """
    patches, count = ndimage.label(distances >= 1.0)
    owners = patches.ravel()
    first = np.empty(count + 1, np.int64)
    first[owners[::-1]] = np.arange(len(owners))[::-1]
    sides = np.zeros(count + 1, np.int8)
    sides[1:] = np.where(
        _are_inside(surface, np.stack(np.unravel_index(first[1:], distances.shape), axis=1)), -1, 1
    )
    result, flat = sides[owners], distances.ravel()
    left = np.flatnonzero(owners == 0)
    steps = [distances.shape[1] * distances.shape[2], distances.shape[2], 1]
    before = len(left) + 1
    while 0 < len(left) < before:
        before = len(left)
        adopted = np.zeros(before, np.int8)
        for step in (*steps, *(-step for step in steps)):
            neighbour = np.clip(left + step, 0, len(flat) - 1)
            adopted = np.where(
                (adopted == 0) & (flat[left] + flat[neighbour] > BETWEEN), result[neighbour], adopted
            )
        result[left] = adopted
        left = left[adopted == 0]
    places = np.stack(np.unravel_index(left, distances.shape), axis=1)
    result[left] = np.where(_are_inside(surface, places), -1, 1)
    return np.asarray((result < 0).reshape(distances.shape))


def mesh_sides(mesh: TriangleMesh, start: FloatArray, spacing: float, near: Float32Array) -> BoolArray:
    """Return the nodes of a grid at which the winding number of an open mesh is at least 1/2.

    Parameters
    ----------
    mesh : TriangleMesh
        Faces counter-clockwise seen from outside.
    start, spacing :
        See `mesh_level`.
    near : (I, J, K) float32 array
        Result of `mesh_level`, whose signs are used next to the mesh.

    Returns
    -------
    (I, J, K) bool array
        True inside. Away from the mesh the side is computed at every third node along each axis, and at the
        nodes between only where these differ.
    """
    inside: BoolArray = near < 0.0
    far = np.abs(near) >= REACH
    within = tuple(map(slice, near.shape))
    ends = [np.arange(0, size + _COARSE - 1, _COARSE) for size in near.shape]
    nodes = np.stack(np.meshgrid(*ends, indexing="ij"), axis=-1)
    with wp.ScopedDevice(choose_device("cpu")):
        surface = _surface(mesh, start, spacing)
        sides = _are_inside(surface, nodes.reshape(-1, 3)).reshape(nodes.shape[:3])
        low, high = (
            find(sides, 2, origin=-1).repeat(_COARSE, 0).repeat(_COARSE, 1).repeat(_COARSE, 2)[within]
            for find in (ndimage.minimum_filter, ndimage.maximum_filter)
        )
        inside[far] = low[far]
        mixed = np.argwhere(far & (low != high))
        inside[tuple(mixed.T)] = _are_inside(surface, mixed)
    return without_cavities(inside)


def winding_around(mesh: TriangleMesh) -> Callable[[FloatArray], BoolArray]:
    """Return a function: whether a mesh's winding number at points (N, 3) is at least 1/2, shape (N,)."""
    low, scale = _unit(mesh)
    with wp.ScopedDevice(choose_device("cpu")):
        surface = _surface(mesh, low, scale)

    def winds_around(points: FloatArray) -> BoolArray:
        with wp.ScopedDevice(choose_device("cpu")):
            return _are_inside(surface, (points - low) / scale)

    return winds_around


def _unit(mesh: TriangleMesh) -> tuple[FloatArray, float]:
    """Return an origin [mm] and a unit of length [mm] suitable for a mesh in single precision."""
    return mesh.vertices.min(axis=0), float(np.linalg.norm(np.ptp(mesh.vertices, axis=0))) / _UNITS


def escaping(mesh: TriangleMesh, faces: IntArray, n_directions: int) -> tuple[IntArray, IntArray]:
    """Return the numbers of rays that leave the mesh from the front and from the back of some faces.

    Parameters
    ----------
    mesh : TriangleMesh
        Any triangles.
    faces : (N,) int array
        Indices of the faces at which rays start.
    n_directions : int
        Number of rays per face, spread evenly over the sphere.

    Returns
    -------
    (N,), (N,) int32 arrays
        Numbers of rays that meet no face, on the side of the normal and on the other side.
    """
    low, scale = _unit(mesh)
    corners = mesh.vertices[mesh.faces[faces]]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = across / np.linalg.norm(across, axis=1, keepdims=True)
    # a Fibonacci lattice on the sphere
    heights = 1.0 - (2.0 * np.arange(n_directions) + 1.0) / n_directions
    turns = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(n_directions)
    wide = np.sqrt(1.0 - heights**2)
    ways = np.stack([wide * np.cos(turns), wide * np.sin(turns), heights], axis=1)
    with wp.ScopedDevice(choose_device("cpu")):
        surface = _surface(mesh, low, scale)
        given = ((corners.mean(axis=1) - low) / scale, normals, ways)
        vectors = [wp.array(item.astype(np.float32), dtype=wp.vec3) for item in given]
        counts = [wp.zeros(len(faces), dtype=wp.int32) for _ in range(2)]
        wp.launch(kernels.count_escaping, len(faces), [surface.id, *vectors, 1e-3, *counts])
        ahead, behind = (np.array(count.numpy()) for count in counts)
    return ahead, behind


def _surface(mesh: TriangleMesh, start: FloatArray, spacing: float) -> wp.Mesh:
    """Return a mesh for queries, in coordinates with this origin and unit of length."""
    points = ((mesh.vertices - start) / spacing).astype(np.float32)
    return wp.Mesh(
        points=wp.array(points, dtype=wp.vec3),
        indices=wp.array(mesh.faces.ravel(), dtype=wp.int32),
        support_winding_number=True,
    )


def _are_inside(surface: wp.Mesh, nodes: Array) -> BoolArray:
    """Return whether nodes (N, 3) are inside a mesh."""
    points = wp.array(nodes.astype(np.float32), dtype=wp.vec3)
    inside = wp.zeros(len(nodes), dtype=wp.bool)
    wp.launch(kernels.find_sides, len(nodes), [surface.id, points, inside])
    return np.array(inside.numpy(), dtype=bool)
