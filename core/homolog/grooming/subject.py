"""From one file to a distance field and its meshes."""

from dataclasses import dataclass

import numpy as np

from homolog.arrays import BoolArray
from homolog.cohort import Subject
from homolog.errors import InputError, NumericalError
from homolog.files.meshes import read_mesh
from homolog.grooming.clean import cleaned
from homolog.grooming.fields import distance_field
from homolog.grooming.images import Segmentation, read_segmentation
from homolog.grooming.levels import level_of_mesh, level_of_voxels
from homolog.settings import GroomSettings
from homolog.surfaces.distance_field import DistanceField
from homolog.surfaces.isosurface import coarse_isosurface, isosurface
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.topology import check_mesh, euler_number, face_components

__all__ = ["COARSE_VERTICES", "GroomReport", "GroomedSubject", "groom", "groom_subject", "read_source"]

COARSE_VERTICES = 1500

_FEWEST_VOXELS = 8


@dataclass(frozen=True, slots=True)
class GroomReport:
    """What grooming found and changed.

    Attributes
    ----------
    components_dropped : int
        Separate pieces that were left out; the largest is kept.
    holes_filled : int
        Enclosed cavities that were filled.
    padded : bool
        Whether the structure touched the border of its image.
    volume_before, volume_after : float
        Volume of the input and of the groomed mesh [ml].
    genus : int
        Number of handles of the surface.
    notes : tuple of str
        Sentences for the user on all of this.
    """

    components_dropped: int
    holes_filled: int
    padded: bool
    volume_before: float
    volume_after: float
    genus: int
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class GroomedSubject:
    """A subject that is ready for the optimization, in the local coordinates of its file.

    Attributes
    ----------
    name : str
        The subject's name.
    field : DistanceField
        The implicit surface.
    mesh : TriangleMesh
        Its zero level: a closed manifold of one component.
    coarse_mesh : TriangleMesh
        The same with about 1500 vertices.
    report : GroomReport
        What was found and changed.
    """

    name: str
    field: DistanceField
    mesh: TriangleMesh
    coarse_mesh: TriangleMesh
    report: GroomReport


def groom_subject(subject: Subject, settings: GroomSettings) -> GroomedSubject:
    """Turn a segmentation or a closed mesh into a distance field and meshes.

    Pure, and of arguments and results that can be pickled: it may run in another process or on another
    machine that sees the same files.

    Parameters
    ----------
    subject : Subject
        Its file is read.
    settings : GroomSettings
        Alignment and scaling play no part.

    Raises
    ------
    InputError
        If the file does not hold a shape.
    NumericalError
        If no closed surface could be made of it.
    """
    return groom(subject.name, read_source(subject, settings), settings)


def read_source(subject: Subject, settings: GroomSettings) -> Segmentation | TriangleMesh:
    """Read a subject's file, with all checks that need no computation.

    Raises
    ------
    InputError
        Naming the file, what is wrong and the remedy.
    """
    try:
        if not subject.is_mesh:
            found = read_segmentation(subject.path, settings.label, settings.segment)
            if (count := int(found.mask.sum())) < _FEWEST_VOXELS:
                raise InputError(
                    f"{subject.path}: has only {count} voxel(s) of the structure, which make no shape; "
                    "segment it or leave the subject out"
                )
            return found
        mesh = read_mesh(subject.path)
    except OSError as error:
        reason = error.strerror or error
        raise InputError(
            f"{subject.path}: can't be read: {reason}; check its permissions and disk"
        ) from error
    pieces = face_components(mesh.faces)
    check_mesh(_piece(mesh, pieces == 0), str(subject.path))
    return mesh


def groom(name: str, source: Segmentation | TriangleMesh, settings: GroomSettings) -> GroomedSubject:
    """Do what `groom_subject` does after reading; `name` is the subject's."""
    try:
        return _groomed(name, source, settings)
    except (InputError, NumericalError) as error:
        raise type(error)(f"{name}: {error}") from error


def _groomed(name: str, source: Segmentation | TriangleMesh, settings: GroomSettings) -> GroomedSubject:
    notes: list[str] = []
    if isinstance(source, Segmentation):
        notes += source.notes
        found = cleaned(source)
        dropped, filled, at_border = found.components_dropped, found.holes_filled, found.at_border
        level = level_of_voxels(found.segmentation, settings.spacing, settings.smoothing)
    else:
        pieces = face_components(source.faces)
        dropped, filled, at_border = int(pieces.max()), 0, False
        level = level_of_mesh(_outward(_piece(source, pieces == 0)), settings.spacing)
    field, further = distance_field(level, settings.smoothing)
    mesh = isosurface(field, settings.mesh_edge, settings.adaptive_mesh)
    if mesh.volume <= 0.0:
        raise NumericalError(
            "is too small for a surface: look at its unit, segment it on a finer grid, ask for shorter edges "
            "(mesh edge), or leave it out"
        )
    check_mesh(mesh, name)
    if dropped:
        notes.append(f"the largest of {dropped + 1} separate pieces was kept")
    if filled:
        notes.append(f"{filled} enclosed cavities were filled")
    if at_border:
        notes.append("touches the border of its image and may be cut off there; it was padded")
    report = GroomReport(
        components_dropped=dropped,
        holes_filled=filled,
        padded=at_border,
        volume_before=abs(source.volume) / 1000.0,
        volume_after=mesh.volume / 1000.0,
        genus=1 - euler_number(mesh.faces) // 2,
        notes=(*notes, *further),
    )
    return GroomedSubject(name, field, mesh, coarse_isosurface(field, mesh, COARSE_VERTICES), report)


def _piece(mesh: TriangleMesh, chosen: BoolArray) -> TriangleMesh:
    """Return the chosen faces with the vertices that they use."""
    if chosen.all():
        return mesh
    used, faces = np.unique(mesh.faces[chosen], return_inverse=True)
    return TriangleMesh(mesh.vertices[used], faces.reshape(-1, 3))


def _outward(mesh: TriangleMesh) -> TriangleMesh:
    return mesh if mesh.volume > 0.0 else TriangleMesh(mesh.vertices, mesh.faces[:, ::-1])
