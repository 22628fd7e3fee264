"""A preview of a subject's file: labels, volume, thumbnail and original surface."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from homolog.arrays import Array, BoolArray, FloatArray, frozen
from homolog.cluster import each_read
from homolog.cohort import Subject
from homolog.errors import InputError
from homolog.io.images import Segmentation, Volume, read_segmentation, read_volume
from homolog.io.structures import mask_of, structures_of
from homolog.progress import Tick, no_tick
from homolog.settings import GroomSettings, Values
from homolog.surfaces.mesh import TriangleMesh, joined
from homolog.surfaces.topology import enclosed_volume

__all__ = ["FileSurvey", "LabelSummary", "survey_subject", "surveys"]


THUMBNAIL = 64
_MARGIN = 6
_MOST_VOXELS = 128**3
_MOST_DRAWN = 2**30
"""Largest number of voxels that are processed for the thumbnails of a file's labels."""
_MOST_MEASURED = 2**31
"""Largest number of bytes of a subject's files that are read for the volumes of all structures."""
_GZIP_END = 4
_LIGHT = np.array([-0.4, -0.8, 0.45])


@dataclass(frozen=True, slots=True, eq=False)
class LabelSummary:
    """One structure of a subject's files.

    Attributes
    ----------
    value : int or None
        Label of the structure; None if it has a file of its own.
    volume_ml : float or None
        Volume; None if measuring all of the subject's files would take long.
    thumbnail : (64, 64) uint8 array or None
        Thumbnail, 0 in the background; None if there are many structures.
    name : str
        Name of the structure; empty if unknown.
    at_border : bool
        Whether it touches the border of its image.
    """

    value: int | None
    volume_ml: float | None
    thumbnail: Array | None
    name: str = ""
    at_border: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class FileSurvey:
    """The preview of a subject's file.

    Attributes
    ----------
    subject : Subject
    groom : GroomSettings
        Which structures are previewed, and what the voxels are declared to be.
    problem : str
        Reason why the file can't be used; empty if it can.
    volume_ml : float
        Volume of all structures; 0 of an open surface, which has none.
    thumbnail : (64, 64) uint8 array or None
        View from the front, 0 in the background.
    labels : tuple of LabelSummary
        Structures in the files; empty for surfaces.
    voxels : Segmentation or None
        The voxels around the structure; None for surfaces and several structures.
    surface : TriangleMesh or None
        The structure as stored, in the coordinates of the file.
    every : int
        The surface was computed from every n-th voxel, to save time.
    """

    subject: Subject
    groom: GroomSettings
    problem: str = ""
    volume_ml: float = 0.0
    thumbnail: Array | None = None
    labels: tuple[LabelSummary, ...] = ()
    voxels: Segmentation | None = None
    surface: TriangleMesh | None = None
    every: int = 1

    @property
    def awaits_choice(self) -> bool:
        """Whether the file is valid, but one of its overlapping structures must be chosen."""
        return bool(self.problem and self.labels) and not any(self.groom.source[:3])


def survey_subject(subject: Subject, groom: GroomSettings) -> FileSurvey:
    """Preview a subject's file. An unusable file gives a preview with a problem, not an error.

    A file whose structures can't be combined, because they overlap or are separate, has a problem and a list
    of its labels.
    """
    survey, values = FileSurvey(subject, groom), groom.values or Values.LABELS
    try:
        if subject.structures:
            survey = replace(survey, labels=_of_masks(subject, subject.structures, values))
        elif not subject.is_mesh:
            volume = read_volume(subject.path, values).with_names()
            survey = replace(survey, labels=_labels(volume))
        if groom.structures is not None:
            return _with_several(survey)
        if subject.structures:
            return _with_mask(survey, mask_of(subject, groom.label, groom.segment))
        if subject.is_mesh:
            return _with_mesh(survey, subject.path)
        return _with_voxels(survey, volume.segmentation(groom.label, groom.segment))
    except InputError as error:
        return _unusable(survey, error)


