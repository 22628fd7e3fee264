"""Level functions of meshes, including damaged ones."""

from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from homolog.arrays import BoolArray, FloatArray
from homolog.errors import InputError
from homolog.grooming.levels import Level, level_of_mesh, level_of_solid
from homolog.grooming.sheets import CRUMBS, KEPT, check_share, chosen_faces, width_of_hole
from homolog.settings import GroomSettings, Openings, Pieces
from homolog.surfaces.closest import distances_to
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.solid import Solid, clusters, solid_of
from homolog.surfaces.topology import face_components, mesh_fault, rim_sides, without_cavities

__all__ = ["Triangles", "check_triangles", "level_of_triangles", "notes_on_groomed"]

_THICK = 0.5
"""Least thickness in nodes; a solid with less volume than half its surface times this encloses nothing.

Of the grid's lines across a thinner wall, most pass it without a node inside.
"""
_THINNEST = 1e-6
"""Fraction of the longest extent; points that span less are in one plane: texts have six digits."""
_NEAR = 2  # nodes: distance at which a face is near a solid
_PIECE = 1e-3
"""Fraction of the largest solid; a piece with fewer nodes is an artefact of the grid."""
_CLOSING = 0.2
"""Fraction of the groomed surface; if a larger part closes openings, this is reported."""


@dataclass(frozen=True, slots=True, eq=False)
class Triangles:
    """A mesh as a level function.

    Attributes
    ----------
    level : Level
        Level function of one solid.
    volume : float
        Volume that the mesh encloses [mm³].
    pieces_dropped, holes_filled : int
        Numbers of separate pieces that were removed, and of openings that were closed.
    surface : TriangleMesh or None
        The repaired mesh; None if nothing had to be repaired.
    own_area : float
        Area of the faces from the file [mm²]; further faces close openings.
    is_closed : bool
        Whether the mesh has no opening.
    ends : tuple of int
        Numbers of wide openings that were closed flat, and of others.
    notes : tuple of str
        Sentences on the repair for the user.
    """

    level: Level
    volume: float
    pieces_dropped: int
    holes_filled: int
    surface: TriangleMesh | None
    own_area: float
    is_closed: bool
    ends: tuple[int, int]
    notes: tuple[str, ...]


def check_triangles(mesh: TriangleMesh, settings: GroomSettings) -> None:
    """Refuse meshes that enclose no volume or are in pieces, by quick checks.

    Raises
    ------
    InputError
        With the fault and the remedy.
    """
    corners = mesh.vertices[np.unique(mesh.faces)]
    spread = np.linalg.svd(np.cov((corners - corners.mean(axis=0)).T), compute_uv=False)
    is_sheet = settings.openings is not Openings.CLOSE and len(rim_sides(mesh.faces)[0]) > 0
    if spread[2] <= _THINNEST**2 * spread[0] and not is_sheet:
        raise InputError("the mesh is flat and encloses no volume; export the complete surface")
    if settings.pieces is Pieces.LARGEST:
        labels = clusters(mesh)
        check_share(_share(mesh.face_areas, labels == 0), int(labels.max()) + 1)


def level_of_triangles(mesh: TriangleMesh, settings: GroomSettings) -> Triangles:
    """Return the level function of a mesh.

    A sound mesh is used unchanged. Any other is repaired (`solid_of`); the solid is the region with winding
    numbers of at least 1/2. Of solids that do not touch, the largest is kept.

    Parameters
    ----------
    mesh : TriangleMesh
        Any triangles with finite vertices.
    settings : GroomSettings
        Its `spacing` and `pieces`.

    Raises
    ------
    InputError
        If the mesh encloses no volume, less than two thirds of the surface are kept, or all pieces are to be
        kept but do not touch.
    """
    pieces = face_components(mesh.faces)
    largest = chosen_faces(mesh, pieces == 0)
    crumbs = 1.0 - _share(mesh.face_areas, pieces == 0)
    may_drop = settings.pieces is Pieces.LARGEST and crumbs <= CRUMBS
    if (may_drop or len(largest.faces) == len(mesh.faces)) and not mesh_fault(largest):
        level = level_of_mesh(_outward(largest), settings.spacing)
        dropped = int(pieces.max())
        kept = f"{100.0 - 100.0 * crumbs:.3g} % of the area"
        said = [
            (dropped, f"the largest of {dropped + 1} separate pieces was kept ({kept})"),
            (largest.volume < 0.0, "all faces pointed inward and were flipped"),
        ]
        notes = tuple(note for is_true, note in said if is_true)
        return Triangles(level, abs(mesh.volume), dropped, 0, None, largest.area, True, (0, 0), notes)
    labels = clusters(mesh) if settings.pieces is Pieces.LARGEST else np.zeros(len(mesh.faces), np.int64)
    solid = solid_of(chosen_faces(mesh, labels == 0))
    if not solid.bounds.any():
        raise InputError(_NO_VOLUME)
    level = level_of_solid(solid, settings.spacing)
    level, inside, apart = _largest(level)
    touching = _touching(solid.mesh, level, inside)
    area = solid.mesh.face_areas
    volume = float(np.count_nonzero(inside)) * level.step**3
    if volume < 0.5 * _THICK * level.step * float(area[touching].sum()):
        raise InputError(_NO_VOLUME)
    if apart and settings.pieces is Pieces.ALL:
        raise InputError(
            f"the mesh is in {apart + 1} pieces that do not touch, which can't give one surface; join them, "
            "or keep the largest (pieces: largest)"
        )
    dropped = int(labels.max()) + apart
    share = _share(mesh.face_areas, labels == 0) * _share(area, touching)
    if share < KEPT and not labels.any() and not solid.is_closed:
        raise InputError(
            f"the mesh is open (rims of {solid.open_length:,.0f} mm in all), and only {100.0 * share:.0f} % "
            "of its area encloses one volume; export the complete surface, closed or with small openings"
        )
    check_share(share, dropped + 1)
    widest = width_of_hole(solid.mesh.area, settings.mesh_edge)
    notes = _notes(solid, touching, dropped, share, widest)
    used = touching & solid.bounds
    own_area = float(area[used & ~solid.is_cap].sum())
    surface = chosen_faces(solid.mesh, used)
    ends = int(np.count_nonzero(solid.rims > widest)), int(np.count_nonzero(solid.openings > widest))
    filled = len(solid.rims)
    return Triangles(level, volume, dropped, filled, surface, own_area, solid.is_closed, ends, notes)


