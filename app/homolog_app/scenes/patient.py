"""Computations and views of the page *Patient*."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from homolog.arrays import Array, BoolArray, FloatArray
from homolog.cohort import Subject
from homolog.geometry import inverse_matrices, transform_points
from homolog.progress import Tick
from homolog.surfaces.mesh import TriangleMesh, joined
from homolog_app.rendering.colours import ColourScale, displacement_scale, thickness_scale
from homolog_app.rendering.content import Content, ViewContents
from homolog_app.rendering.text import signed, typeset
from homolog_app.scenes.shapes import region_border

if TYPE_CHECKING:
    from homolog.io.images import Segmentation
    from homolog.patient import JointComparison, JointReference, PatientComparison, Reference, Region
    from homolog_app.scenes.slices import SliceScene

__all__ = [
    "EXPECTED",
    "MEAN",
    "WALL",
    "ComparedFile",
    "ComparedPatient",
    "PatientDisplay",
    "Z",
    "about_texts",
    "compared",
    "finding_text",
    "joint_scene",
    "nearest_text",
    "on_own_surface",
    "on_patient",
    "patient_scene",
    "patient_slices",
    "region_place",
]


def finding_text(
    comparison: "PatientComparison | JointComparison | None",
    reference: "Reference | JointReference | None",
) -> str:
    """Describe the findings; an empty text without a patient."""
    if comparison is None or reference is None:
        return ""
    from homolog.patient.findings import findings

    return typeset("\n\n".join(f"{text[:1].upper()}{text[1:]}" for text in findings(comparison, reference)))


def nearest_text(comparison: "PatientComparison | None", reference: "Reference | None") -> str:
    """Name the nearest controls; an empty text without a patient or stored scores."""
    if comparison is None or reference is None:
        return ""
    from homolog.patient.findings import nearest_controls_text

    return nearest_controls_text(comparison, reference)


def about_texts(reference: "Reference | JointReference | None") -> tuple[str, str]:
    """Return a description of the reference, or how to make one, and the cautions about it."""
    if reference is None:
        return "No reference yet. Make one from this result or open a file.", ""
    from homolog.patient.findings import reference_text

    lines = [f"{line[:1].upper()}{line[1:]}." for line in reference_text(reference.anonymous())]
    cautions = [line for line in lines if line.startswith("Caution")]
    return "\n".join(line for line in lines if line not in cautions), "\n".join(cautions)


EXPECTED, MEAN, WALL, Z = "expected", "mean", "wall", "z"
"""Maps: difference from the expected shape [mm], from the mean [mm], of the wall's thickness from the
expected one [%], and z of position and thickness [SD]."""


@dataclass(frozen=True, slots=True)
class PatientDisplay:
    """Display options of a patient.

    Attributes
    ----------
    kind : str
        The map, one of `MAPS`.
    count : int
        1 shows the map, 4 the mean, the patient, the expected shape and the map.
    way : float
        Position of the shape with the map between the mean (0) and the patient (1).
    by_modes : bool
        Whether the path follows one mode after the other, rather than a straight line.
    overlaid : bool
        Whether the patient is drawn transparent over the mean.
    only_beyond : bool
        Whether differences within the limit are grey.
    """

    kind: str
    count: int
    way: float
    by_modes: bool
    overlaid: bool
    only_beyond: bool


def joint_scene(
    comparison: "JointComparison", reference: "JointReference", look: PatientDisplay
) -> ViewContents:
    """Return the contents of the views with all structures as they lie in the patient.

    The mean's structures lie as the reference expects them to lie to each other.
    """
    alone = {name: (own, reference.structures[name]) for name, own in comparison.structures.items()}
    widest = max((_scale(*pair, look.kind)[0] for pair in alone.values()), key=lambda scale: scale.high)
    scenes = [patient_scene(*pair, look, widest) for pair in alone.values()]
    usual = [_to_expected(name, comparison, reference) for name in alone]
    ways = [look.way] if look.count == 1 else [0.0, 1.0, 1.0, look.way]
    lead = comparison.structures[reference.poses[0].against if reference.poses else next(iter(alone))]
    contents = []
    for place, way in enumerate(ways):
        parts = [
            _moved(scene.contents[place], lead.placement, pose, way)
            for scene, pose in zip(scenes, usual, strict=True)
        ]
        contents.append(_together(list(alone), parts, comparison.name))
    return replace(scenes[0], contents=contents)


def _to_expected(name: str, comparison: "JointComparison", reference: "JointReference") -> FloatArray:
    """Return the motion (4, 4) of a patient's structure to where the reference expects it, in the file."""
    norm = next((item for item in reference.poses if item.structure == name), None)
    if norm is None or norm.against not in comparison.structures:
        return np.eye(4)
    own, lead = comparison.structures[name], comparison.structures[norm.against]
    columns, _ = reference.first.coding.columns(own.covariates)
    return np.asarray(inverse_matrices(lead.placement) @ norm.expected(columns) @ own.placement)


