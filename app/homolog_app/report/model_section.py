"""The model of a report: settings of the run, and the quality of its correspondence."""

from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from pydantic import BaseModel

from homolog.comparison.answer import Answer
from homolog.comparison.places import SurfaceCarrier
from homolog.inspection.located_particles import closest_points_on
from homolog.io.records import ResultRecord
from homolog.io.results import Result
from homolog.io.tables import write_table
from homolog.surfaces.comparison import distances_both_ways
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.nearest import areas_of_particles, nearest_particles

if TYPE_CHECKING:
    from homolog.run.landmarks import LandmarkErrors

__all__ = [
    "CorrespondenceRow",
    "correspondence_rows",
    "landmark_text",
    "settings_rows",
    "write_correspondence",
]


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
