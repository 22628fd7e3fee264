"""From one file to a distance field and its meshes."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from homolog.cohort import Subject, column_of
from homolog.errors import InputError, NumericalError
from homolog.grooming.clean import cleaned
from homolog.grooming.cuts import check_cuts, kept_part
from homolog.grooming.fields import ENOUGH, SmoothField, distance_field, restored
from homolog.grooming.levels import AUTOMATIC_NODES, MANY_CROSSED, edges_crossed, level_of_voxels
from homolog.grooming.missing_slices import with_missing_slices
from homolog.grooming.sheets import Sheet, sheet_of
from homolog.grooming.triangles import check_triangles, level_of_triangles, notes_on_groomed
from homolog.io.constraints import cuts_of
from homolog.io.images import Segmentation, read_segmentation
from homolog.io.meshes import read_mesh
from homolog.io.structures import mask_of
from homolog.io.volumes import cavity_of, joined_names, union_of
from homolog.memory import Store
from homolog.settings import OWN, GroomSettings, OwnGrooming, Values, wall_of
from homolog.surfaces.clipping import Cut
from homolog.surfaces.distance_field import DistanceField
from homolog.surfaces.isosurface import coarse_isosurface, isosurface
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.mirroring import mirror_image
from homolog.surfaces.simplify import simplified
from homolog.surfaces.topology import euler_number, face_components
from homolog.threads import on_one_thread

__all__ = [
    "AT_BORDER",
    "COARSE_VERTICES",
    "GroomReport",
    "GroomedSubject",
    "Source",
    "check_source",
    "groom",
    "groom_subject",
    "read_source",
    "settings_of",
]

AT_BORDER = "touches the border of its image and may be cut off there; it was padded"
"""Note of grooming."""
COARSE_VERTICES = 1500

Source = Segmentation | TriangleMesh
"""Input of grooming."""

_FEWEST_VOXELS = 8
"""A cube of two voxels: the least whose centres span a volume."""
_MUCH_LOST = 0.75
"""Fraction of the voxels' volume; a field that encloses less is computed again on a finer grid."""
_POINTER = b"version https://git-lfs"
_SHORTEST, _LONGEST = 0.5, 3000.0
"""Plausible lengths of a shape [mm]: more than a voxel of clinical CT, and less than a body."""
_SHRUNK = 0.9
"""Fraction of the voxels' volume; a surface that encloses less gets a note."""
_LEAST_HELD = 0.5
"""Fraction of the voxels' volume; a field that encloses less lost more than it shows, and is refused."""


@dataclass(frozen=True, slots=True)
class GroomReport:
    """Findings and changes of grooming.

    Attributes
    ----------
    components_dropped : int
        Separate pieces that were removed; the largest is kept.
    holes_filled : int
        Number of enclosed cavities of a segmentation that were filled, or openings of a mesh that were
        closed.
    padded : bool
        Whether the structure touched the border of its image.
    borders : tuple of (3,) tuples
        Outward unit vectors of the borders that it touched (LPS).
    volume_before, volume_after : float
        Volume of the input and of the groomed mesh [ml].
    genus : int
        Number of handles of the surface.
    notes : tuple of str
        Sentences on this for the user.
    voxel : tuple of float
        Edges of the input's voxels along the axes of its image [mm]; empty for surfaces.
    ends : tuple of int
        Numbers of wide openings of a mesh that were closed flat at their rims, and by winding number.
    rims : int
        Number of openings that stay open; such a surface has no volume.
    """

    components_dropped: int
    holes_filled: int
    padded: bool
    volume_before: float
    volume_after: float
    genus: int
    notes: tuple[str, ...] = ()
    borders: tuple[tuple[float, float, float], ...] = ()
    voxel: tuple[float, ...] = ()
    ends: tuple[int, int] = (0, 0)
    rims: int = 0