def _moved(content: Content, frame: FloatArray, motion: FloatArray, way: float) -> Content:
    """Return the view of a structure in a common frame, part of the way from its expected pose."""
    drawn = content.groomed or content.raw
    assert drawn is not None, "a patient's views have a surface"

    def placed(mesh: TriangleMesh | None, way: float) -> TriangleMesh | None:
        return None if mesh is None else mesh.placed(_part_of_motion(motion, drawn, 1.0 - way))

    lines = content.lines
    if lines is not None:
        place = frame @ _part_of_motion(motion, drawn, 1.0 - way) @ inverse_matrices(content.alignment)
        lines = transform_points(place, lines)
    raw = placed(content.raw, 0.0 if content.overlaid else way)
    return replace(content, raw=raw, groomed=placed(content.groomed, way), alignment=frame, lines=lines)


def _part_of_motion(motion: FloatArray, mesh: TriangleMesh, share: float) -> FloatArray:
    """Return a share of a rigid motion (4, 4), in which the centre of a surface moves straight."""
    from scipy.spatial.transform import Rotation

    centre, part = mesh.vertices.mean(axis=0), np.eye(4)
    turn = Rotation.from_matrix(motion[:3, :3]).as_rotvec()
    part[:3, :3] = Rotation.from_rotvec(share * turn).as_matrix()
    part[:3, 3] = centre - part[:3, :3] @ centre
    part[:3, 3] += share * (transform_points(motion, centre[None])[0] - centre)
    return part


def _together(names: Sequence[str], parts: Sequence[Content], title: str) -> Content:
    """Return the views of several structures in one frame as one."""
    first = parts[0]
    whole: dict[str, Any] = {}
    for name in ("raw", "groomed"):
        meshes = [mesh for part in parts if (mesh := getattr(part, name)) is not None]
        whole[name] = joined(meshes) if len(meshes) == len(parts) else None
    colours = [part.colours for part in parts if part.colours is not None]
    lines = [part.lines for part in parts if part.lines is not None]
    return replace(
        first,
        **whole,
        note=first.note if all(part.note == first.note for part in parts) else title,
        colours=np.concatenate(colours) if len(colours) == len(parts) else None,
        lines=np.concatenate(lines) if lines else None,
        structures=dict.fromkeys(names, 0),
    )


def patient_scene(
    comparison: "PatientComparison",
    reference: "Reference",
    look: PatientDisplay,
    common: ColourScale | None = None,
) -> ViewContents:
    """Return the contents of the views, with a scale that is common to several structures if there is one."""
    kind, count, only_beyond = look.kind, look.count, look.only_beyond
    scale, values = _scale(comparison, reference, kind)
    scale = common or scale
    beyond = np.abs(comparison.z) > reference.limit
    faded, grey = comparison.missing, ["cut off"] if comparison.missing.any() else []
    if only_beyond and kind != MEAN:
        faded, grey = faded | ~beyond, [*grey, "within the limit of 5 % of healthy subjects"]
        scale = replace(scale, note="" if kind in (EXPECTED, WALL) else scale.note)  # grey instead of faint
    scale = replace(scale, grey_label=" or ".join(grey))
    steps = _steps(comparison, reference) if look.by_modes else _straight(comparison)
    note, vertices = _point_on_path(comparison.mean.vertices, steps, look.way)
    if look.way == 0.0:
        colours = scale.colours(values, faded, None if kind == MEAN else ~beyond)
        mapped = on_patient(comparison, comparison.name, note, comparison.mean, colours, beyond)
    else:
        moved = vertices - comparison.matched.vertices if look.way < 1.0 else None
        mapped = on_own_surface(
            comparison,
            comparison.name,
            note,
            scale,
            values,
            beyond,
            faded=faded,
            faint=kind != MEAN,
            moved=moved,
        )
    if look.overlaid:
        mean = comparison.mean.placed(inverse_matrices(comparison.placement))
        notes = filter(None, (note, "transparent over the mean"))
        mapped = replace(mapped, raw=mean, overlaid=True, note=", ".join(notes))
    if count == 1:
        return ViewContents([mapped], 1, scale, {})
    plain = [
        on_patient(comparison, "Mean", "of the reference, at the patient's covariates", comparison.mean),
        Content("Patient", None, comparison.mesh, None, comparison.placement, comparison.name),
        on_patient(comparison, "Expected", "by the reference, for this patient", comparison.expected),
    ]
    return ViewContents([*plain, mapped], 2, scale, {})


