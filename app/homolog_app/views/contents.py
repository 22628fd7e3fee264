"""Contents of the views: subjects, and shapes of the model."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from homolog.arrays import Array, BoolArray, FloatArray
from homolog.cohort import Subject
from homolog.errors import InputError
from homolog.geometry import transform_points
from homolog.settings import GroomSettings
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.mirroring import mirrors
from homolog_app.rendering.colours import ColourScale, colours_by_place
from homolog_app.rendering.scene import Arrows
from homolog_app.studies.loaded_result import LoadedResult
from homolog_app.views.content import Content, SubjectContents

if TYPE_CHECKING:
    from homolog.grooming import GroomedSubject
    from homolog_app.studies.file_survey import FileSurvey
    from homolog_app.studies.model_shape import ModelShape

__all__ = [
    "MEAN",
    "MEAN_OF",
    "DisplayOptions",
    "Groomed",
    "aligned_surfaces",
    "arrow_factor",
    "mesh_file",
    "model_content",
    "moment_of",
    "named_surface",
    "outward_sign",
    "realigned",
    "region_border",
    "single_subject",
    "subject_contents",
    "untitled",
]


@dataclass(frozen=True, slots=True, eq=False)
class Groomed:
    """A groomed subject, its (4, 4) alignment to the cohort, and the settings it was groomed with."""

    subject: "GroomedSubject"
    alignment: FloatArray
    settings: GroomSettings


def moment_of(loaded: LoadedResult, index: int) -> tuple[dict[str, FloatArray], Array]:
    """Return the particles (N, 3) [mm] of each subject in a recorded frame of the run, and their colours.

    All frames with the same number of particles have the colours of the last of these frames.
    """
    names, final, frame = loaded.result.names, loaded.result.world, loaded.frames[index]
    stages = [each.particles for each in loaded.frames] + [final]
    stage_particles = next(stage for stage in reversed(stages) if stage.shape[1] == frame.particles.shape[1])
    shown = frame.particles
    if index == len(loaded.frames) - 1:
        shown = final
    elif frame.alignments is not None:
        shown = realigned(frame.particles, frame.alignments, loaded.result.alignments)
    return dict(zip(names, shown, strict=True)), colours_by_place(np.asarray(stage_particles).mean(axis=0))


def realigned(particles: FloatArray, before: FloatArray, after: FloatArray) -> FloatArray:
    """Return the particles (M, n, 3) of aligned shapes as other alignments (M, 4, 4) place the shapes."""
    return transform_points(after @ np.linalg.inv(before), particles)


def subject_contents(
    subjects: Sequence[Subject],
    surveys: "Mapping[str, FileSurvey]",
    groomed: Mapping[str, Groomed],
    result: LoadedResult | None,
) -> SubjectContents:
    """Return the contents of all subjects.

    With a result, its surfaces are shown; without one, the groomed surfaces, or the input of subjects that
    are not groomed. Subjects without an alignment are centred.
    """
    alignments = dict(zip(result.result.names, result.result.alignments, strict=True)) if result else {}
    turned = dict(zip(alignments, mirrors(result.result.alignments).tolist(), strict=True)) if result else {}

    def made(place: int) -> Content:
        subject = subjects[place]
        survey, smooth = surveys.get(subject.name), groomed.get(subject.name)
        raw = survey.surface if survey else None
        fine, coarse = (smooth.subject.mesh, smooth.subject.coarse_mesh) if smooth else (None, None)
        alignment = smooth.alignment if smooth else None
        if result is not None and subject.name in alignments:
            fine, coarse = result.surfaces[subject.name]
            alignment = alignments[subject.name]
        if alignment is None:
            alignment = np.eye(4)
            if raw is not None:
                alignment[:3, 3] = -raw.vertices.mean(axis=0)
        mirrored = turned.get(subject.name, smooth is not None and bool(mirrors(alignment)))
        notes = [subject.group or "", "mirrored" if mirrored else ""]
        if fine is None and survey is not None and survey.every > 1:
            notes.append(f"every {_ORDINALS.get(survey.every, f'{survey.every}th')} voxel")
        note = " · ".join(note for note in notes if note)
        return Content(subject.name, raw, fine, coarse, alignment, note)

    return SubjectContents([subject.name for subject in subjects], made)


_ORDINALS = {2: "second", 3: "third"}
_ARROW_SHARE = 0.09
_FACTORS = (1.0, 2.0, 5.0)


@dataclass(frozen=True, slots=True, eq=False)
class DisplayOptions:
    """Display options of displacements.

    Attributes
    ----------
    scale : ColourScale or None
        None for surfaces of one colour.
    arrows : float
        Magnification of arrows; 0 draws none.
    from_middle : bool
        Whether values are positive away from the centre of the shape, rather than out of the tissue.
    """

    scale: ColourScale | None = None
    arrows: float = 0.0
    from_middle: bool = False


def model_content(
    shape: "ModelShape",
    name: str,
    note: str,
    moved: Array,
    look: DisplayOptions,
    *,
    values: Array | None = None,
    ways: Array | None = None,
    faded: BoolArray | None = None,
    alignment: FloatArray | None = None,
) -> Content:
    """Return a shape of the model.

    Parameters
    ----------
    shape : ModelShape
    name, note : str
        The caption's lines.
    moved : (V, 3) array
        Displacement of the drawn vertices from the mean surface [mm].
    look : DisplayOptions
    values : (V,) array, optional
        Values of the colours [mm]; the outward component of `moved` if not given.
    ways : (V, 3) array, optional
        Vectors of the arrows [mm]; `moved` if not given.
    faded : (V,) bool array, optional
        Vertices that are drawn grey, without arrows, and with a line around them.
    alignment : (4, 4) array, optional
        Rigid motion of the whole shape, such as an alignment to another model.
    """
    placed = np.eye(4) if alignment is None else alignment
    vertices: Array = shape.mean.vertices.astype(np.float32) + moved
    normals = shape.normals(vertices)
    colours = None
    if look.scale is not None:
        outward = shape.outward(moved) if values is None else values
        if look.from_middle:
            outward = outward * outward_sign(shape.mean.vertices, shape.mean_normals)
        colours = look.scale.colours(outward, faded)
    arrows = None
    if look.arrows:
        at = shape.arrows_at if faded is None else shape.arrows_at[~faded[shape.arrows_at]]
        arrows = _arrows(
            vertices[at], normals[at], look.arrows * (moved if ways is None else ways)[at], placed
        )
    lines = None if faded is None else _placed(region_border(vertices, shape.mean.faces, faded), placed)
    mesh = TriangleMesh(vertices, shape.mean.faces)
    return Content(name, None, mesh, None, placed, note, colours, normals, arrows, lines)


def outward_sign(vertices: Array, normals: Array) -> Array:
    """Return 1 for vertices (V, 3) whose outward normal points away from their centre, -1 for others."""
    away = np.einsum("vi,vi->v", vertices - vertices.mean(axis=0), normals)
    return np.where(away >= 0.0, 1.0, -1.0)


def untitled(content: Content, models: "Sequence[ModelShape]") -> Content:
    """Return a shape of a model without the project's name, unless another project is shown as well."""
    if len(models) > 1:
        return content
    mirrored = models[0].result.mirrored
    note = f"{content.note} · {mirrored} mirrored" if mirrored else content.note
    return replace(content, note=note, titled=False)


