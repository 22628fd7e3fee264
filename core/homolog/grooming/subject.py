"""From one file to a distance field and its meshes."""

from dataclasses import dataclass

from homolog.cohort import Subject
from homolog.errors import InputError, NumericalError
from homolog.grooming.clean import cleaned
from homolog.grooming.fields import distance_field
from homolog.grooming.images import read_segmentation
from homolog.settings import GroomSettings
from homolog.surfaces.distance_field import DistanceField
from homolog.surfaces.isosurface import coarse_isosurface, isosurface
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.topology import euler_number

__all__ = ["COARSE_VERTICES", "GroomReport", "GroomedSubject", "groom_subject"]

COARSE_VERTICES = 1500


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

    Raises
    ------
    InputError
        If the file does not hold a shape.
    NumericalError
        If no closed surface could be made of it.
    """
    try:
        segmentation = read_segmentation(subject.path, settings.label)
        found = cleaned(segmentation)
        field, notes = distance_field(found.segmentation, settings.spacing, settings.smoothing)
        mesh = isosurface(field, settings.mesh_edge, settings.adaptive_mesh)
        coarse = coarse_isosurface(field, mesh, COARSE_VERTICES)
    except (InputError, NumericalError) as error:
        raise type(error)(f"{subject.name}: {error}") from error
    report = GroomReport(
        found.components_dropped, found.holes_filled, found.at_border,
        segmentation.volume / 1000.0, mesh.volume / 1000.0, 1 - euler_number(mesh.faces) // 2, notes,
    )  # fmt: skip
    return GroomedSubject(subject.name, field, mesh, coarse, report)