_Step = tuple[str, FloatArray]
"""A step from the mean to the patient: its title, and the vertices (V, 3) after it."""


def _straight(comparison: "PatientComparison") -> list[_Step]:
    return [("from the mean to the patient", comparison.matched.vertices)]


def _steps(comparison: "PatientComparison", reference: "Reference") -> list[_Step]:
    """Return the steps along each mode above chance, along the further modes, and outside the modes."""
    model, scores = reference.model, comparison.fit.scores
    moves = model.components[:, : model.vertices]
    vertices = comparison.mean.vertices
    steps: list[_Step] = []
    for mode in range(min(reference.modes, len(scores))):
        vertices = vertices + scores[mode] * moves[mode]
        deviations = scores[mode] / np.sqrt(model.variances[mode])
        steps.append((f"of mode {mode + 1} ({signed(deviations, 1)} SD)", vertices))
    if len(scores) > reference.modes:
        steps.append(("of further modes", comparison.expected.vertices))
    return [*steps, ("of the difference outside the modes", comparison.matched.vertices)]


def _point_on_path(start: FloatArray, steps: Sequence[_Step], way: float) -> _Step:
    """Return the title and the vertices at a fraction of the path, with steps of equal length."""
    if way in (0.0, 1.0):
        return ("the mean", start) if way == 0.0 else ("", steps[-1][1])
    index = min(int(way * len(steps)), len(steps) - 1)
    share = way * len(steps) - index
    title, after = steps[index]
    before = steps[index - 1][1] if index else start
    return f"{100.0 * share:.0f} % {title}", before + share * (after - before)


def region_place(comparison: "PatientComparison", region: "Region") -> tuple[FloatArray, FloatArray]:
    """Return a point (3,) of a region on the patient's own surface as displayed, and its view direction.

    If the patient's surface is far from the expected one, it is the closest point.
    """
    from homolog_app.pictures.layout import view_of_region

    own, shape = comparison.own, comparison.own.mesh.placed(comparison.placement)
    marks = np.zeros(len(comparison.matched.vertices))
    marks[region.vertices], marks[region.centre] = 0.5, 1.0
    shares = own.carried(marks)
    vertex = int(shares.argmax())
    if not shares[vertex]:
        vertex = int(
            np.linalg.norm(shape.vertices - comparison.matched.vertices[region.centre], axis=1).argmin()
        )
    inside = np.union1d(np.flatnonzero(shares), vertex)
    return shape.vertices[vertex], np.array(view_of_region(shape, inside, vertex).axes[2])


@dataclass(frozen=True, slots=True, eq=False)
class ComparedPatient:
    """A compared patient, with the data of its file for the page.

    Attributes
    ----------
    comparison : PatientComparison
    subject : Subject
        The patient's file.
    places : sequence of ((3,) array, (3,) array)
        Point of each region, and the direction from which it is visible, since other walls may hide it.
    image : Path or None
        The scan behind the segmentation.
    voxels : Segmentation or None
        None for surfaces.
    """

    comparison: "PatientComparison"
    subject: Subject
    places: Sequence[tuple[FloatArray, FloatArray]]
    image: Path | None
    voxels: "Segmentation | None"


@dataclass(frozen=True, slots=True, eq=False)
class ComparedFile:
    """A patient's file that was compared.

    Attributes
    ----------
    comparison : PatientComparison or JointComparison
    parts : mapping of str to ComparedPatient
        By structure; that of a single one has no name.
    """

    comparison: "PatientComparison | JointComparison"
    parts: Mapping[str, ComparedPatient]


