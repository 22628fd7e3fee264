"""The zero level of a distance field as a mesh of nearly equilateral triangles."""

from bisect import bisect_left

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import KDTree

from homolog.arrays import Array, BoolArray, FloatArray, IntArray
from homolog.errors import InputError, NumericalError
from homolog.geometry import transform_points
from homolog.surfaces.closest import distances_to
from homolog.surfaces.distance_field import DistanceField
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.remesh import Sizes, curvature_sizes, remeshed
from homolog.surfaces.simplify import simplified
from homolog.surfaces.topology import check_mesh, face_components, mesh_fault
from homolog.surfaces.topology import edges as edges_of

__all__ = ["coarse_isosurface", "isosurface", "marching_cubes", "vertex_count", "zero_level"]

VERTICES = 6000
MOST_VERTICES = 250_000
MAX_CROSSED_EDGES = 2_000_000  # largest number of grid edges crossed by the zero level: more take minutes
_EQUILATERAL = 2.0 / np.sqrt(3.0)  # edge² times vertices, over the area
_SLIVER = 0.05  # fraction of the volume of the nodes inside
_NEAREST = 0.01
"""Values closer to zero are moved away [nodes], since vertices on nodes make needle-shaped triangles."""
_TOLERATED = 0.5
"""Largest distance of a mesh from the surface [edges] …"""
_THIN = 0.3
"""… and relative to the local thickness."""
_CHORD = 0.7  # fraction of the chord within the tolerance of a circle
_REFINEMENTS = 2
_FINER = 0.5  # factor of the edges in each refinement where a mesh is too far from the surface
_START = 1.5  # initial number of vertices of the remeshing, relative to the expected one
_GRADING = 0.25  # largest gradient of the edge length [mm/mm]
_STEP = 1.2  # factor of the shortest edges until there are few enough vertices
_MOST_TIMES = 2.0  # largest number of vertices relative to the target
_LEAST = 12  # least number of vertices of a mesh: an icosahedron
_VOLUME = 0.2  # fraction of the source's volume that is lost if triangles are too large for thin parts
_REFERENCES = 20_000  # least number of points at which a mesh is compared with the surface


def isosurface(
    field: DistanceField,
    edge: float | None = None,
    adaptive: bool = False,
    level: TriangleMesh | None = None,
) -> TriangleMesh:
    """Return the zero level of a distance field.

    Triangles are smaller where the surface is thin or pointed, so that the mesh stays close to it.

    Parameters
    ----------
    field : DistanceField
        The distance field; its border is outside.
    edge : float or None
        Target edge length [mm]; about 6000 vertices if None.
    adaptive : bool
        Whether triangles are smaller where the surface is strongly curved, and larger elsewhere.
    level : TriangleMesh or None
        Result of `zero_level`, if it is known.

    Returns
    -------
    TriangleMesh
        Closed, outward oriented manifold of one component.

    Raises
    ------
    InputError
        If the edges are too short for this surface, or the inside consists of thin threads of voxels.
    NumericalError
        If the field has no zero level.
    """
    if field.values.min() >= 0.0:
        raise NumericalError("the shape vanishes in smoothing; use a finer grid or less smoothing")
    raw = level or zero_level(field)
    if len(raw.vertices) > MAX_CROSSED_EDGES:
        least = field.spacing * float(np.sqrt(len(raw.vertices) / MAX_CROSSED_EDGES))
        raise InputError(
            f"has a surface of {len(raw.vertices):,} vertices on its grid, as sponges have; set the grid "
            f"spacing to {least:.3g} mm or more, fill its pores, or exclude it"
        )
    inside = np.count_nonzero(field.values < 0.0) * abs(np.linalg.det(field.index_to_world[:3, :3]))
    if raw.volume < _SLIVER * inside:
        raise InputError("is too thin for its grid; use a finer grid spacing, or exclude it")
    edge = edge or _edge_for(raw.area, VERTICES)
    return _meshed(field, raw, vertex_count(raw.area, edge), edge, adaptive)


def vertex_count(area: float, edge: float | None) -> int:
    """Return the number of vertices on a surface of this area [mm²] with edges of this length [mm].

    Without a length it is that of surface meshes by default.

    Raises
    ------
    InputError
        If there would be too many.
    """
    edge = edge or _edge_for(area, VERTICES)
    count = round(float(_EQUILATERAL * area / edge**2))
    if count > MOST_VERTICES:
        least = _edge_for(area, MOST_VERTICES)
        raise InputError(
            f"mesh edges of {edge:g} mm would make {count} vertices; choose {least:.2g} mm or more"
        )
    return count


