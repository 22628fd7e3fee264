"""How far landmarks miss that the correspondence carries from subject to subject."""

import numpy as np

from homolog.arrays import FloatArray
from homolog.errors import InputError, NumericalError
from homolog.exchange import LandmarkErrors, project_landmark_errors
from homolog.files.project import ProjectFolder
from homolog_app.report.page import Page

__all__ = ["landmark_words", "write_landmarks"]


def landmark_words(errors: LandmarkErrors) -> str:
    """Return a sentence about all landmarks."""
    worst = int(errors.by_landmark.argmax())
    return (
        f"{len(errors.names)} landmarks of {len(errors.subjects)} subjects, carried to each other: mean "
        f"error {errors.mean:.2f} mm, median {errors.median:.2f} mm; worst {errors.names[worst]}, mean "
        f"{errors.by_landmark[worst]:.2f} mm"
    )


def write_landmarks(page: Page, project: ProjectFolder) -> None:
    """Write the report's section on landmarks, if the project's subjects have any."""
    try:
        errors = project_landmark_errors(project)
    except (InputError, NumericalError) as error:
        page.heading("Landmarks")
        page.caution(f"Landmarks can't be compared. {error}")
        return
    if errors is None:
        return
    page.heading("Landmarks")
    page.paragraph(
        f"{landmark_words(errors)}. Each subject's landmarks were carried to each other subject by the "
        "thin-plate spline of the particles, put on the surface, and compared with that subject's own."
    )
    page.table(
        ["landmark", "mean (mm)", "median (mm)", "95th percentile (mm)", "largest (mm)"],
        (
            (name, *(f"{value:.2f}" for value in _figures(errors.errors[..., index])))
            for index, name in enumerate(errors.names)
        ),
    )


def _figures(errors: FloatArray) -> tuple[float, float, float, float]:
    there = errors[np.isfinite(errors)]
    median, high = np.quantile(there, [0.5, 0.95])
    return float(there.mean()), float(median), float(high), float(there.max())
