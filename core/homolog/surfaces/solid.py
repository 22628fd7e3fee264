"""Conversion of any triangles to the boundary of a solid: oriented, without inner walls, with flat caps.

Remaining openings are handled by the winding number (Jacobson, Kavan and Sorkine-Hornung: Robust
Inside-Outside Segmentation using Generalized Winding Numbers, SIGGRAPH 2013; Barill et al.: Fast Winding
Numbers for Soups and Clouds, SIGGRAPH 2018), see `mesh_level`.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from homolog.arrays import BoolArray, FloatArray, IntArray
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.mesh_level import escaping, winding_around
from homolog.surfaces.rims import LOOSE, capped, capped_to_resolution, sides_of
from homolog.surfaces.topology import FLATTEST, face_components

__all__ = ["Solid", "clusters", "oriented", "solid_of", "welded"]

_SAME = (1e-6, 1e-5, 1e-4)
"""Distances within which vertices are welded, relative to the diagonal; the larger ones are for loose
faces."""
_LOST = 0.01
"""Fraction of faces that lose a corner above which the welding distance is too large."""
_SAMPLES = 24
"""Number of faces of a patch from which rays are sent."""
_DIRECTIONS = 16
_PLACES = np.array([[1.0, 1.0, 1.0], [2.4, 0.3, 0.3], [0.3, 2.4, 0.3], [0.3, 0.3, 2.4]]) / 3.0
"""Barycentric coordinates on a face at which its two sides are tested."""
_ASIDE = 0.02
"""Distance of these tests from the face, relative to the mean edge."""
LARGE = 100_000
"""Number of faces; of larger meshes two faces per group are tested, and more where groups differ."""
MOST_TESTED_FACES = 100_000
"""Largest number of faces of a large mesh that are tested individually; others follow their neighbours."""
_CELL = 4.0
"""Edge length of the cells that define groups, in roots of the mean area of a patch's faces."""
_MANY = 3000
"""Largest number of pieces; more are treated as one cluster."""


@dataclass(frozen=True, slots=True, eq=False)
class Solid:
    """Faces that enclose a solid.

    Attributes
    ----------
    mesh : TriangleMesh
        Oriented outward, with the caps; parts may cross each other.
    bounds : (F,) bool array
        Faces with the solid on one side and the outside on the other.
    is_cap : (F,) bool array
        Faces that close an opening.
    is_closed : bool
        Whether every side of a face meets one of another face.
    rims : (R,) float64 array
        Widths of the openings that were closed by flat caps [mm], the widest first.
    openings : (O,) float64 array
        Widths of the openings that remain [mm], the widest first.
    open_length : float
        Total length of the remaining sides with only one face [mm].
    turned, dropped : int
        Numbers of faces that were reversed to agree with their neighbours, and of removed faces (without
        area, or duplicates).
    welded : int
        Number of vertices merged with another one.
    """

    mesh: TriangleMesh
    bounds: BoolArray
    is_cap: BoolArray
    is_closed: bool
    rims: FloatArray
    openings: FloatArray
    open_length: float
    turned: int
    dropped: int
    welded: int


