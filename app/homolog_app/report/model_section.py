"""The model of a report: methods and settings of the run, and the quality of its correspondence."""

from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from pydantic import BaseModel

from homolog.comparison.answer import Answer
from homolog.comparison.places import SurfaceCarrier
from homolog.comparison.sample import voxel_text
from homolog.inspection.located_particles import closest_points_on
from homolog.io.records import ResultRecord
from homolog.io.results import Result
from homolog.io.tables import write_table
from homolog.settings import Procrustes
from homolog.surfaces.comparison import distances_both_ways
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.nearest import areas_of_particles, nearest_particles

if TYPE_CHECKING:
    from homolog.run.landmarks import LandmarkErrors

__all__ = [
    "CorrespondenceRow",
    "correspondence_rows",
    "correspondence_text",
    "landmark_text",
    "model_methods",
    "pose_text",
    "settings_rows",
    "write_correspondence",
]


def model_methods(record: ResultRecord) -> tuple[str, str, str]:
    """Return a paragraph each on particles, grooming and model, for the methods section of a paper."""
    return _placed(record), _groomed(record), _model(record)


def _groomed(record: ResultRecord) -> str:
    if record.source:
        return "Surfaces and their alignment are those of that program."
    spacings = [subject.spacing for subject in record.subjects if subject.spacing]
    spacing = f" at {_range(spacings, '.3g')} mm" if spacings else ""
    vertices = [subject.vertices for subject in record.subjects if subject.vertices]
    surfaces = f" Surfaces had {_range(vertices, 'd')} vertices." if vertices else ""
    voxels = [sorted(subject.voxel) for subject in record.subjects if subject.voxel]
    edges = f"Voxels of the files were {voxel_text(voxels)} mm (the shortest edge first). " if voxels else ""
    return (
        f"{edges}Segmentations were cleaned (enclosed cavities filled) and antialiased{spacing}; surfaces "
        f"are the zero levels of signed distance fields.{surfaces} All settings are in settings.csv."
    )


def _model(record: ResultRecord) -> str:
    smoothed = record.smoothed_particles
    surface = (
        f", which is smoother around {smoothed} particles, where the mean or a mode would fold"
        if smoothed
        else ""
    )
    folds = f" {record.folded_faces} of its faces are folded." if record.folded_faces else ""
    remarks = _REPAIRED if any("repaired" in remark for remark in record.remarks) else ""
    return (
        f"The shape model is a principal component analysis of the particle positions, {pose_text(record)} "
        "(variances with the divisor n - 1). The mean surface is the mesh of the subject nearest to the "
        f"mean, warped to the mean particles by a thin-plate spline{surface}.{folds}{remarks}"
    )


_REPAIRED = (
    " During the run misplaced particles were moved to the positions predicted by the other subjects, and "
    "optimized again."
)


def _range(values: Sequence[float], form: str) -> str:
    low, high = format(min(values), form), format(max(values), form)
    return low if low == high else f"{low} to {high}"


def _placed(record: ResultRecord) -> str:
    count = f"{len(record.subjects)} shapes, {record.particles} on each,"
    program = f"Homolog {record.versions.get('homolog', '')}"
    if record.source:
        return (
            f"Corresponding points on {count} were placed by another program and imported with {program} "
            f"from {record.source}."
        )
    method = record.settings.optimize.method
    ended = "converged" if record.ended == "converged" else "was stopped before convergence"
    mirrored = f" Before that, {record.mirrored_text}." if record.mirrored_text else ""
    marked = ", first points on landmarks" if record.settings.optimize.landmarks else ""
    return (
        f"Corresponding points were placed with {program} on {count} by entropy-based particle optimization "
        f"[homolog, datar, cates] with {record.metric} distances between particles on a shape (method "
        f"{method}, seed {record.settings.optimize.seed}{marked}). The optimizer {ended} after "
        f"{record.iterations} iterations.{mirrored} {_jointly(record)} "
        f"{_POSES[record.settings.placing.procrustes]}"
    )


def _jointly(record: ResultRecord) -> str:
    size = record.settings.optimize.core_set
    if size is None or size >= len(record.subjects):
        return "All shapes were optimized jointly."
    return f"A core set of {size} shapes was optimized jointly, and the others were fitted to it one by one."


def pose_text(record: ResultRecord) -> str:
    """Describe the alignment and size of the model's shapes."""
    if record.source:
        return "as they were imported"
    return _MODEL_POSES[record.settings.placing.procrustes]


_MODEL_POSES = {
    Procrustes.OFF: "as grooming aligned them",
    Procrustes.RIGID: "aligned rigidly by their particles, with their own sizes",
    Procrustes.FORM: "aligned rigidly by their particles, with their own sizes",
    Procrustes.SIMILARITY: "aligned by their particles and scaled to one size",
}
_POSES = {
    Procrustes.OFF: "During the optimization they remained in their poses after grooming.",
    Procrustes.RIGID: "During the optimization they were aligned rigidly by their particles.",
    Procrustes.FORM: (
        "During the optimization they were aligned by their particles and scaled to one size; the positions "
        "that are analyzed have their original sizes."
    ),
    Procrustes.SIMILARITY: (
        "During the optimization they were aligned by their particles and scaled to one size."
    ),
}


