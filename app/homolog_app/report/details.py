"""What only the authors know of a project, kept with it: structure, cohort, and what the axes are."""

import json
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from homolog.arrays import FloatArray
from homolog.errors import InputError
from homolog.files.atomic import write_text
from homolog.files.project import ProjectFolder
from homolog.files.records import ResultRecord
from homolog_app.rendering.camera import VIEWS, View

__all__ = [
    "FILE_AXES", "PATIENT_AXES", "Axes", "Directions", "ReportDetails", "directions_of", "read_details",
    "write_details",
]  # fmt: skip

_FILE = "report.json"
_ASSUMED = "axes were assumed"
"""What the notes of all files say whose header gives no orientation."""
_OFF_THE_MIDDLE = 1.0 / 3.0
"""Share of half the extent along an axis from which a place is called by that axis' side."""
_ALONG = 0.35
"""Cosine to an axis from which a direction is called by it."""


@dataclass(frozen=True, slots=True)
class Directions:
    """The names of the sides of three axes.

    Attributes
    ----------
    sides : tuple of pairs of str
        Towards smaller and larger values of each coordinate.
    """

    sides: tuple[tuple[str, str], ...]

    @property
    def are_the_patients(self) -> bool:
        """Whether they are anatomical."""
        return self is PATIENT_AXES

    def place(self, points: FloatArray, number: int) -> str:
        """Return where one of the points (N, 3) lies from the middle of all, such as ``"left posterior"``."""
        middle = (points.min(axis=0) + points.max(axis=0)) / 2.0
        return self._named(
            (points[number] - middle) / np.maximum(np.ptp(points, axis=0) / 2.0, 1e-300), _OFF_THE_MIDDLE
        )

    def way(self, vector: FloatArray) -> str:
        """Return which way a vector (3,) points."""
        return self._named(vector / max(float(np.linalg.norm(vector)), 1e-300), _ALONG)

    def view(self, name: str) -> View:
        """Return an anatomical view, captioned by the side from which it looks."""
        view = VIEWS[name]
        return (
            view if self.are_the_patients else replace(view, name=f"from {self.way(np.array(view.toward))}")
        )

    def _named(self, parts: FloatArray, least: float) -> str:
        names = [
            pair[int(part > 0.0)]
            for pair, part in zip(self.sides, parts.tolist(), strict=True)
            if abs(part) > least
        ]
        return " ".join(names) or "middle"


PATIENT_AXES = Directions((("right", "left"), ("anterior", "posterior"), ("inferior", "superior")))
"""Of LPS coordinates that are those of the patient."""
FILE_AXES = Directions((("-x", "+x"), ("-y", "+y"), ("-z", "+z")))
"""Of coordinates whose relation to the patient is not known."""


class Axes(StrEnum):
    """What the axes of the files are."""

    AUTO = "auto"
    PATIENT = "patient"
    FILE = "file"


class ReportDetails(BaseModel):
    """Details for reports."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    structure: Annotated[
        str,
        Field(
            max_length=200, description="What the shapes are, such as: left ventricle. Used in the report."
        ),
    ] = ""
    cohort: Annotated[
        str,
        Field(
            max_length=2000,
            description="Who the subjects are: recruitment, criteria, what the groups mean, scanner. Used in "
            "the report.",
        ),
    ] = ""
    axes: Annotated[
        Axes,
        Field(
            description="Whether the axes of the files are those of the patient, so that places are called "
            "left, anterior or superior, or the file's own, so that they are called +x or -z; auto: those of "
            "the patient if all files are images whose headers say so."
        ),
    ] = Axes.AUTO


def read_details(project: ProjectFolder) -> ReportDetails:
    """Return the details kept in a project; raises InputError if their file is damaged."""
    path = project.folder / _FILE
    try:
        return ReportDetails.model_validate(json.loads(path.read_bytes()))
    except FileNotFoundError:
        return ReportDetails()
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"{path}: is damaged; delete it and give its details again") from error


def write_details(project: ProjectFolder, details: ReportDetails) -> None:
    """Keep the details in a project; raises InputError if it can't be written to."""
    if details != read_details(project):
        write_text(project.folder / _FILE, details.model_dump_json(indent=2) + "\n")


def directions_of(details: ReportDetails, record: ResultRecord | None) -> Directions:
    """Return how places are called."""
    if details.axes is not Axes.AUTO:
        return PATIENT_AXES if details.axes is Axes.PATIENT else FILE_AXES
    stated = record is not None and all(
        subject.voxel and not any(_ASSUMED in note for note in subject.notes) for subject in record.subjects
    )
    return PATIENT_AXES if stated else FILE_AXES
