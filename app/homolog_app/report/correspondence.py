"""The quality of a correspondence: how even particles are, how near to the surfaces and to landmarks."""

from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from homolog.files.results import Result
from homolog.files.tables import write_table
from homolog.inspection.located_particles import closest_points_on
from homolog.surfaces.comparison import distances_both_ways
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.nearest import areas_of_particles, nearest_particles
from homolog_app.report.page import Page
from homolog_app.report.surface_maps import SurfaceCarrier

if TYPE_CHECKING:
    from homolog.exchange import LandmarkErrors

__all__ = ["CorrespondenceRow", "add_correspondence", "correspondence_rows", "landmark_text"]

_FILE = "correspondence.csv"


@dataclass(frozen=True, slots=True)
class CorrespondenceRow:
    """How well the particles of a subject represent its surface.

    Attributes
    ----------
    name : str
        The subject.
    off_surface_mm : float
        Mean distance of its particles from its surface.
    unevenness_percent : float
        Standard deviation of the areas that particles stand for, divided by their mean.
    farthest_mm : float
        Largest distance of a vertex of the surface from its nearest particle on the same side of a wall.
    surface_mean_mm, surface_p95_mm : float
        Mean and 95th percentile of the distances between its surface and the mean surface carried to its
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
    """Measure the correspondence of each subject in aligned coordinates, from surfaces in those of files."""
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


def add_correspondence(page: Page, folder: Path, rows: Sequence[CorrespondenceRow]) -> None:
    """Add what `correspondence_rows` measured, and write it as a table into the report's folder."""
    if not rows:
        return
    columns = [field.name for field in fields(CorrespondenceRow)]
    write_table(folder / _FILE, columns, [astuple(row) for row in rows])
    titles = (
        ("particles from their own surface, mean (mm)", ".3f"),
        ("evenness: coefficient of variation of the particles' areas (%)", ".1f"),
        ("largest distance of the surface from its nearest particle (mm)", ".2f"),
        ("surface from carried mean surface, mean over the area (mm)", ".3f"),
        ("surface from carried mean surface, 95th percentile of the area (mm)", ".3f"),
    )
    table = []
    for number, (title, form) in enumerate(titles, start=1):
        values = [float(astuple(row)[number]) for row in rows]
        worst = int(np.argmax(values))
        cells = (float(np.mean(values)), min(values), max(values))
        table.append((title, *(format(value, form) for value in cells), rows[worst].name))
    page.table(
        ["measure of a subject", "mean of subjects", "least", "largest", "subject with the largest"],
        table,
        as_text=True,
        caption="Quality of the correspondence over the subjects",
    )
    page.paragraph(
        "Evenness: 0 % would be equal areas. The mean surface was carried to each subject's particles by "
        "the spline that all maps use; its distance from the subject's own surface, in both directions, is "
        "what particles and spline do not represent. Values of each subject are in correspondence.csv."
    )


def landmark_text(errors: "LandmarkErrors") -> str:
    """Return a sentence about all landmarks."""
    worst = int(errors.by_landmark.argmax())
    return (
        f"{len(errors.names)} landmarks of {len(errors.subjects)} subjects, carried to each other: mean "
        f"error {errors.mean:.2f} mm, median {errors.median:.2f} mm; worst {errors.names[worst]}, mean "
        f"{errors.by_landmark[worst]:.2f} mm"
    )