def solid_of(mesh: TriangleMesh) -> Solid:
    """Return the solid of arbitrary triangles.

    Vertices that coincide are welded; faces without area and duplicates are removed. Faces that meet in pairs
    at their sides form consistently oriented patches. Openings with a flat rim are closed by caps. Closed
    patches are oriented to positive volume. From open patches rays are sent to both sides: the side from
    which more rays escape is outside, and a patch from which none escapes is an inner wall. Openings that
    remain are closed where the file's own resolution tells how (`capped_to_resolution`): with whole winding
    numbers, the side of a few nodes tells that of all others.

    Parameters
    ----------
    mesh : TriangleMesh
        Any triangles with finite vertices. The result may have no faces.
    """
    vertices, faces = _welded(mesh.vertices, mesh.faces)
    merged = len(np.unique(mesh.faces)) - len(np.unique(faces))
    faces = _with_area(vertices, faces)
    patches, turned = _patches(faces)
    faces = np.where(turned[:, None], faces[:, ::-1], faces)
    closed = capped(vertices, faces, patches)
    vertices, left = closed.vertices, closed.left
    all_faces, owners = np.concatenate([faces, closed.caps]), np.concatenate([patches, closed.patches])
    for kept, other, is_turned in closed.joined:
        chosen = owners == other
        if is_turned:
            all_faces = np.where(chosen[:, None], all_faces[:, ::-1], all_faces)
            turned ^= chosen[: len(turned)]
        owners[chosen] = kept
        left[left[:, 2] == other, 2] = kept
    every = TriangleMesh(vertices, all_faces)
    sides, unsure = _outsides(every, owners, left)
    about = sides[owners] < 0
    result = np.where(about[:, None], every.faces[:, ::-1], every.faces)
    hidden = sides[owners] == 0
    finished = capped_to_resolution(vertices, result[~hidden])
    is_cap = np.append(np.flatnonzero(~hidden) >= len(faces), np.full(len(finished.caps), True))
    used, numbers = np.unique(np.concatenate([result[~hidden], finished.caps]), return_inverse=True)
    solid = TriangleMesh(finished.vertices[used], numbers.reshape(-1, 3))
    bounds = np.ones(len(solid.faces), dtype=bool)
    if len(solid.faces) and (len(left) or len(sides) > 1):
        bounds = _bounding(solid, np.append(owners[~hidden], np.full(len(finished.caps), len(sides))))
    ends = vertices[finished.left]
    return Solid(
        solid,
        bounds,
        is_cap,
        len(finished.left) == 0,
        np.sort(np.append(closed.widths, finished.widths))[::-1],
        _widths(vertices, finished.left),
        float(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).sum()),
        _count_turned(owners[: len(faces)], turned, unsure & (sides < 0)),
        len(mesh.faces) - len(faces),
        merged,
    )


def welded(mesh: TriangleMesh) -> TriangleMesh:
    """Return a mesh with coinciding vertices merged, without faces that have no area or occur twice."""
    vertices, faces = _welded(mesh.vertices, mesh.faces)
    used, numbers = np.unique(_with_area(vertices, faces), return_inverse=True)
    return TriangleMesh(vertices[used], numbers.reshape(-1, 3))


def oriented(mesh: TriangleMesh) -> tuple[TriangleMesh, int]:
    """Return a mesh whose faces agree with their neighbours, as most do, and the number that were flipped."""
    patches, turned = _patches(mesh.faces)
    most = 2 * np.bincount(patches, turned) > np.bincount(patches)
    turned = turned != most[patches]
    faces = np.where(turned[:, None], mesh.faces[:, ::-1], mesh.faces)
    return TriangleMesh(mesh.vertices, faces), int(np.count_nonzero(turned))


def _widths(vertices: FloatArray, sides: IntArray) -> FloatArray:
    """Return the diagonals of the connected parts of open sides, the longest first."""
    if not len(sides):
        return np.empty(0)
    used, ends = np.unique(sides, return_inverse=True)
    ends = ends.reshape(-1, 2)
    graph = coo_array((np.ones(len(ends), np.int8), tuple(ends.T)), shape=(len(used),) * 2)
    count, labels = connected_components(graph, directed=False)
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, labels, vertices[used])
    np.maximum.at(high, labels, vertices[used])
    sizes: FloatArray = np.sort(np.linalg.norm(high - low, axis=1))[::-1]
    return sizes