def coarse_isosurface(field: DistanceField, mesh: TriangleMesh, n_vertices: int) -> TriangleMesh:
    """Return a coarse mesh of the zero level, made from a finer one.

    It has the topology of the finer mesh, and more vertices where the shape needs them.

    Parameters
    ----------
    field : DistanceField
        Distance field whose zero level is meshed.
    mesh : TriangleMesh
        A finer mesh of the zero level.
    n_vertices : int
        Approximate number of vertices.

    Returns
    -------
    TriangleMesh
    """
    return _meshed(field, mesh, n_vertices, _edge_for(mesh.area, n_vertices))


def _meshed(
    field: DistanceField, source: TriangleMesh, count: int, edge: float, adaptive: bool = False
) -> TriangleMesh:
    """Return a sound mesh of the zero level with the source's topology, finer in thin and curved parts."""
    lighter = simplified(source, max(_REFERENCES, round(_START * _MOST_TIMES * count)))
    references = lighter.vertices
    tree, edges = KDTree(references), _weighted(lighter)
    curvature = field.curvedness(references)
    tolerance = np.minimum(_TOLERATED * edge, _THIN * _thickness(field, references, 4.0 * edge))
    tolerance = np.maximum(tolerance, _TOLERATED * min(field.spacing, edge))
    sizes = curvature_sizes(curvature, edge) if adaptive else np.full(len(references), edge)
    needed = _CHORD * np.sqrt(8.0 * tolerance / np.maximum(curvature, 1e-12))
    wanted, least = sizes, min(edge, field.spacing)

    def graded(shortest: float) -> FloatArray:
        return _graded(wanted, np.maximum(needed, shortest), edges)

    sizes = graded(least)
    if least < edge and _times(edge, sizes) > _MOST_TIMES:
        lengths = least * _STEP ** np.arange(1.0, 1.0 + np.ceil(np.log(edge / least) / np.log(_STEP)))
        first = bisect_left(lengths[:-1], -_MOST_TIMES, key=lambda length: -_times(edge, graded(length)))
        sizes = graded(lengths[first])
    euler, volume = _euler_number(source), source.volume
    expected = count * _times(edge, sizes)
    is_even = bool((sizes > 0.8 * edge).all())
    start = simplified(lighter, count if is_even else round(_START * expected))
    best: TriangleMesh | None = None
    fewest = len(references) + 1
    for _ in range(1 + _REFINEMENTS):
        mesh = remeshed(start, field, _at(tree, sizes))
        far = _far(mesh, field, references, tree, 2.0 * tolerance)
        whole = not mesh_fault(mesh) and _euler_number(mesh) == euler
        near = whole and _is_close(mesh, field, volume)
        if near and (n_far := int(np.count_nonzero(far))) < fewest:
            best, fewest = mesh, n_far
        elif near:
            break  # refinement does not help
        if (near and not far.any()) or len(mesh.vertices) > _MOST_TIMES * count:
            break
        start = lighter
        sizes = _graded(sizes, np.where(far, np.maximum(_FINER * sizes, 0.5 * field.spacing), edge), edges)
    return best or _uneven(source, round(expected), field, volume)


def _times(edge: float, sizes: FloatArray) -> float:
    """Return how many times as many vertices a mesh of these edge lengths has as one of even length."""
    return float(np.mean((edge / sizes) ** 2))


def _euler_number(mesh: TriangleMesh) -> int:
    """Return the Euler number of a closed mesh, which has three edges for two faces."""
    return len(mesh.vertices) - len(mesh.faces) // 2


def _uneven(source: TriangleMesh, count: int, field: DistanceField, volume: float) -> TriangleMesh:
    """Return a simplified source, projected to the zero level where that is sound, or the source itself."""
    fewer = simplified(source, max(count, _LEAST))
    for mesh in (TriangleMesh(field.projected(fewer.vertices), fewer.faces), fewer):
        if not mesh_fault(mesh) and _is_close(mesh, field, volume):
            return mesh
    check_mesh(source, "surface")
    return source


def _is_close(mesh: TriangleMesh, field: DistanceField, volume: float) -> bool:
    """Return whether vertices lie within half a node of the zero level, and the volume is about the same."""
    if abs(mesh.volume - volume) > _VOLUME * volume:
        return False
    return bool(np.abs(field.sample_values(mesh.vertices)).max() < 0.5 * field.spacing)


