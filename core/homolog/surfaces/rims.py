"""Openings of a mesh with a flat rim, and the faces that close them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Delaunay, KDTree, QhullError

from homolog.arrays import BoolArray, FloatArray, IntArray
from homolog.surfaces.loops import loops

__all__ = ["LOOSE", "SEAM", "Capped", "Finished", "capped", "capped_to_resolution", "coinciding", "sides_of"]

_FLAT = 0.05
"""Largest distance of a flat rim from its plane, relative to its width, if that is more than a side of it.

Faces that were deleted on one side of a plane leave a rim within a side's length of it.
"""
_PARALLEL = 0.98
"""Least cosine between the normals of nested rims in one plane."""
_CRACK = 1e-4
"""Least area of an opening relative to the squared length of its rim; a smaller one is a crack."""
_GAP = 1e-3
"""Largest distance of an open side from a coinciding one, relative to its length."""
SEAM = 0.9
"""Least share of a rim's sides that coincide with others, if it is a seam between unconnected faces."""
LOOSE = 0.1
"""Least share of open sides in a soup of loose faces."""
_NEIGHBOURS = 12
_FEW = 4
"""Number of faces per side of the rim; patches with fewer may be as flat as the rim."""


@dataclass(frozen=True, slots=True, eq=False)
class _Rim:
    """A flat opening: sides (n, 2), their patch, centre, normal, width; whether a fan of faces closes it."""

    sides: IntArray
    patch: int
    middle: FloatArray
    normal: FloatArray
    width: float
    is_fan: bool


@dataclass(frozen=True, slots=True, eq=False)
class Capped:
    """Faces that close flat openings, and what remains open.

    Attributes
    ----------
    vertices : (V', 3) float64 array
        The vertices, and one at the centre of each cap.
    caps, patches : (C, 3), (C,) int arrays
        Faces of the caps, and the patch of each.
    widths : (R,) float64 array
        Widths of the rims that were closed, without seams at which two patches meet.
    left : (B, 3) int array
        The sides that remain open, and the patch of each, without cracks.
    joined : list of (int, int, bool)
        Patches joined by a ring, and whether the second must be reversed; it then is a part of the first.
    """

    vertices: FloatArray
    caps: IntArray
    patches: IntArray
    widths: FloatArray
    left: IntArray
    joined: list[tuple[int, int, bool]]


def capped(vertices: FloatArray, faces: IntArray, patches: IntArray) -> Capped:
    """Close the openings with a flat rim; nested rims, as of a cut shell, by a ring."""
    rims, left = _rims(vertices, faces, patches)
    middles: list[FloatArray] = []
    caps: list[IntArray] = [np.empty((0, 3), np.int64)]
    cap_patches = [np.empty(0, np.int64)]
    joined: list[tuple[int, int, bool]] = []
    alias: dict[int, int] = {}
    outer = _outer_rims(vertices, rims)
    for index in np.flatnonzero(outer < 0).tolist():
        rim, holes = rims[index], [rims[hole] for hole in np.flatnonzero(outer == index)]
        if holes:
            ring = np.concatenate([rim.sides, *(hole.sides for hole in holes)])
            caps.append(_filled(vertices, ring, rim.normal))
            for hole in holes:
                whole, part = alias.get(rim.patch, rim.patch), alias.get(hole.patch, hole.patch)
                if whole != part:
                    joined.append((whole, part, bool(hole.normal @ rim.normal > 0.0)))
                    alias = {patch: whole if end == part else end for patch, end in alias.items()}
                    alias[part] = whole
        elif not rim.is_fan and (filled := _closing(vertices, rim)) is not None:
            caps.append(filled)
        else:
            number = len(vertices) + len(middles)
            middles.append(rim.middle)
            caps.append(np.column_stack([rim.sides[:, ::-1], np.full(len(rim.sides), number)]))
        cap_patches.append(np.full(len(caps[-1]), rim.patch))
    return Capped(
        np.concatenate([vertices, np.reshape(middles, (-1, 3))]),
        np.concatenate(caps),
        np.concatenate(cap_patches),
        _widths(vertices, rims),
        left[~coinciding(vertices, left[:, :2])],
        joined,
    )