def _values_of(settings: BaseModel) -> Iterator[tuple[str, str]]:
    """Yield the name and the value, with its unit, of each setting."""
    for name, value in settings.model_dump(mode="json").items():
        extra = type(settings).model_fields[name].json_schema_extra
        shown = extra if isinstance(extra, dict) else {}
        unit = f" {shown['unit']}" if shown.get("unit") else ""
        if value is None:
            yield name, str(shown.get("if_none", "automatic"))
        elif isinstance(value, bool):
            yield name, "yes" if value else "no"
        elif isinstance(value, list):
            yield name, ", ".join(map(str, value)) or "none"
        else:
            yield name, f"{value}{unit}"


def settings_rows(record: ResultRecord, answers: Sequence[Answer]) -> list[tuple[str, str, str]]:
    """Return every setting and version: part, name, value."""
    rows = [
        (part, name, value)
        for part, model in (("groom", record.settings.groom), ("optimize", record.settings.optimize))
        for name, value in _values_of(model)
    ]
    rows += [("run", "alignment by particles", record.settings.placing.procrustes.value)]
    rows += [("run", "device", record.device), ("run", "fingerprint", record.fingerprint)]
    for number, answer in enumerate(answers, start=1):
        rows += [
            (f"question {number}", name, value)
            for name, value in _values_of(answer.question)
            if name != "earlier" and not (name in ("pairs", "covariates", "between") and value == "none")
        ]
    return rows + [("version", name, number) for name, number in record.versions.items()]


_FILE = "correspondence.csv"


@dataclass(frozen=True, slots=True)
class CorrespondenceRow:
    """The quality of the representation of a subject's surface by its particles.

    Attributes
    ----------
    name : str
        The subject.
    off_surface_mm : float
        Mean distance of its particles from its surface.
    unevenness_percent : float
        Standard deviation of the areas of the particles, divided by their mean.
    farthest_mm : float
        Largest distance of a vertex of the surface from its nearest particle on the same side of a wall.
    surface_mean_mm, surface_p95_mm : float
        Mean and 95th percentile of the distances between its surface and the mean surface warped to its
        particles, over the area of both.
    """

    name: str
    off_surface_mm: float
    unevenness_percent: float
    farthest_mm: float
    surface_mean_mm: float
    surface_p95_mm: float


def correspondence_rows(
    meshes: Sequence[TriangleMesh], result: Result, carrier: SurfaceCarrier
) -> list[CorrespondenceRow]:
    """Measure the correspondence of each subject in aligned coordinates; meshes are in file coordinates."""
    rows = []
    for index, (name, surface) in enumerate(zip(result.names, meshes, strict=False)):
        mesh = surface.placed(result.alignments[index])
        particles = result.world[index]
        nearest = nearest_particles(mesh, particles)
        areas = areas_of_particles(mesh, nearest, len(particles))
        carried = TriangleMesh(carrier.moved(particles), carrier.mesh.faces)
        apart = distances_both_ways(mesh, carried)
        rows.append(
            CorrespondenceRow(
                name=name,
                off_surface_mm=float(closest_points_on(mesh, particles)[2].mean()),
                unevenness_percent=100.0 * float(areas.std() / areas.mean()),
                farthest_mm=float(np.linalg.norm(mesh.vertices - particles[nearest], axis=1).max()),
                surface_mean_mm=apart.mean,
                surface_p95_mm=apart.percentile(95.0),
            )
        )
    return rows


def correspondence_text(rows: Sequence[CorrespondenceRow]) -> str:
    """Return how well particles represent the surfaces, in a sentence; empty without surfaces."""
    if not rows:
        return ""
    worst = max(rows, key=lambda row: row.surface_mean_mm)
    mean = float(np.mean([row.surface_mean_mm for row in rows]))
    return (
        f"Surfaces lie {mean:.2g} mm on average from the mean surface that is warped to their particles, at "
        f"most {worst.surface_mean_mm:.2g} mm ({worst.name}; each subject: correspondence.csv). "
    )


def write_correspondence(folder: Path, rows: Sequence[CorrespondenceRow]) -> None:
    """Write the rows as a table into the report's folder."""
    columns = [field.name for field in fields(CorrespondenceRow)]
    write_table(folder / _FILE, columns, [astuple(row) for row in rows])


def landmark_text(errors: "LandmarkErrors") -> str:
    """Return a sentence about all landmarks."""
    worst = int(errors.by_landmark.argmax())
    return (
        f"{len(errors.names)} landmarks of {len(errors.subjects)} subjects, transferred to each other: mean "
        f"error {errors.mean:.2f} mm, median {errors.median:.2f} mm; worst {errors.names[worst]}, mean "
        f"{errors.by_landmark[worst]:.2f} mm"
    )
