"""What is cut away of subjects by planes and painted regions: the part of a surface that takes part."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from homolog.errors import InputError
from homolog.grooming.sheets import chosen_faces
from homolog.io.images import Segmentation
from homolog.surfaces.clipping import Ball, Cut, Plane, clipped, kept_heights, where_positive
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.topology import face_components, rim_numbers, rim_sides, unpinched

__all__ = ["Part", "check_cuts", "kept_part", "kept_surface"]


def check_cuts(name: str, cuts: Sequence[Cut], source: Segmentation | TriangleMesh) -> None:
    """Refuse a plane that cuts nothing off a shape, or everything, and paint that does not meet it.

    Raises
    ------
    InputError
        With the subject and the distance from its surface.
    """
    if not cuts:
        return
    if isinstance(source, Segmentation):
        points = source.origin + np.argwhere(source.mask) * source.spacing @ source.rotation.T
    else:
        points = source.vertices
    gaps = []
    for cut in cuts:
        if isinstance(cut, Ball):
            gaps.append(float(np.linalg.norm(points - cut.centre, axis=1).min()) - cut.radius)
            continue
        heights = cut.heights(points)
        if (heights >= 0.0).all() or (heights <= 0.0).all():
            what = "nothing off" if (heights >= 0.0).all() else "everything off"
            gap = float(np.abs(heights).min())
            raise InputError(
                f"{name}: its cutting plane cuts {what}, {gap:.3g} mm off the surface; correct or remove it"
            )
    if gaps and min(gaps) > 0.0:
        raise InputError(
            f"{name}: what is painted is {min(gaps):.3g} mm off its surface or smaller than a face; paint it "
            "again, or remove it"
        )


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """The part of a surface that is kept.

    Attributes
    ----------
    mesh : TriangleMesh
        In one piece.
    rims : int
        Number of its rims.
    pieces_dropped : int
        Smaller pieces that were left.
    notes : tuple of str
        Sentences on this for the user.
    """

    mesh: TriangleMesh
    rims: int
    pieces_dropped: int
    notes: tuple[str, ...]


def kept_surface(mesh: TriangleMesh, cuts: Sequence[Cut]) -> tuple[TriangleMesh, tuple[TriangleMesh, ...]]:
    """Return the part of a surface that cuts keep, which may be in pieces, and what each leaves out."""
    part, rest = mesh, []
    for plane in (cut for cut in cuts if isinstance(cut, Plane)):
        rest.append(clipped(part, Plane(plane.point, -plane.direction)))
        part = clipped(part, plane)
    if balls := [cut for cut in cuts if isinstance(cut, Ball)]:
        heights = kept_heights(part, balls)
        rest.append(where_positive(part, -heights))
        part = where_positive(part, heights)
    return part, tuple(item for item in rest if len(item.faces))


def kept_part(mesh: TriangleMesh, cuts: Sequence[Cut]) -> Part:
    """Return the part of a surface that planes and paint keep.

    Raises
    ------
    InputError
        If nothing is kept, or nothing left out.
    """
    part, _ = kept_surface(mesh, cuts)
    if not len(part.faces):
        raise InputError("its planes and paint leave nothing; correct or remove them")
    if part is mesh:
        raise InputError("its planes and paint remove nothing; correct or remove them")
    pieces = face_components(part.faces)
    areas = np.bincount(pieces, part.face_areas)
    part = unpinched(chosen_faces(part, pieces == int(areas.argmax())))
    share = 100.0 * (1.0 - part.area / mesh.area)
    notes = [f"{share:.3g} % of its surface was cut away"]
    if len(areas) > 1:
        notes.append(f"of {len(areas)} pieces that were left, the largest was kept")
    rims = int(rim_numbers(rim_sides(part.faces)[0]).max(initial=-1)) + 1
    return Part(part, rims, len(areas) - 1, tuple(notes))