@dataclass(frozen=True, slots=True, eq=False)
class Finished:
    """Faces that close small openings of oriented faces, and what remains open.

    Attributes
    ----------
    vertices : (V', 3) float64 array
        The vertices, and one at the centre of each cap.
    caps : (C, 3) int array
        Faces of the caps.
    widths : (R,) float64 array
        Widths of the openings that were closed [mm].
    left : (B, 2) int array
        The sides that remain open, without cracks.
    """

    vertices: FloatArray
    caps: IntArray
    widths: FloatArray
    left: IntArray


def capped_to_resolution(vertices: FloatArray, faces: IntArray) -> Finished:
    """Close openings whose rim leaves its plane by at most half of its sides: the file tells nothing finer.

    Openings are those that winding numbers see: sides that more faces run along in one direction than in the
    other. They form loops also where three faces or more meet at an edge. The loop of a face that meets no
    other is closed as well, so that the face no longer counts. Nothing is closed if a tenth of all sides are
    open: such faces are loose, and bound a solid only together.

    Parameters
    ----------
    vertices : (V, 3) array
        Positions [mm].
    faces : (F, 3) int array
        Oriented faces.

    Returns
    -------
    Finished
    """
    sides = _net_sides(faces, len(vertices))
    middles: list[FloatArray] = []
    caps: list[IntArray] = [np.empty((0, 3), np.int64)]
    left: list[IntArray] = [np.empty((0, 2), np.int64)]
    widths: list[float] = []
    if len(sides) > LOOSE * faces.size:
        left.append(sides)
    elif len(sides):
        ordered = np.sort(faces, axis=1)
        loose = set(map(tuple, ordered[np.isin(ordered, sides).all(axis=1)].tolist()))
        for chosen in loops(sides, np.zeros(len(sides), np.int64)):
            rim = sides[chosen]
            if _is_crack(vertices, rim):
                continue
            if (np.roll(rim[:, 0], -1) != rim[:, 1]).any() or not _is_flat_to_resolution(vertices[rim]):
                left.append(rim)
                continue
            number = len(vertices) + len(middles)
            middles.append(vertices[rim[:, 0]].mean(axis=0))
            caps.append(np.column_stack([rim[:, ::-1], np.full(len(rim), number)]))
            if tuple(sorted(rim[:, 0].tolist())) not in loose:
                widths.append(2.0 * float(np.linalg.norm(vertices[rim[:, 0]] - middles[-1], axis=1).max()))
    remaining = np.concatenate(left)
    return Finished(
        np.concatenate([vertices, np.reshape(middles, (-1, 3))]),
        np.concatenate(caps),
        np.array(widths),
        remaining[~coinciding(vertices, remaining)],
    )


def _is_flat_to_resolution(ends: FloatArray) -> bool:
    """Return whether a loop of sides (N, 2, 3) leaves its plane by at most half a side's length in it."""
    arms = ends - ends[:, 0].mean(axis=0)
    axes = np.linalg.svd(arms[:, 0], full_matrices=False)[2]
    along = np.linalg.norm((arms[:, 1] - arms[:, 0]) @ axes[:2].T, axis=1)
    return bool(np.abs(arms[:, 0] @ axes[2]).max() <= 0.5 * np.median(along))


