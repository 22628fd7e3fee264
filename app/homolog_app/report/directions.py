"""How places and directions are called, by what the axes of the files are."""

from dataclasses import dataclass, replace

import numpy as np

from homolog.arrays import FloatArray
from homolog.files.records import ResultRecord
from homolog.files.report_details import Axes, ReportDetails
from homolog_app.rendering.camera import VIEWS, View

__all__ = ["FILE_AXES", "PATIENT_AXES", "Directions", "directions_of"]

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


def directions_of(details: ReportDetails, record: ResultRecord | None) -> Directions:
    """Return how places are called."""
    if details.axes is not Axes.AUTO:
        return PATIENT_AXES if details.axes is Axes.PATIENT else FILE_AXES
    stated = record is not None and all(
        subject.voxel and not any(_ASSUMED in note for note in subject.notes) for subject in record.subjects
    )
    return PATIENT_AXES if stated else FILE_AXES