@dataclass(frozen=True, slots=True)
class GroomedSubject:
    """A subject that is ready for the optimization, in the local coordinates of its file.

    Attributes
    ----------
    name : str
        The subject's name.
    field : DistanceField or None
        The implicit surface; None for a mesh that stays open.
    mesh : TriangleMesh
        Its zero level: a closed manifold of one component; or the open mesh.
    coarse_mesh : TriangleMesh
        The same surface with about 1500 vertices.
    report : GroomReport
        Findings and changes of grooming.
    """

    name: str
    field: DistanceField | None
    mesh: TriangleMesh
    coarse_mesh: TriangleMesh
    report: GroomReport

    @property
    def mirrored(self) -> "GroomedSubject":
        """The subject's mirror image."""
        return mirror_image(self)

    def with_notes(self, notes: Sequence[str]) -> "GroomedSubject":
        """Return the subject with further notes in its report."""
        return replace(self, report=replace(self.report, notes=(*self.report.notes, *notes)))

    def stored(self, store: Store) -> "GroomedSubject":
        """Return the subject with field and surfaces in a store."""
        return replace(
            self,
            field=self.field and self.field.stored(store),
            mesh=self.mesh.stored(store),
            coarse_mesh=self.coarse_mesh.stored(store),
        )


def groom_subject(subject: Subject, settings: GroomSettings) -> GroomedSubject:
    """Convert a segmentation or a mesh to a distance field and meshes.

    The function is pure, and its arguments and results can be pickled: it may run in another process, or on
    another machine that can read the same files.

    Parameters
    ----------
    subject : Subject
        The subject whose file is read.
    settings : GroomSettings
        Settings of grooming; alignment and scaling are ignored.

    Returns
    -------
    GroomedSubject

    Raises
    ------
    InputError
        If the file does not contain a usable shape.
    NumericalError
        If no closed surface can be computed.
    """
    own = settings_of(subject, settings)
    return groom(subject.name, read_source(subject, own), own, cuts_of(subject, own.structure))


def settings_of(subject: Subject, settings: GroomSettings) -> GroomSettings:
    """Return the settings of one subject, whose column ``grooming`` may differ from the cohort's.

    Raises
    ------
    InputError
        If the column can't be read.
    """
    return OwnGrooming.read(column_of(subject.columns, OWN), subject.name).applied(settings)


def read_source(subject: Subject, settings: GroomSettings) -> Source:
    """Read a subject's file, with all quick checks.

    Raises
    ------
    InputError
        With the file, the fault and the remedy.
    """
    if (wall := wall_of(settings.segment)) is not None:
        number = int(wall) if wall.isdecimal() else None
        chosen = {"label": number, "segment": None if number else wall}
        source = read_source(subject, settings.model_copy(update=chosen))
        if not isinstance(source, Segmentation):
            raise InputError(f"{subject.path}: {wall} is a surface; only walls of label maps have cavities")
        return check_source(cavity_of(source, subject.path), settings, subject.path)
    try:
        if subject.structures and (names := joined_names(settings.segment)):
            return check_source(_joined_files(subject, settings, names), settings, subject.path)
        if subject.structures:
            path = mask_of(subject, settings.label, settings.segment)
            subject = replace(subject, path=path, structures={})
            settings = settings.model_copy(update={"label": None, "segment": None})  # the whole file
        _check_beginning(subject.path)
        if not subject.is_mesh:
            source = read_segmentation(
                subject.path, settings.label, settings.segment, settings.values or Values.LABELS
            )
        else:
            source = read_mesh(subject.path)
    except OSError as error:
        reason = error.strerror or error
        raise InputError(
            f"{subject.path}: can't be read: {reason}; check its permissions and disk"
        ) from error
    return check_source(source, settings, subject.path)


def _joined_files(subject: Subject, settings: GroomSettings, names: Sequence[str]) -> Segmentation:
    """Return the voxels of structures with a file each together."""
    parts = [read_source(subject, settings.model_copy(update={"segment": name})) for name in names]
    masks = [part for part in parts if isinstance(part, Segmentation)]
    if len(masks) < len(parts):
        raise InputError(f"{subject.path}: {' and '.join(names)} are surfaces; only label maps can be joined")
    return union_of(masks, subject.path)


def _check_beginning(path: Path) -> None:
    """Refuse empty files and Git LFS pointers."""
    if not path.is_file():
        return
    with path.open("rb") as stream:
        beginning = stream.read(len(_POINTER))
    if not beginning:
        raise InputError(f"{path}: is empty; copy it again, or exclude it")
    if beginning == _POINTER:
        raise InputError(f"{path}: is a Git LFS pointer; fetch the file: git lfs pull")