def _bounding(mesh: TriangleMesh, patches: IntArray) -> BoolArray:
    """Return which faces have, at least partly, the solid behind them and the outside in front."""
    corners = mesh.vertices[mesh.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)  # caps may have no area
    aside = _ASIDE * mesh.mean_edge * across / lengths
    met = np.ones(len(mesh.vertices), dtype=bool)
    winds_around = winding_around(mesh)

    def bounds(faces: IntArray, place: FloatArray) -> BoolArray:
        points = np.einsum("k,fkd->fd", place, corners[faces])
        is_outer = ~winds_around(points + aside[faces])
        is_outer[is_outer] = winds_around(points[is_outer] - aside[faces[is_outer]])
        return is_outer

    result = np.zeros(len(corners), dtype=bool)
    is_open = np.ones(len(corners), dtype=bool)
    if len(corners) > LARGE:
        groups = _groups(mesh, patches)
        first, last = np.empty((2, int(groups.max()) + 1), np.int64)
        first[groups[::-1]] = np.arange(len(groups))[::-1]
        last[groups] = np.arange(len(groups))
        result = bounds(first, _PLACES[0])[groups]
        is_open = uneven_faces(mesh, groups, result != bounds(last, _PLACES[0])[groups], result)
        result &= ~is_open
        if (every := -(-np.count_nonzero(is_open) // MOST_TESTED_FACES)) > 1:
            sampled = np.flatnonzero(is_open)[::every]
            result[sampled] = bounds(sampled, _PLACES[0])
            return _with_neighbours(mesh, result, is_open, math.ceil(math.sqrt(2.0 * every)))
    for place in _PLACES:
        left = np.flatnonzero(~result & is_open & met[mesh.faces].any(axis=1))
        result[left] = bounds(left, place)
        met[:] = False
        met[mesh.faces[result]] = True  # further points are tested only on neighbours of such faces
    return result


def _with_neighbours(mesh: TriangleMesh, bounding: BoolArray, other: BoolArray, steps: int) -> BoolArray:
    """Return faces together with others within `steps` over shared vertices.

    This is for large meshes with small faces: an additional face next to the boundary changes distances by at
    most a few edges, and no untested face is missing.
    """
    for _ in range(steps):
        met = np.zeros(len(mesh.vertices), dtype=bool)
        met[mesh.faces[bounding]] = True
        bounding = bounding | (other & met[mesh.faces].any(axis=1))
    return bounding


def _groups(mesh: TriangleMesh, patches: IntArray) -> IntArray:
    """Return the group of each face, shape (F,): the faces of a patch in one cell of the patch's grid."""
    middles = mesh.vertices[mesh.faces].mean(axis=1)
    size = np.bincount(patches, mesh.face_areas) / np.maximum(np.bincount(patches), 1)
    cells = np.floor((middles - middles.min(axis=0)) / (_CELL * np.sqrt(size[patches]))[:, None])
    keys = np.column_stack([patches, cells.astype(np.int64)])
    order = np.lexsort(keys.T)
    begins = np.append(False, (np.diff(keys[order], axis=0) != 0).any(axis=1))
    groups = np.empty(len(keys), np.int64)
    groups[order] = np.cumsum(begins)
    return groups


def uneven_faces(mesh: TriangleMesh, groups: IntArray, differs: BoolArray, result: BoolArray) -> BoolArray:
    """Return the faces of groups with different answers, or next to a group with another answer."""
    bounding, other = np.zeros((2, len(mesh.vertices)), dtype=bool)
    bounding[mesh.faces[result]] = True
    other[mesh.faces[~result]] = True
    border = differs | (bounding & other)[mesh.faces].any(axis=1)
    return np.asarray(np.bincount(groups, border)[groups] > 0)


def _count_turned(patches: IntArray, turned: BoolArray, about: BoolArray) -> int:
    """Count faces reversed relative to most of their patch, or in a patch reversed relative to most."""
    size = np.bincount(patches, minlength=len(about))
    other = np.bincount(patches, turned, minlength=len(about)).astype(int)
    whole = int(size[about].sum())
    return int(np.minimum(other, size - other).sum()) + min(whole, len(patches) - whole)


def clusters(mesh: TriangleMesh) -> IntArray:
    """Return the number of the cluster of each face, shape (F,), that of the largest area first.

    Faces that share a vertex, and pieces whose bounding boxes overlap, belong to one cluster.
    """
    pieces = face_components(mesh.faces)
    count = int(pieces.max()) + 1
    if count == 1 or count > _MANY:
        return np.zeros(len(mesh.faces), np.int64)
    corners = mesh.vertices[mesh.faces]
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, pieces, corners.min(axis=1))
    np.maximum.at(high, pieces, corners.max(axis=1))
    slack = 0.5 * mesh.mean_edge
    near = np.ones((count, count), dtype=bool)
    for axis in range(3):
        near &= low[:, None, axis] <= high[None, :, axis] + slack
        near &= high[:, None, axis] + slack >= low[None, :, axis]
    labels = connected_components(near, directed=False)[1]
    areas = np.bincount(labels[pieces], mesh.face_areas)
    rank = np.empty(len(areas), np.int64)
    rank[np.argsort(-areas, kind="stable")] = np.arange(len(areas))
    return np.asarray(rank[labels[pieces]])


def _welded(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    """Merge vertices that nearly coincide, and drop faces that lose a corner.

    If faces hardly share vertices, their corners were rounded separately: the distance is increased until
    they meet, unless this loses faces.
    """
    size = float(np.linalg.norm(np.ptp(vertices[np.unique(faces)], axis=0)))
    tree = KDTree(vertices)
    joined = _merged(tree, faces, _SAME[0] * size)
    for reach in _SAME[1:]:
        if np.mean(sides_of(joined)[2] == 1) <= LOOSE:
            break
        wider = _merged(tree, faces, reach * size)
        if len(wider) < (1.0 - _LOST) * len(joined):
            break
        joined = wider
    return vertices, joined


def _merged(tree: KDTree, faces: IntArray, reach: float) -> IntArray:
    """Return faces with vertices merged within a distance, without faces that lose a corner."""
    pairs = tree.query_pairs(reach, output_type="ndarray")
    if len(pairs):
        graph = coo_array((np.ones(len(pairs), np.int8), tuple(pairs.T)), shape=(tree.n,) * 2)
        labels = connected_components(graph, directed=False)[1]
        faces = np.unique(labels, return_index=True)[1][labels][faces]
    return np.asarray(faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)])