def compared(
    reference: "Reference | JointReference",
    path: Path,
    values: Mapping[str, str],
    cut_off: bool,
    tick: Tick,
) -> ComparedFile:
    """Compare a patient's file with a reference; raises InputError if it can't be compared."""
    from homolog.patient import JointReference, compare_joint_patient, compare_patient
    from homolog.patient.files import patient_at
    from homolog.patient.findings import pairs_of
    from homolog_app.scenes.file_survey import surveys

    comparison: PatientComparison | JointComparison
    if isinstance(reference, JointReference):
        subject = patient_at(path, reference.files)
        values = {**values, **subject.columns}
        comparison = compare_joint_patient(reference, subject, values, cut_off=cut_off, tick=tick)
    else:
        subject = patient_at(path)
        comparison = compare_patient(reference, subject, values, cut_off=cut_off, tick=tick)
    parts = {}
    for name, (own, against) in pairs_of(comparison, reference).items():
        places = [region_place(own, region) for region in own.regions]
        (survey,) = surveys([subject], against.provenance.groom)
        parts[name] = ComparedPatient(own, subject, places, subject.image, survey.voxels)
    return ComparedFile(comparison, parts)


def patient_slices(compared: ComparedPatient, reference: "Reference") -> "SliceScene":
    """Return the slices of a patient: scan, segmentation, and the map of z as a contour."""
    from homolog_app.scenes.slices import Outline, SliceScene

    comparison = compared.comparison
    scale, z = _scale(comparison, reference, Z)
    own = comparison.own
    colours = scale.colours(own.carried(z), own.marked(comparison.missing))
    note = f"Contour: z, blue outward, yellow inward, ends ± {scale.high:.1f}, limit ± {reference.limit:.1f}"
    outline = Outline("Map", own.mesh, colours, note)
    return SliceScene(comparison.name, compared.image, compared.voxels, [outline])


def _scale(
    comparison: "PatientComparison", reference: "Reference", kind: str
) -> tuple[ColourScale, FloatArray]:
    from homolog_app.rendering.colours import common_limit

    if kind == Z:
        reach = np.array([max(1.5 * reference.limit, 1.0)])
        scale = displacement_scale(
            common_limit([reach]), "Difference from the expected shape", f"limit ± {reference.limit:.1f}"
        )
        return replace(scale, unit="SD"), comparison.z
    if kind == WALL:
        percent = 100.0 * comparison.thicker
        return thickness_scale(common_limit([percent]), "faint within the limit"), percent
    limit = common_limit([comparison.residual, comparison.total])
    if kind == MEAN:
        return displacement_scale(limit, "Difference from the mean of the reference"), comparison.total
    note = "faint within the limit"
    return displacement_scale(limit, "Difference from the expected shape", note), comparison.residual


def on_patient(
    comparison: "PatientComparison",
    name: str,
    note: str,
    shape: TriangleMesh,
    colours: Array | None = None,
    beyond: BoolArray | None = None,
) -> Content:
    """Return a shape in the reference's frame, with letters for the patient's directions."""
    back = inverse_matrices(comparison.placement)
    lines = None
    if beyond is not None and beyond.any():
        lines = region_border(shape.vertices, shape.faces, beyond)
    local = TriangleMesh(transform_points(back, shape.vertices), shape.placed(back).faces)
    return Content(name, None, local, None, comparison.placement, note, colours, None, None, lines)


def on_own_surface(
    comparison: "PatientComparison",
    name: str,
    note: str,
    scale: ColourScale,
    values: FloatArray,
    beyond: BoolArray | None,
    *,
    faded: BoolArray | None,
    faint: bool,
    moved: FloatArray | None = None,
) -> Content:
    """Return a patient's own surface with a map; values and marks are those of the reference's vertices.

    Parameters
    ----------
    comparison : PatientComparison
    name, note : str
        Lines of the view's caption.
    scale : ColourScale
    values : (V,) array
    beyond : (V,) bool array or None
        Vertices beyond the limit, which get a border.
    faded : (V,) bool array or None
        Vertices that are drawn grey.
    faint : bool
        Whether the other vertices have faint colours.
    moved : (V, 3) array, optional
        Displacement of the surface in the reference's frame [mm].
    """
    own = comparison.own
    mesh = own.mesh
    if moved is not None:
        vertices = mesh.placed(comparison.placement).vertices + own.carried(moved)
        back = inverse_matrices(comparison.placement)
        mesh = TriangleMesh(transform_points(back, vertices), mesh.faces)
    inside, grey = (None if marks is None else own.marked(marks) for marks in (beyond, faded))
    colours = scale.colours(own.carried(values), grey, None if inside is None or not faint else ~inside)
    lines = None
    if inside is not None and inside.any():
        shown = mesh.placed(comparison.placement)
        lines = region_border(shown.vertices, shown.faces, inside)
    return Content(name, None, mesh, None, comparison.placement, note, colours, lines=lines)