def single_subject(subject: Content) -> Content:
    """Return a subject with only its groomed surface and a corresponding caption."""
    return replace(subject, raw=None, note="groomed surface")


def arrow_factor(shape: "ModelShape", limit: float) -> float:
    """Return a round factor that makes arrows of a displacement (limit, mm) visible; at least 1."""
    exact = _ARROW_SHARE * float(np.ptp(shape.mean.vertices, axis=0).mean()) / limit
    if exact <= 1.0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(exact))
    return float(max(factor for factor in _FACTORS if factor * power <= exact) * power)


def region_border(vertices: Array, faces: Array, inside: BoolArray) -> FloatArray:
    """Return the segments (S, 2, 3) of a region's border, through the midpoints of edges that cross it."""
    marks = inside[faces]
    count = marks.sum(axis=1)
    mixed = (count == 1) | (count == 2)
    corners, marks = faces[mixed], marks[mixed]
    odd = np.where(count[mixed] == 1, marks.argmax(axis=1), marks.argmin(axis=1))
    rows = np.arange(len(corners))
    apex = vertices[corners[rows, odd]]
    ends = [vertices[corners[rows, (odd + step) % 3]] for step in (1, 2)]
    return np.asarray(np.stack([(apex + end) / 2.0 for end in ends], axis=1))


def _arrows(points: Array, normals: Array, vectors: Array, placed: FloatArray) -> Arrows:
    """Return arrows outside the surface: inward ones end on it, the others begin on it."""
    inward = np.einsum("ai,ai->a", vectors, normals) < 0.0
    starts = points - np.where(inward[:, None], vectors, 0.0)
    return Arrows(_placed(starts, placed), vectors @ placed[:3, :3].T)


def _placed(points: Array, placed: FloatArray) -> FloatArray:
    return np.asarray(transform_points(placed, points))


MEAN, MEAN_OF = "mean", "mean of "
"""Names of the mean surface, and of a group's mean."""


def named_surface(
    name: str, shape: "ModelShape", own: Mapping[str, TriangleMesh], groups: Sequence[str | None]
) -> tuple[TriangleMesh, FloatArray | None]:
    """Return an aligned surface by its name, and its particles (N, 3) [mm] if it has any.

    Parameters
    ----------
    name : str
        A subject, ``"mean"``, ``"mean of GROUP"``, or a mesh file in aligned coordinates.
    shape : ModelShape
    own : mapping of str to TriangleMesh
        The subjects' aligned surfaces.
    groups : sequence of str or None
        Of the subjects of the model.

    Raises
    ------
    InputError
        If there is no such subject, group or file, or the file contains no surface.
    """
    if name in own:
        return own[name], shape.result.world[shape.result.names.index(name)]
    if name == MEAN:
        return shape.mean, shape.model.mean
    of_group = [index for index, group in enumerate(groups) if f"{MEAN_OF}{group or ''}" == name]
    if of_group:
        deviations = shape.model.scores[of_group].mean(axis=0) / shape.model.standard_deviations
        vertices = shape.mean.vertices + shape.moved(deviations)
        return TriangleMesh(vertices, shape.mean.faces), shape.model.instance(deviations)
    if not Path(name).is_file():
        raise InputError(f"{name}: not found; give a subject, 'mean', 'mean of GROUP', or a mesh file")
    return mesh_file(Path(name)), None


def aligned_surfaces(loaded: LoadedResult) -> dict[str, TriangleMesh]:
    """Return the subjects' surfaces in aligned coordinates."""
    result = loaded.result
    return {
        name: loaded.surfaces[name][0].placed(alignment)
        for name, alignment in zip(result.names, result.alignments, strict=True)
    }


@lru_cache(maxsize=4)
def mesh_file(path: Path) -> TriangleMesh:
    """Return the surface of a file, with its faces outward; raises InputError if there is none."""
    from homolog.io.meshes import read_mesh  # loads VTK

    mesh = read_mesh(path)
    return mesh if mesh.volume >= 0.0 else TriangleMesh(mesh.vertices, mesh.faces[:, ::-1])