def surveys(subjects: Sequence[Subject], groom: GroomSettings, tick: Tick = no_tick) -> Iterator[FileSurvey]:
    """Preview files in workers, as they are read; a file that ends its process has a problem."""
    jobs = {subject.name: subject for subject in subjects}
    files = {subject.name: subject.path for subject in subjects}
    for name, future in each_read(partial(survey_subject, groom=groom), jobs, files, "reading", tick):
        try:
            yield future.result()
        except InputError as error:
            yield _unusable(FileSurvey(jobs[name], groom), error)


def _unusable(survey: FileSurvey, error: InputError) -> FileSurvey:
    message = str(error).removeprefix(f"{survey.subject.path}: ")
    return replace(survey, problem=message[:1].upper() + message[1:])


def _with_several(survey: FileSurvey) -> FileSurvey:
    """Return the survey with the surfaces of several structures together."""
    from homolog.grooming.subject import read_source

    parts = []
    for groom in survey.groom.of_structures.values():
        source = read_source(survey.subject, groom)
        part = FileSurvey(survey.subject, groom)
        parts.append(
            _with_surface(part, source) if isinstance(source, TriangleMesh) else _with_voxels(part, source)
        )
    whole = joined([part.surface for part in parts if part.surface is not None])
    return replace(
        survey,
        volume_ml=sum(part.volume_ml for part in parts),
        thumbnail=_mesh_thumbnail(whole),
        surface=whole,
        every=max(part.every for part in parts),
    )


def _with_mask(survey: FileSurvey, path: Path) -> FileSurvey:
    """Return the survey with the file of the chosen structure."""
    if Subject(survey.subject.name, path).is_mesh:
        return _with_mesh(survey, path)
    return _with_voxels(survey, read_segmentation(path, None, None, survey.groom.values or Values.LABELS))


def _with_mesh(survey: FileSurvey, path: Path) -> FileSurvey:
    from homolog.io.meshes import read_mesh

    return _with_surface(survey, read_mesh(path))


def _with_surface(survey: FileSurvey, mesh: TriangleMesh) -> FileSurvey:
    volume = abs(float(np.nan_to_num(enclosed_volume(mesh)))) / 1000.0
    return replace(survey, volume_ml=volume, thumbnail=_mesh_thumbnail(mesh), surface=mesh)


def _with_voxels(survey: FileSurvey, chosen: Segmentation) -> FileSurvey:
    voxels = _framed(chosen)
    surface, every = _surface(voxels)
    return replace(
        survey,
        volume_ml=chosen.volume / 1000.0,
        thumbnail=_thumbnail(voxels),
        voxels=voxels,
        surface=surface,
        every=every,
    )


def _labels(volume: Volume) -> tuple[LabelSummary, ...]:
    """Return the structures of a file, with thumbnails if these are fast to draw."""
    extents = volume.extents()
    drawn = len(extents) * volume.layers[0].size < _MOST_DRAWN
    return tuple(
        LabelSummary(
            extent.segment.value,
            extent.volume / 1000.0,
            _thumbnail(_framed(part)) if drawn and (part := volume.placed(extent.segment)) else None,
            extent.segment.name,
            extent.at_border,
        )
        for extent in extents
    )


def _of_masks(subject: Subject, masks: Mapping[str, Path], values: Values) -> tuple[LabelSummary, ...]:
    """Return the structures of a subject with a file for each, measured if this is fast."""
    if sum(map(_unpacked_bytes, masks.values())) > _MOST_MEASURED:
        return tuple(LabelSummary(None, None, None, name) for name in masks)
    return tuple(
        LabelSummary(structure.value, structure.volume, None, structure.name, structure.at_border)
        for structure in structures_of(subject, values)
    )


def _unpacked_bytes(path: Path) -> int:
    """Return the unpacked size of a file; gzip stores it at the end."""
    size = path.stat().st_size
    if not path.name.endswith(".gz") or size < _GZIP_END:
        return size
    with path.open("rb") as stream:
        stream.seek(size - _GZIP_END)
        return int.from_bytes(stream.read(), "little")