def _with_area(vertices: FloatArray, faces: IntArray) -> IntArray:
    """Remove faces without area, and duplicates."""
    corners = vertices[faces]
    sides = corners - corners[:, [1, 2, 0]]
    longest = (sides**2).sum(axis=2).max(axis=1, initial=0.0)
    doubled = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    faces = faces[doubled > FLATTEST * longest]
    first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)[1]
    return faces[np.sort(first)]


def _patches(faces: IntArray) -> tuple[IntArray, BoolArray]:
    """Return the patch of each face, and which faces to reverse so that patches are consistently oriented.

    Both follow from a graph that contains every face twice, original and reversed: pairs of consistent faces
    connect their equal copies, other pairs their unequal ones. A one-sided patch (a Möbius strip) is split
    into its faces.
    """
    sides, owners, uses = sides_of(faces)
    twice = np.flatnonzero(uses == 2)
    paired = twice[np.lexsort(np.sort(sides[twice], axis=1).T)].reshape(-1, 2)
    a, b = owners[paired].T
    n = len(faces)
    against = (sides[paired[:, 0]] == sides[paired[:, 1]]).all(axis=1)
    starts = np.concatenate([a, a + n])
    ends = np.concatenate([b + n * against, b + n * ~against])
    graph = coo_array((np.ones(len(starts), np.int8), (starts, ends)), shape=(2 * n, 2 * n))
    labels = connected_components(graph, directed=False)[1]
    plain, other = labels[:n], labels[n:]
    patches, turned = np.minimum(plain, other), plain > other
    patches[plain == other] = 2 * n + np.flatnonzero(plain == other)
    return np.unique(patches, return_inverse=True)[1], turned


def _outsides(mesh: TriangleMesh, patches: IntArray, left: IntArray) -> tuple[IntArray, BoolArray]:
    """Return 1 for each patch that faces outward, -1 for one to reverse, 0 for an inner wall.

    Also returns the open patches, from which rays were sent.
    """
    count = int(patches.max(initial=-1)) + 1
    centre = mesh.vertices.mean(axis=0)
    a, b, c = (mesh.vertices[mesh.faces[:, corner]] - centre for corner in range(3))
    volume = np.bincount(patches, np.einsum("ij,ij->i", a, np.cross(b, c)), minlength=count)
    result = np.where(volume < 0.0, -1, 1)
    unsure = np.zeros(count, dtype=bool)
    unsure[left[:, 2]] = True
    _, owners, uses = sides_of(mesh.faces)
    unsure[patches[owners[uses > 2]]] = True
    if not unsure.any():
        return result, unsure
    rng = np.random.default_rng(0)
    weight = rng.random(len(patches)) / np.maximum(mesh.face_areas, 1e-300)
    order = np.lexsort((weight, patches))
    start = np.searchsorted(patches[order], np.arange(count))
    sampled = order[np.arange(len(order)) - start[patches[order]] < _SAMPLES]
    sampled = sampled[unsure[patches[sampled]]]
    ahead, behind = (
        np.bincount(patches[sampled], item, minlength=count) for item in escaping(mesh, sampled, _DIRECTIONS)
    )
    seen = np.where(ahead == behind, np.where(ahead == 0, 0, result), np.sign(ahead - behind))
    return np.where(unsure, seen, result), unsure