def notes_on_groomed(solid: Triangles, groomed: TriangleMesh) -> list[str]:
    """Return notes on the distance of a groomed surface from the repaired one, and on its closed openings.

    If the repaired surface has openings, distances are only measured from it to the groomed surface.
    """
    surface = solid.surface
    if surface is None:
        return []
    back = distances_to(groomed, surface.vertices[surface.faces].mean(axis=1))
    notes = [
        f"the repaired surface is {back.mean():.2g} mm from the groomed one on average and "
        f"{back.max():.2g} mm at most"
    ]
    if solid.is_closed:
        there = distances_to(surface, groomed.vertices)
        notes = [
            f"the groomed surface is {there.mean():.2g} mm from the repaired one on average and "
            f"{there.max():.2g} mm at most; measured from the repaired one, {back.mean():.2g} and "
            f"{back.max():.2g} mm"
        ]
    closing = 1.0 - solid.own_area / groomed.area
    if closing > _CLOSING and (solid.holes_filled or not solid.is_closed):
        notes.append(
            f"{100.0 * closing:.0f} % of the groomed surface closes openings of the mesh and shows no "
            "anatomy; particles lie there too"
        )
    return notes


_NO_VOLUME = "the mesh encloses no volume; export the complete surface, closed or with small openings"


def _notes(solid: Solid, touching: BoolArray, dropped: int, share: float, widest: float) -> tuple[str, ...]:
    walls = int(np.count_nonzero(touching & ~solid.bounds))
    pieces = int(face_components(solid.mesh.faces[touching]).max()) + 1
    ends = solid.rims[solid.rims > widest]
    holes = len(solid.rims) - len(ends)
    widths = ", ".join(f"{end:.3g}" for end in ends[:4]) + (" …" if len(ends) > 4 else "")
    said = [
        (solid.welded, f"coincident vertices were merged ({solid.welded})"),
        (solid.dropped, f"faces without area or listed twice were removed ({solid.dropped})"),
        (solid.turned, f"faces of opposite orientation were flipped ({solid.turned})"),
        (pieces > 1, f"pieces that touch or overlap were united ({pieces})"),
        (walls > CRUMBS * len(solid.mesh.faces), f"faces inside the solid were removed ({walls})"),
        (len(ends), f"open ends were closed flat at their rims ({len(ends)}: {widths} mm wide)"),
        (holes, f"holes with flat rims were closed flat ({holes})"),
        (
            not solid.is_closed,
            f"other openings were closed by winding number (rims of {solid.open_length:,.0f} mm in all)",
        ),
        (
            dropped,
            f"the largest of {dropped + 1} separate pieces was kept ({100.0 * share:.0f} % of the area)",
        ),
    ]
    return tuple(note for is_true, note in said if is_true)


def _largest(level: Level) -> tuple[Level, BoolArray, int]:
    """Return the level function of the largest solid, its nodes, and the number of other solids."""
    labels, count = ndimage.label(level.values < 0.0)
    if not count:
        raise InputError(_NO_VOLUME)
    inside: BoolArray = labels == 1 + int(np.argmax(np.bincount(labels.ravel())[1:]))
    inside = without_cavities(inside)
    others = np.bincount(labels[~inside].ravel(), minlength=count + 1)[1:]
    others = np.where(others >= _PIECE * np.count_nonzero(inside), others, 0)
    if others.any():
        apart = np.append(False, others > 0)[labels]
        level = replace(level, values=np.where(apart & ~inside, np.abs(level.values), level.values))
    return level, inside, int(np.count_nonzero(others))


def _touching(mesh: TriangleMesh, level: Level, inside: BoolArray) -> BoolArray:
    """Return which faces are at or in a solid."""
    near = ndimage.binary_dilation(inside, np.ones((3, 3, 3), dtype=bool), _NEAR)
    middles = mesh.vertices[mesh.faces].mean(axis=1)
    nodes = np.rint((middles - level.index_to_world[:3, 3]) / level.step).astype(np.int64)
    return np.asarray(near[tuple(np.clip(nodes, 0, np.array(inside.shape) - 1).T)])


def _share(areas: FloatArray, chosen: BoolArray) -> float:
    return float(areas[chosen].sum() / max(float(areas.sum()), 1e-300))


def _outward(mesh: TriangleMesh) -> TriangleMesh:
    return mesh if mesh.volume > 0.0 else TriangleMesh(mesh.vertices, mesh.faces[:, ::-1])