def _framed(segmentation: Segmentation) -> Segmentation:
    """Return the voxels of a structure with a margin, for slices."""
    mask = np.pad(segmentation.mask, _MARGIN)
    origin = segmentation.origin - segmentation.rotation @ (_MARGIN * segmentation.spacing)
    return Segmentation(mask, segmentation.rotation, segmentation.spacing, origin)


def _surface(voxels: Segmentation) -> tuple[TriangleMesh, int]:
    """Return the voxel surface; coarser for large numbers of voxels."""
    from skimage.measure import marching_cubes

    every = int(np.ceil((voxels.mask.size / _MOST_VOXELS) ** (1 / 3)))
    mask = np.pad(voxels.mask[::every, ::every, ::every], 1)
    corners, faces, _, _ = marching_cubes(mask.astype(np.float32), 0.5)
    points = voxels.origin + (corners - 1.0) * every * voxels.spacing @ voxels.rotation.T
    return TriangleMesh(points, faces), every


def _thumbnail(voxels: Segmentation) -> Array:
    """Draw the structure as seen from the front, the patient's right at the left."""
    axes = [int(np.argmax(np.abs(voxels.rotation[row]))) for row in (1, 2, 0)]
    if len(set(axes)) < 3:
        axes = [1, 2, 0]
    mask: BoolArray = np.transpose(voxels.mask, axes)
    signs = [voxels.rotation[row, axis] for row, axis in zip((1, 2, 0), axes, strict=True)]
    for position, flip in enumerate((signs[0] < 0, signs[1] > 0, signs[2] < 0)):
        mask = np.flip(mask, position) if flip else mask
    spacing = voxels.spacing[axes]
    hit = mask.any(axis=0)
    depth = np.where(hit, mask.argmax(axis=0) * spacing[0], np.nan)
    return _shaded(depth, spacing[1], spacing[2])


def _mesh_thumbnail(mesh: TriangleMesh) -> Array:
    """Draw a surface as seen from the front, from its vertices."""
    points = mesh.vertices - mesh.vertices.min(axis=0)
    step = float(points[:, [0, 2]].max()) / (THUMBNAIL * 0.5)
    column, row = (points[:, 0] / step).astype(int), ((points[:, 2].max() - points[:, 2]) / step).astype(int)
    depth = np.full((row.max() + 1, column.max() + 1), np.inf)
    np.minimum.at(depth, (row, column), points[:, 1])
    return _shaded(np.where(np.isinf(depth), np.nan, depth), step, step)


def _shaded(depth: FloatArray, down: float, across: float) -> Array:
    """Shade a depth map (nan in the background) and fit it into a square picture."""
    size = max(depth.shape[0] * down, depth.shape[1] * across) / (THUMBNAIL - 4)
    rows = ((np.arange(THUMBNAIL) - THUMBNAIL / 2) * size / down + depth.shape[0] / 2).astype(int)
    columns = ((np.arange(THUMBNAIL) - THUMBNAIL / 2) * size / across + depth.shape[1] / 2).astype(int)
    inside = ((rows >= 0) & (rows < depth.shape[0]))[:, None] & ((columns >= 0) & (columns < depth.shape[1]))
    fitted = depth[np.clip(rows, 0, depth.shape[0] - 1)][:, np.clip(columns, 0, depth.shape[1] - 1)]
    fitted = np.where(inside, fitted, np.nan)
    shown = np.isfinite(fitted)
    filled = np.where(shown, fitted, np.nanmax(fitted))
    slope_down, slope_across = np.gradient(filled, size)
    normal = np.stack([slope_across, -np.ones_like(filled), -slope_down], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    light = np.clip(normal @ (_LIGHT / np.linalg.norm(_LIGHT)), 0.0, 1.0)
    return frozen(np.where(shown, 70 + 185 * light, 0), np.uint8)
