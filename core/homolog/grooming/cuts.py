"""Cutting planes of subjects: the part of a surface that takes part in a study."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from homolog.cohort import Subject, column_of
from homolog.errors import InputError
from homolog.grooming.sheets import chosen_faces
from homolog.io.images import Segmentation
from homolog.surfaces.clipping import Plane, clipped
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.topology import face_components, rim_numbers, rim_sides

__all__ = ["COLUMN", "Part", "check_planes", "kept_part", "planes_of", "text_of"]

COLUMN = "cut"
"""Column of the table with the planes of a subject: x y z of a point, then of the direction that is kept."""


def planes_of(subject: Subject) -> tuple[Plane, ...]:
    """Return the cutting planes in a subject's column `cut`; several are separated by semicolons.

    Raises
    ------
    InputError
        If the column has no planes as it should.
    """
    planes = []
    for text in column_of(subject.columns, COLUMN).split(";"):
        if not text.strip():
            continue
        try:
            numbers = np.array([float(item) for item in text.replace(",", " ").split()])
            if len(numbers) != 6:
                raise ValueError
            planes.append(Plane.of(numbers[:3], numbers[3:]))
        except (ValueError, InputError) as error:
            raise InputError(
                f"{subject.name}: its cutting plane is {text.strip()!r}; give six numbers, x y z of a point "
                "and of the direction towards the part that is kept"
            ) from error
    return tuple(planes)


def text_of(planes: Sequence[Plane]) -> str:
    """Return planes as a subject's column `cut`."""
    return "; ".join(
        " ".join(f"{number:.6g}" for number in (*plane.point, *plane.direction)) for plane in planes
    )


def check_planes(name: str, planes: Sequence[Plane], source: Segmentation | TriangleMesh) -> None:
    """Refuse a plane that cuts nothing off a shape, or everything.

    Raises
    ------
    InputError
        With the subject and the distance of the plane from its surface.
    """
    if not planes:
        return
    if isinstance(source, Segmentation):
        points = source.origin + np.argwhere(source.mask) * source.spacing @ source.rotation.T
    else:
        points = source.vertices
    for plane in planes:
        heights = plane.heights(points)
        if (heights >= 0.0).all() or (heights <= 0.0).all():
            what = "nothing off" if (heights >= 0.0).all() else "everything off"
            gap = float(np.abs(heights).min())
            raise InputError(
                f"{name}: its cutting plane cuts {what}, {gap:.3g} mm off the surface; correct or remove it"
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


def kept_part(mesh: TriangleMesh, planes: Sequence[Plane]) -> Part:
    """Return the part of a surface that planes keep.

    Raises
    ------
    InputError
        If nothing is kept.
    """
    part = mesh
    for plane in planes:
        part = clipped(part, plane)
        if not len(part.faces):
            raise InputError("its cutting plane cuts everything off; correct or remove it")
    pieces = face_components(part.faces)
    areas = np.bincount(pieces, part.face_areas)
    part = chosen_faces(part, pieces == int(areas.argmax()))
    share = 100.0 * (1.0 - part.area / mesh.area)
    notes = [f"{share:.3g} % of its surface was cut off at {'planes' if len(planes) > 1 else 'a plane'}"]
    if len(areas) > 1:
        notes.append(f"of {len(areas)} pieces that were left, the largest was kept")
    rims = int(rim_numbers(rim_sides(part.faces)[0]).max(initial=-1)) + 1
    return Part(part, rims, len(areas) - 1, tuple(notes))
