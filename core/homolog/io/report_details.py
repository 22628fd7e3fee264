"""Details of a project for its reports, entered by the authors: structure, cohort, meaning of the axes."""

import json
import re
from enum import StrEnum
from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field
from pydantic_core import PydanticCustomError

from homolog.errors import InputError
from homolog.io.atomic import write_text
from homolog.io.project import ProjectFolder

__all__ = ["Axes", "ReportDetails", "read_details", "write_details"]

_FILE = "report.json"


class Axes(StrEnum):
    """Meaning of the axes of the files."""

    AUTO = "auto"
    PATIENT = "patient"
    FILE = "file"


_PLACES = re.compile(r"([^\s/]+/[^\s/]+ ){2}[^\s/]+/[^\s/]+")


def _checked_places(places: str) -> str:
    if places and not _PLACES.fullmatch(places):
        raise PydanticCustomError(
            "places",
            "must be two names for each axis, such as: septal/lateral anterior/inferior basal/apical",
        )
    return places


class ReportDetails(BaseModel):
    """Details for reports.

    Attributes
    ----------
    structure : str
        Name of the structure.
    cohort : str
        Description of the subjects.
    axes : Axes
        How locations are named: by the patient's directions or by the axes of the files.
    places : str
        Own names of the structure's sides, such as ``"septal/lateral anterior/inferior basal/apical"``. Two
        for each axis: towards smaller and towards larger coordinates.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    structure: Annotated[
        str,
        Field(
            max_length=200,
            description="What the shapes are, such as: left ventricle. Used in the report.",
            examples=["left ventricle"],
        ),
    ] = ""
    cohort: Annotated[
        str,
        Field(
            max_length=2000,
            description="Who the subjects are: recruitment, criteria, what the groups mean, scanner. Used in "
            "the report.",
            examples=["who was recruited, criteria, groups, scanner"],
        ),
    ] = ""
    axes: Annotated[
        Axes,
        Field(
            description="How places are named. patient: by the patient's directions (left, anterior, "
            "superior); file: by the axes of the files (+x, -z); auto: as file, until "
            "somebody has confirmed that the axes are the patient's."
        ),
    ] = Axes.AUTO
    places: Annotated[
        str,
        Field(
            max_length=200,
            description="Your own names of the structure's sides, such as: septal/lateral anterior/inferior "
            "basal/apical. Two for each axis: towards smaller and towards larger x, y and z.",
            examples=["septal/lateral anterior/inferior basal/apical"],
        ),
        AfterValidator(_checked_places),
    ] = ""


def read_details(project: ProjectFolder) -> ReportDetails:
    """Return the details stored in a project; raises InputError if their file is damaged."""
    path = project.folder / _FILE
    try:
        return ReportDetails.model_validate(json.loads(path.read_bytes()))
    except FileNotFoundError:
        return ReportDetails()
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"{path}: is damaged; delete it and enter the details again") from error


def write_details(project: ProjectFolder, details: ReportDetails) -> None:
    """Store the details in a project; raises InputError if it can't be written to."""
    if details != read_details(project):
        write_text(project.folder / _FILE, details.model_dump_json(indent=2) + "\n")