def _net_sides(faces: IntArray, n_vertices: int) -> IntArray:
    """Return the boundary of oriented faces: directed sides, as often as they outnumber opposite ones."""
    sides = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).astype(np.int64)
    ordered = np.sort(sides, axis=1)
    keys, same = np.unique(ordered[:, 0] * n_vertices + ordered[:, 1], return_inverse=True)
    excess = np.bincount(same, np.where(sides[:, 0] == ordered[:, 0], 1, -1), len(keys)).astype(np.int64)
    keys, excess = keys[excess != 0], excess[excess != 0]
    ends = np.column_stack([keys // n_vertices, keys % n_vertices])
    return np.repeat(np.where(excess[:, None] > 0, ends, ends[:, ::-1]), np.abs(excess), axis=0)


def _rims(vertices: FloatArray, faces: IntArray, patches: IntArray) -> tuple[list[_Rim], IntArray]:
    """Return the flat openings, and the sides of all others with their patches (B, 3)."""
    sides, owners, uses = sides_of(faces)
    edge = sides[uses == 1]
    patch = patches[owners[uses == 1]]
    if not len(edge):
        return [], np.empty((0, 3), np.int64)
    graph = coo_array((np.ones(len(edge), np.int8), tuple(edge.T)), shape=(len(vertices),) * 2)
    rim_of = connected_components(graph, directed=False)[1][edge[:, 0]]
    leaving = np.bincount(edge[:, 0], minlength=len(vertices))
    arriving = np.bincount(edge[:, 1], minlength=len(vertices))
    is_simple = (leaving[edge] == 1) & (arriving[edge] == 1)
    members = np.argsort(patches, kind="stable")
    first = np.searchsorted(patches[members], np.arange(int(patches.max()) + 2))
    rims, left = [], [np.empty((0, 3), np.int64)]
    order = np.argsort(rim_of, kind="stable")
    for border in np.split(order, np.flatnonzero(np.diff(rim_of[order])) + 1):
        is_loop = bool(is_simple[border].all() and (patch[border] == patch[border[0]]).all())
        for own in [np.arange(len(border))] if is_loop else loops(edge[border], patch[border]):
            chosen = border[own]
            sides, owner = edge[chosen], int(patch[chosen[0]])
            if _is_crack(vertices, sides):
                continue
            rim = None
            if is_loop or (np.roll(sides[:, 0], -1) == sides[:, 1]).all():
                whole = members[first[owner] : first[owner + 1]]
                rim = _flat_rim(vertices, sides, faces, whole, owner)
            if rim is not None:
                rims.append(rim)
            else:
                left.append(np.column_stack([sides, patch[chosen]]))
    return rims, np.concatenate(left)


def _is_crack(vertices: FloatArray, rim: IntArray) -> bool:
    """Return whether an opening hardly has an area."""
    spokes = vertices[rim] - vertices[rim[:, 0]].mean(axis=0)
    length = float(np.linalg.norm(spokes[:, 0] - spokes[:, 1], axis=1).sum())
    across = np.cross(spokes[:, 1], spokes[:, 0])
    return bool(0.5 * np.linalg.norm(across, axis=1).sum() <= _CRACK * length**2)


def _flat_rim(vertices: FloatArray, rim: IntArray, faces: IntArray, own: IntArray, patch: int) -> _Rim | None:
    """Return a loop of sides as an opening, if it is flat and its patch's own faces are not in its plane."""
    middle = vertices[rim[:, 0]].mean(axis=0)
    spokes = vertices[rim] - middle
    across = np.cross(spokes[:, 1], spokes[:, 0])
    area = 0.5 * float(np.linalg.norm(across.sum(axis=0)))
    normal = across.sum(axis=0) / max(2.0 * area, 1e-300)
    width = 2.0 * float(np.linalg.norm(spokes[:, 0], axis=1).max())
    off = float(np.abs(spokes[:, 0] @ normal).max())
    lengths = np.linalg.norm(spokes[:, 0] - spokes[:, 1], axis=1)
    is_flat = off <= max(_FLAT * width, float(np.median(lengths)))
    if is_flat and len(own) <= _FEW * len(rim):
        is_flat = bool(np.abs((vertices[faces[own]] - middle) @ normal).max() > _FLAT * width)
    return _Rim(rim, patch, middle, normal, width, bool((across @ normal > 0.0).all())) if is_flat else None


def _outer_rims(vertices: FloatArray, rims: Sequence[_Rim]) -> IntArray:
    """Return for each rim the index of the rim in its plane in which it is a hole, or -1."""
    if not rims:
        return np.empty(0, np.int64)
    middles, normals = (np.array([getattr(rim, name) for rim in rims]) for name in ("middle", "normal"))
    widths = np.array([rim.width for rim in rims])
    off = np.abs(((middles - middles[:, None]) * normals[:, None]).sum(axis=2))
    around = (widths < widths[:, None]) & (off <= _FLAT * widths) & (np.abs(normals @ normals.T) > _PARALLEL)
    for index, other in np.argwhere(around):
        plane = _plane(normals[index])
        inner = vertices[rims[other].sides[:, 0]] @ plane
        around[index, other] = _within(inner, vertices[rims[index].sides] @ plane).all()
    nearest = np.argmin(np.where(around, widths[:, None], np.inf), axis=0)
    return np.where(around.sum(axis=0) % 2 == 1, nearest, -1)


def coinciding(vertices: FloatArray, sides: IntArray) -> BoolArray:
    """Return which open sides coincide with others, as at T-junctions."""
    if not len(sides):
        return np.zeros(0, dtype=bool)
    a, b = vertices[sides[:, 0]], vertices[sides[:, 1]]
    middle, along = 0.5 * (a + b), b - a
    length = np.linalg.norm(along, axis=1)
    tree = KDTree(middle)
    covered = np.zeros(len(sides), dtype=bool)
    near = tree.query(middle, k=min(_NEIGHBOURS, len(sides)), distance_upper_bound=float(length.max()))[1]
    for other in near.reshape(len(sides), -1).T:
        is_there = (other < len(sides)) & (other != np.arange(len(sides)))
        other = np.where(is_there, other, 0)
        share = ((middle - a[other]) * along[other]).sum(axis=1) / np.maximum(length[other] ** 2, 1e-300)
        gap = np.linalg.norm(a[other] + np.clip(share, 0.0, 1.0)[:, None] * along[other] - middle, axis=1)
        covered |= is_there & (gap <= _GAP * np.minimum(length, length[other]))
    return covered


def _widths(vertices: FloatArray, rims: Sequence[_Rim]) -> FloatArray:
    """Return the widths of rims, without those that coincide with others: seams with T-junctions."""
    if not rims:
        return np.empty(0)
    covered = coinciding(vertices, np.concatenate([rim.sides for rim in rims]))
    owners = np.repeat(np.arange(len(rims)), [len(rim.sides) for rim in rims])
    is_seam = np.bincount(owners, covered) >= SEAM * np.bincount(owners)
    return np.array([rim.width for rim in rims])[~is_seam]


def _plane(normal: FloatArray) -> FloatArray:
    """Return two directions (3, 2) orthogonal to a normal."""
    first = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    return np.stack([first, np.cross(normal, first)], axis=1)


def _within(points: FloatArray, ends: FloatArray) -> BoolArray:
    """Return which points (P, 2) lie in the region whose border has these sides (S, 2, 2)."""
    order = np.argsort(points[:, 1])
    (ax, ay), (bx, by) = ends[:, 0].T, ends[:, 1].T
    first, last = (np.searchsorted(points[order, 1], find(ay, by)) for find in (np.minimum, np.maximum))
    counts = last - first  # of the points at the heights of each side
    sides = np.repeat(np.arange(len(ends)), counts)
    near = order[np.arange(len(sides)) + np.repeat(first - np.cumsum(counts) + counts, counts)]
    x, y = points[near].T
    at = ax[sides] + (y - ay[sides]) / (by - ay)[sides] * (bx - ax)[sides]
    return np.asarray(np.bincount(near[at > x], minlength=len(points)) % 2 == 1)


def _filled(vertices: FloatArray, rim: IntArray, normal: FloatArray) -> IntArray:
    """Triangulate a flat opening that a fan can't close, or a ring: Delaunay triangles within the rim."""
    plane = _plane(normal)
    names = rim[:, 0]
    flat = vertices[names] @ plane
    try:
        triangles = Delaunay(flat).simplices
    except QhullError:
        return np.empty((0, 3), np.int64)
    triangles = triangles[_within(flat[triangles].mean(axis=1), vertices[rim] @ plane)]
    sides = np.diff(flat[triangles], axis=1)
    wrong = sides[:, 0, 0] * sides[:, 1, 1] < sides[:, 0, 1] * sides[:, 1, 0]
    return np.asarray(names[np.where(wrong[:, None], triangles[:, ::-1], triangles)])


def _closing(vertices: FloatArray, rim: _Rim) -> IntArray | None:
    """Return the triangles within a single rim: Delaunay's, or if they cross its sides, its ears; or None."""
    triangles = _filled(vertices, rim.sides, rim.normal)
    if _is_border(triangles, rim.sides):
        return triangles
    loop = rim.sides[loops(rim.sides, np.zeros(len(rim.sides), np.int64))[0], 0][::-1]
    ears = _ears(vertices[loop] @ _plane(rim.normal))
    return None if ears is None else loop[ears]


def _is_border(triangles: IntArray, rim: IntArray) -> bool:
    """Return whether triangles meet a mesh at all sides of a rim, and are open nowhere else."""
    size = int(max(triangles.max(initial=0), rim.max())) + 1
    sides = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    there, back = sides[:, 0] * size + sides[:, 1], sides[:, 1] * size + sides[:, 0]
    open_sides = there[~np.isin(there, back)]
    return np.array_equal(np.sort(open_sides), np.sort(rim[:, 1] * size + rim[:, 0]))


def _ears(points: FloatArray) -> IntArray | None:
    """Triangulate a polygon (n, 2) that runs counter-clockwise by cutting ears; None if it crosses itself."""
    count = len(points)
    before, after = (np.roll(np.arange(count), shift).tolist() for shift in (1, -1))
    tree, is_left = KDTree(points), np.ones(count, dtype=bool)
    ears, at, left, tried = [], 0, count, 0
    while left > 3:
        ear = [before[at], at, after[at]]
        if _is_ear(tree, is_left, ear):
            ears.append(ear)
            after[ear[0]], before[ear[2]], is_left[at] = ear[2], ear[0], False
            left, tried = left - 1, 0
        elif (tried := tried + 1) > left:
            return None
        at = after[at]
    return np.array([*ears, [before[at], at, after[at]]])


def _is_ear(tree: KDTree, is_left: BoolArray, ear: list[int]) -> bool:
    """Return whether a triangle runs counter-clockwise and no other corner of its polygon is in it."""
    corners = tree.data[ear]
    (ax, ay), (bx, by), (cx, cy) = corners.tolist()
    if (bx - ax) * (cy - by) <= (by - ay) * (cx - bx):
        return False
    middle = corners.mean(axis=0)
    reach = 1.001 * float(np.linalg.norm(corners - middle, axis=1).max())
    others = [near for near in tree.query_ball_point(middle, reach) if is_left[near] and near not in ear]
    along = np.roll(corners, -1, axis=0) - corners
    across = tree.data[others][:, None] - corners
    beside = along[:, 0] * across[..., 1] - along[:, 1] * across[..., 0]
    return not (beside >= 0.0).all(axis=1).any()


def sides_of(faces: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """Return directed sides (3F, 2), the face of each, and the number of faces at its edge."""
    sides = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).astype(np.int64)
    ordered = np.sort(sides, axis=1)
    keys = ordered[:, 0] * (int(faces.max(initial=0)) + 1) + ordered[:, 1]
    _, same, uses = np.unique(keys, return_inverse=True, return_counts=True)
    return sides, np.tile(np.arange(len(faces)), 3), uses[same]
