"""A project's landmarks: read from the subjects' markups and compared through the correspondence."""

from dataclasses import dataclass

import numpy as np

from homolog.arrays import FloatArray, frozen
from homolog.io.markups import landmark_table, read_markups
from homolog.io.meshes import read_mesh
from homolog.io.project import ProjectFolder
from homolog.io.results import read_result, surface_file
from homolog.run.landmarks import check_landmarks
from homolog.statistics.thin_plate import landmark_errors
from homolog.surfaces.snapping import snapping

__all__ = ["LandmarkErrors", "project_landmark_errors"]


@dataclass(frozen=True, slots=True, eq=False)
class LandmarkErrors:
    """Errors of landmarks that are transferred between subjects by the correspondence.

    Attributes
    ----------
    names : tuple of str
        The L landmarks that exist on two or more subjects.
    subjects : tuple of str
        The subjects with landmarks.
    errors : (M, M, L) array
        Distances [mm] by source, target and landmark; NaN for missing landmarks.
    """

    names: tuple[str, ...]
    subjects: tuple[str, ...]
    errors: FloatArray

    @property
    def mean(self) -> float:
        """Mean distance over all pairs and landmarks [mm]."""
        return float(np.nanmean(self.errors))

    @property
    def median(self) -> float:
        """Median distance over all pairs and landmarks [mm]."""
        return float(np.nanmedian(self.errors))

    @property
    def by_landmark(self) -> FloatArray:
        """Mean distance of each landmark over all pairs [mm], (L,)."""
        means: FloatArray = np.nanmean(self.errors, axis=(0, 1))
        return means


def project_landmark_errors(project: ProjectFolder) -> LandmarkErrors | None:
    """Transfer every subject's landmarks to all others; None if fewer than two subjects share any.

    Parameters
    ----------
    project : ProjectFolder
        A project with a result. Landmarks are read from the markups files of its cohort.

    Raises
    ------
    InputError
        If there is no result, or a file of landmarks or a surface is missing or damaged.
    NumericalError
        If particles of a subject coincide.
    """
    result = read_result(project)
    record = project.read().result
    assert record is not None, "a result that was read has a record"
    files = {
        subject.name: subject.landmarks
        for subject in project.cohort().subjects
        if subject.landmarks is not None
    }
    chosen = [index for index, name in enumerate(result.names) if name in files]
    markups = [read_markups(files[result.names[index]]) for index in chosen]
    names, table = landmark_table(markups)
    if not names:
        return None
    meshes = [read_mesh(surface_file(project, record.subjects[index].file)) for index in chosen]
    for index, points, mesh in zip(chosen, table, meshes, strict=True):
        if len(placed := points[np.isfinite(points[:, 0])]):
            check_landmarks(files[result.names[index]], result.names[index], placed, mesh)
    snap = [snapping(mesh) for mesh in meshes]
    errors = landmark_errors(result.local[chosen], table, snap)
    return LandmarkErrors(names, tuple(result.names[index] for index in chosen), frozen(errors))