def check_source(source: Source, settings: GroomSettings, what: object) -> Source:
    """Return a shape after quick checks.

    Parameters
    ----------
    source : Segmentation or TriangleMesh
    settings : GroomSettings
    what : object
        The file or subject, for the message.

    Returns
    -------
    Segmentation or TriangleMesh
        The source, unchanged.

    Raises
    ------
    InputError
        With the file or subject, the fault and the remedy.
    """
    if isinstance(source, TriangleMesh):
        try:
            check_triangles(source, settings)
        except InputError as error:
            raise InputError(f"{what}: {error}") from error
    elif (count := int(source.mask.sum())) < _FEWEST_VOXELS:
        raise InputError(
            f"{what}: has only {count} voxel(s) of the structure, too few for a shape; segment it or leave "
            "the subject out"
        )
    elif source.mask[np.ix_(*[[0, -1]] * 3)].all():
        raise InputError(
            f"{what}: the structure reaches all corners of its image, as if the background were labelled; "
            "choose its label, or invert the mask"
        )
    return source


@on_one_thread
def groom(name: str, source: Source, settings: GroomSettings, cuts: Sequence[Cut] = ()) -> GroomedSubject:
    """Groom a subject that has been read; see `groom_subject`.

    Parameters
    ----------
    name : str
        Name of the subject.
    source : Source
        Result of `read_source`.
    settings : GroomSettings
        Settings of grooming.
    cuts : sequence of Cut
        Cutting planes and painted places of the subject.

    Returns
    -------
    GroomedSubject
    """
    check_cuts(name, cuts, source)
    try:
        groomed = _groomed(name, source, settings)
        return _cut(groomed, cuts) if cuts else groomed
    except (InputError, NumericalError) as error:
        raise type(error)(f"{name}: {error}") from error


def _groomed(name: str, source: Source, settings: GroomSettings) -> GroomedSubject:
    if isinstance(source, TriangleMesh) and (sheet := sheet_of(source, settings)):
        return _open(name, sheet)
    notes: list[str] = []
    solid = None
    if isinstance(source, Segmentation):
        source, completed = with_missing_slices(source)
        notes += [*source.notes, *completed]
        clean = cleaned(source, settings.pieces)
        dropped, filled, borders = clean.components_dropped, clean.holes_filled, clean.borders
        volume = source.volume
        if clean.bridges:
            longest = f"the longest {max(clean.bridges):.2g} mm long"
            notes.append(f"{len(clean.bridges) + 1} separate pieces were joined by bridges, {longest}")
        smooth = _field_of_voxels(clean.segmentation, settings)
        if filled:
            notes.append(f"enclosed cavities were filled: {filled}")
        if borders:
            notes.append(AT_BORDER)
    else:
        solid = level_of_triangles(source, settings)
        dropped, filled, borders = solid.pieces_dropped, solid.holes_filled, ()
        volume = solid.volume
        notes += solid.notes
        smooth = distance_field(solid.level, settings.smoothing, settings.tunnels)
    field = smooth.field
    mesh = isosurface(field, settings.mesh_edge, settings.adaptive_mesh, smooth.surface)
    if mesh.volume <= 0.0:
        raise NumericalError(
            "is too small for a surface: check its unit, segment it on a finer grid, choose shorter edges "
            "(mesh edge), or exclude it"
        )
    if solid is not None:
        notes += notes_on_groomed(solid, mesh)
    if isinstance(source, Segmentation):
        _refuse_lost(mesh.volume / clean.segmentation.volume, settings)
        notes += _kept(mesh.volume / volume, dropped, smooth.pieces_dropped)
    report = GroomReport(
        components_dropped=dropped,
        holes_filled=filled,
        padded=bool(borders),
        volume_before=volume / 1000.0,
        volume_after=mesh.volume / 1000.0,
        genus=1 - euler_number(mesh.faces) // 2,
        notes=(*notes, *smooth.notes, *_of_other_unit(mesh)),
        borders=borders,
        voxel=tuple(source.spacing.tolist()) if isinstance(source, Segmentation) else (),
        ends=solid.ends if solid else (0, 0),
    )
    return GroomedSubject(name, field, mesh, coarse_isosurface(field, mesh, COARSE_VERTICES), report)


