"""Meshes that stay open: sheets, and bones or vessels that a scan cut off."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from homolog.arrays import BoolArray, FloatArray, IntArray
from homolog.errors import InputError
from homolog.settings import GroomSettings, Openings, Pieces
from homolog.surfaces.isosurface import vertex_count
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.rims import SEAM, coinciding
from homolog.surfaces.simplify import simplified
from homolog.surfaces.solid import oriented, welded
from homolog.surfaces.topology import face_components, mesh_fault, rim_numbers, rim_sides, unpinched

__all__ = ["CRUMBS", "KEPT", "Sheet", "check_share", "chosen_faces", "sheet_of", "width_of_hole"]

CRUMBS = 0.05
"""Fraction of the area; smaller pieces are dropped untested if there is a sound larger one."""
KEPT = 2.0 / 3.0
"""Fraction of the area; of two pieces of similar size (`is_pair`) the larger one has no more."""
VERTICES_OF_HOLE = 12
"""Vertices of the groomed mesh that a filling may have for its opening to be a hole: a particle's share.

A mesh shows as many particles as it has vertices over 12 (`correspondence.prepared_cohort`). No particle more
is needed for a hole of that size, so that nobody can tell whether it is open.
"""
_SOLID = 0.5
"""Largest area of all fillings, relative to the mesh, of a solid that was cut: half of a ball is one."""


@dataclass(frozen=True, slots=True, eq=False)
class Sheet:
    """A mesh with rims, ready for particles.

    Attributes
    ----------
    mesh : TriangleMesh
        An oriented manifold; its rims are those of the file.
    rims : int
        Number of its rims.
    pieces_dropped, holes_filled : int
        Numbers of separate pieces that were left out, and of small openings that were closed.
    notes : tuple of str
        Sentences on this for the user.
    """

    mesh: TriangleMesh
    rims: int
    pieces_dropped: int
    holes_filled: int
    notes: tuple[str, ...]


def sheet_of(mesh: TriangleMesh, settings: GroomSettings) -> Sheet | None:
    """Return a mesh that stays open; None if it is closed, has only small holes, or is to be closed.

    An opening is a small hole if its filling has less area than a particle needs. An opening whose rim
    coincides with others is a seam between faces that were not connected.

    Parameters
    ----------
    mesh : TriangleMesh
        Any triangles with finite vertices.
    settings : GroomSettings
        Its `openings`, `pieces` and `mesh_edge`.

    Raises
    ------
    InputError
        If the mesh is to stay open and is no manifold, or its largest piece is too small a part of it.
    """
    if settings.openings is Openings.CLOSE or not len(rim_sides(mesh.faces)[0]):
        return None
    whole, turned = oriented(welded(mesh))
    pieces = face_components(whole.faces)
    kept = pieces == 0 if settings.pieces is Pieces.LARGEST else np.ones(len(pieces), dtype=bool)
    share = float(whole.face_areas[kept].sum()) / max(whole.area, 1e-300)
    if share < 1.0 - CRUMBS and settings.openings is Openings.AUTO:
        return None  # such as both walls of a bone that was cut
    check_share(share, int(pieces.max()) + 1)
    used = unpinched(chosen_faces(whole, kept))
    rim, _ = rim_sides(used.faces)
    if (fault := mesh_fault(used, may_open=True)) or not len(rim):
        if settings.openings is Openings.OPEN:
            raise InputError(f"the mesh can't stay open: it {fault or 'has no rim'}")
        return None
    numbers = rim_numbers(rim)
    seams = np.bincount(numbers, coinciding(used.vertices, rim)) >= SEAM * np.bincount(numbers)
    fillings = _filling_areas(used.vertices, rim, numbers)
    count = vertex_count(used.area, settings.mesh_edge)
    is_hole = fillings <= VERTICES_OF_HOLE * used.area / count
    if settings.openings is Openings.AUTO and (seams.any() or is_hole.all()):
        return None
    if settings.openings is Openings.OPEN:
        is_hole[:] = False
    is_solid = fillings.sum() <= _SOLID * used.area
    filled = _filled(used, rim, numbers, is_hole)
    if is_solid and _enclosed(filled) < 0.0:
        filled = TriangleMesh(filled.vertices, filled.faces[:, ::-1])
    widths = np.sort(_widths(used.vertices, rim, numbers)[~is_hole])[::-1]
    sizes = ", ".join(f"{width:.3g}" for width in widths[:4]) + (" …" if len(widths) > 4 else "")
    dropped, holes = int(pieces.max()) if settings.pieces is Pieces.LARGEST else 0, int(is_hole.sum())
    even = simplified(filled, count)
    said = [
        (turned, f"faces of opposite orientation were flipped ({turned})"),
        (
            dropped,
            f"the largest of {dropped + 1} separate pieces was kept ({100.0 * share:.0f} % of the area)",
        ),
        (True, f"is open and stays so: openings {sizes} mm wide"),
        (holes, f"openings smaller than a particle's part of the surface were closed ({holes})"),
        (
            crossed := _crossings(even),
            f"its rim passes through its own surface ({crossed} places); correct the file",
        ),
    ]
    notes = tuple(note for is_true, note in said if is_true)
    return Sheet(even, len(widths), dropped, holes, notes)


def width_of_hole(area: float, edge: float | None) -> float:
    """Return the width of a round opening that is a hole of a surface of some area [mm²] and edge [mm]."""
    return 2.0 * float(np.sqrt(VERTICES_OF_HOLE * area / vertex_count(area, edge) / np.pi))


def check_share(share: float, pieces: int) -> None:
    """Refuse a mesh of which less than two thirds would be kept."""
    if share < KEPT:
        raise InputError(
            f"the mesh is in {pieces} separate pieces, and the largest has only {100.0 * share:.0f} % of the "
            "area; save the structure as a file of its own, join its pieces, or keep all (pieces: all)"
        )


def chosen_faces(mesh: TriangleMesh, chosen: BoolArray) -> TriangleMesh:
    """Return the chosen faces of a mesh with the vertices that they use."""
    if chosen.all():
        return mesh
    used, faces = np.unique(mesh.faces[chosen], return_inverse=True)
    return TriangleMesh(mesh.vertices[used], faces.reshape(-1, 3))


def _middles(vertices: FloatArray, rim: IntArray, numbers: IntArray) -> FloatArray:
    """Return the mean of the vertices of each rim, (R, 3)."""
    sums = [np.bincount(numbers, column[rim[:, 0]]) for column in vertices.T]
    return np.asarray(np.stack(sums, axis=1) / np.bincount(numbers)[:, None])


def _filling_areas(vertices: FloatArray, rim: IntArray, numbers: IntArray) -> FloatArray:
    """Return the area of a fan that fills each opening, (R,) [mm²]."""
    spokes = vertices[rim] - _middles(vertices, rim, numbers)[numbers, None]
    areas = 0.5 * np.linalg.norm(np.cross(spokes[:, 0], spokes[:, 1]), axis=1)
    return np.bincount(numbers, areas).astype(np.float64)


def _widths(vertices: FloatArray, rim: IntArray, numbers: IntArray) -> FloatArray:
    """Return twice the largest distance of each rim from its middle, (R,) [mm]."""
    widths = np.zeros(int(numbers.max()) + 1)
    arms = vertices[rim[:, 0]] - _middles(vertices, rim, numbers)[numbers]
    np.maximum.at(widths, numbers, 2.0 * np.linalg.norm(arms, axis=1))
    return widths


def _crossings(mesh: TriangleMesh) -> int:
    """Return how many sides of a mesh's rims pass through faces with which they share no vertex."""
    corners, rim = mesh.vertices[mesh.faces], rim_sides(mesh.faces)[0]
    centres, ends = corners.mean(axis=1), mesh.vertices[rim]
    reach = np.linalg.norm(corners - centres[:, None], axis=2).max()
    reach += 0.5 * np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    near = KDTree(centres).query_ball_point(ends.mean(axis=1), reach)
    side = np.repeat(np.arange(len(rim)), [len(own) for own in near])
    face = np.concatenate([np.array(own, np.int64) for own in near])
    apart = (mesh.faces[face][:, :, None] != rim[side][:, None]).all(axis=(1, 2))
    side, face = side[apart], face[apart]
    first, *others = np.swapaxes(corners[face], 0, 1)
    edges = np.stack([*(other - first for other in others), ends[side, 0] - ends[side, 1]], axis=-1)
    sound = np.abs(np.linalg.det(edges)) > 0.0
    places = np.linalg.solve(edges[sound], (ends[side, 0] - first)[sound][..., None])[..., 0]
    inside = (places >= 0.0).all(axis=1) & (places[:, :2].sum(axis=1) <= 1.0) & (places[:, 2] <= 1.0)
    return len(np.unique(side[sound][inside]))


def _filled(mesh: TriangleMesh, rim: IntArray, numbers: IntArray, which: BoolArray) -> TriangleMesh:
    """Return a mesh with fans of faces in some of its openings."""
    rank = np.cumsum(which) - 1
    chosen = which[numbers]
    fans = np.column_stack([rim[chosen][:, ::-1], len(mesh.vertices) + rank[numbers[chosen]]])
    vertices = np.concatenate([mesh.vertices, _middles(mesh.vertices, rim, numbers)[which]])
    return TriangleMesh(vertices, np.concatenate([mesh.faces, fans]))


def _enclosed(mesh: TriangleMesh) -> float:
    """Return the volume of a mesh whose openings are filled by fans [mm³]; negative if it is inside out."""
    rim, _ = rim_sides(mesh.faces)
    numbers = rim_numbers(rim)
    return _filled(mesh, rim, numbers, np.ones(int(numbers.max()) + 1, dtype=bool)).volume