def _at(tree: KDTree, sizes: FloatArray) -> Sizes:
    """Return a function that returns the sizes at the nearest points of a tree."""
    return lambda points: np.asarray(sizes[tree.query(points)[1]])


def _thickness(field: DistanceField, points: FloatArray, most: float) -> FloatArray:
    """Return the thickness of the solid, or of a gap in it, at points of its surface [mm].

    The distance grows along the normal up to the middle between two walls.
    """
    normals = field.gradients(points)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    steps = np.arange(1.0, 0.5 * most / field.spacing + 1.0) * field.spacing
    result = np.full(len(points), np.inf)
    for side in (-1.0, 1.0):
        depth, growing = np.zeros(len(points)), np.full(len(points), True)
        for step in steps:
            some = np.flatnonzero(growing)
            values = side * field.sample_values(points[some] + side * step * normals[some])
            growing[some] = values > depth[some] + 0.25 * field.spacing
            depth[some] = np.where(growing[some], values, depth[some])
        result = np.where(growing, result, np.minimum(result, 2.0 * np.maximum(depth, 0.5 * field.spacing)))
    return result


def _far(
    mesh: TriangleMesh, field: DistanceField, references: FloatArray, tree: KDTree, tolerance: FloatArray
) -> BoolArray:
    """Return which reference points of the surface are too far from a mesh."""
    far: BoolArray = distances_to(mesh, references) > tolerance
    corners = mesh.vertices[mesh.faces]
    for between in (corners.mean(axis=1), 0.5 * (corners[:, 0] + corners[:, 1])):
        nearest = np.asarray(tree.query(between)[1])
        far[nearest[np.abs(field.sample_values(between)) > tolerance[nearest]]] = True
    return far


def _weighted(mesh: TriangleMesh) -> sparse.coo_array:
    """Return the permitted difference of edge lengths between the ends of a mesh's edges, (V, V) [mm]."""
    ends = edges_of(mesh.faces)
    apart = _GRADING * np.linalg.norm(mesh.vertices[ends[:, 0]] - mesh.vertices[ends[:, 1]], axis=1)
    return sparse.coo_array((apart, tuple(ends.T)), shape=(len(mesh.vertices),) * 2)


def _graded(sizes: FloatArray, needed: FloatArray, edges: sparse.coo_array) -> FloatArray:
    """Return edge lengths that are no larger than needed, and grow slowly around small ones."""
    small = np.flatnonzero(needed < sizes)
    if not len(small):
        return sizes
    # as paths from a vertex of its own, which is as far from each small one as edges are long there
    n = len(sizes)
    lengths = np.concatenate([edges.data, needed[small]])
    starts = np.concatenate([edges.coords[0], np.full(len(small), n)])
    ends = np.concatenate([edges.coords[1], small])
    graph = sparse.coo_array((lengths, (starts, ends)), shape=(n + 1, n + 1)).tocsr().astype(np.float64)
    reached = dijkstra(graph, directed=False, indices=[n], limit=float(sizes.max()))
    graded: FloatArray = np.minimum(sizes, reached[0, :n])
    return graded


def _edge_for(area: float, n_vertices: int) -> float:
    """Return the edge length of equilateral triangles with this number of vertices on a closed surface."""
    return float(np.sqrt(_EQUILATERAL * area / n_vertices))


def zero_level(field: DistanceField) -> TriangleMesh:
    """Return the largest component of a field's zero level, by marching cubes."""
    nodes, faces = marching_cubes(field.values)
    return TriangleMesh(transform_points(field.index_to_world, nodes), faces)


def marching_cubes(values: Array) -> tuple[FloatArray, IntArray]:
    """Return the largest component of the zero level of values on a grid.

    Parameters
    ----------
    values : (I, J, K) array
        Values, negative inside, positive at the border.

    Returns
    -------
    (V, 3) float64 array
        Vertices, in grid indices.
    (F, 3) int array
        Faces, counter-clockwise seen from outside.
    """
    from skimage import measure

    steps = np.diff(values, axis=0)
    least = _NEAREST * max(float(steps.max()), -float(steps.min()))
    close = np.abs(values) < least
    values = values.copy()  # also since scikit-image needs a writable array
    values[close] = np.where(values[close] < 0.0, -least, least)
    vertices, faces, _, _ = measure.marching_cubes(values, 0.0, gradient_direction="descent")
    faces = faces[face_components(faces) == 0]
    used = np.bincount(faces.ravel(), minlength=len(vertices)) > 0
    return vertices[used].astype(np.float64), (np.cumsum(used) - 1)[faces]
