"""Models and landmarks to and from other programs: ShapeWorks, 3D Slicer, geometric morphometrics."""

from homolog.exchange.import_model import domains_of, import_model
from homolog.exchange.landmarks import LandmarkErrors, project_landmark_errors
from homolog.exchange.morphometrics import write_morphometrics
from homolog.exchange.shapeworks_export import write_shapeworks
from homolog.io.markups import Markups, read_markups, write_markups

__all__ = [
    "LandmarkErrors",
    "Markups",
    "domains_of",
    "import_model",
    "project_landmark_errors",
    "read_markups",
    "write_markups",
    "write_morphometrics",
    "write_shapeworks",
]