def _cut(groomed: GroomedSubject, cuts: Sequence[Cut]) -> GroomedSubject:
    """Return a subject with the part of its surface that its cuts keep."""
    part = kept_part(groomed.mesh, cuts)
    report = replace(
        groomed.report,
        components_dropped=groomed.report.components_dropped + part.pieces_dropped,
        volume_before=0.0,
        volume_after=0.0,
        genus=1 - (euler_number(part.mesh.faces) + part.rims) // 2,
        notes=(*groomed.report.notes, *part.notes),
        rims=part.rims,
    )
    coarse = simplified(part.mesh, COARSE_VERTICES)
    return replace(groomed, field=None, mesh=part.mesh, coarse_mesh=coarse, report=report)


def _open(name: str, sheet: Sheet) -> GroomedSubject:
    """Return a subject whose mesh stays open."""
    mesh = sheet.mesh
    pieces = int(face_components(mesh.faces).max()) + 1
    report = GroomReport(
        components_dropped=sheet.pieces_dropped,
        holes_filled=sheet.holes_filled,
        padded=False,
        volume_before=0.0,
        volume_after=0.0,
        genus=pieces - (euler_number(mesh.faces) + sheet.rims) // 2,
        notes=(*sheet.notes, *_of_other_unit(mesh)),
        rims=sheet.rims,
    )
    return GroomedSubject(name, None, mesh, simplified(mesh, COARSE_VERTICES), report)


def _of_other_unit(mesh: TriangleMesh) -> tuple[str, ...]:
    """Return a note on a shape of an implausible size."""
    longest = float(np.ptp(mesh.vertices, axis=0).max())
    if _SHORTEST <= longest <= _LONGEST:
        return ()
    unit = "metres" if longest < _SHORTEST else "micrometres"
    return (f"is {longest:.2g} mm long; if its file is in {unit}, save it in millimetres",)


def _field_of_voxels(segmentation: Segmentation, settings: GroomSettings) -> SmoothField:
    """Return `distance_field` of one piece, on a grid of half the spacing if it would lose much volume."""
    level = level_of_voxels(segmentation, settings.spacing, settings.smoothing)
    result = distance_field(level, settings.smoothing, settings.tunnels)
    if 8 * level.values.size > AUTOMATIC_NODES:
        return result
    if edges_crossed(segmentation, 0.5 * level.step) > MANY_CROSSED:
        return result
    volume = segmentation.volume
    if result.surface.volume < _MUCH_LOST * volume and settings.spacing is None:
        level = level_of_voxels(segmentation, 0.5 * level.step, settings.smoothing)
        if (level.values < 0.0).any():  # interpolation may erase thin threads
            finer = distance_field(level, settings.smoothing, settings.tunnels)
            if finer.surface.volume > result.surface.volume:
                thin = f"parts are thin: the grid was made finer than the image, {level.step:.3g} mm"
                result = replace(finer, notes=(*finer.notes, thin))
    _refuse_lost(result.surface.volume / volume, settings)
    if result.surface.volume < ENOUGH * volume:
        result = restored(result, volume, float(segmentation.spacing.min()))
    return result


def _refuse_lost(held: float, settings: GroomSettings) -> None:
    if held < _LEAST_HELD:
        remedy = "choose a finer grid spacing" if settings.spacing else "segment it on a finer grid"
        raise InputError(
            f"is too thin for its grid: only {100.0 * held:.0f} % of its volume is connected; {remedy}, "
            "or exclude it"
        )


def _kept(share: float, dropped: int, loose: int) -> list[str]:
    """Return a note on the share of the volume that was kept, if pieces were dropped or it is small."""
    pieces = [f"the largest of {dropped + 1} separate pieces"] if dropped else []
    pieces += [f"smoothing separated {loose} small piece{'s' if loose > 1 else ''}"] if loose else []
    kept = "more than 99.9 %" if share > 0.999 else f"{100.0 * share:.3g} %"
    if not pieces and share < _SHRUNK:
        return [f"the surface encloses {kept} of the structure's volume: parts are thin for its voxels"]
    return [f"{kept} of the structure's volume was kept: {', '.join(pieces)}"] if pieces else []
