"""A project's result with the data for the window: surfaces of its subjects, recorded frames of its run."""

import threading
from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from homolog.arrays import FloatArray, frozen
from homolog.cohort import Cohort
from homolog.errors import InputError
from homolog.io.arrays import read_arrays, write_arrays
from homolog.io.project import ProjectFolder
from homolog.io.records import ProjectRecord, ResultRecord, ResultSubject
from homolog.io.results import Result, read_energies, read_result, read_surface
from homolog.progress import Tick, no_tick, part_of
from homolog.settings import Method
from homolog.surfaces.mesh import TriangleMesh, joined

if TYPE_CHECKING:  # Warp comes with it, and the window opens without
    from homolog.inspection.verdict import Verdict

__all__ = ["LoadedResult", "RecordedFrame", "Recorder", "SubjectSurfaces", "load_result", "write_from_memory"]


_FRAMES = "frames.npz"
_MOST_FRAMES = 200


@dataclass(frozen=True, slots=True, eq=False)
class RecordedFrame:
    """The (M, n, 3) particles [mm] at an iteration, in the common coordinates at that time, read-only.

    `alignments`, (M, 4, 4) from local to these coordinates, are None in frames of version 0.1.
    """

    iteration: int
    particles: FloatArray
    alignments: FloatArray | None = None


_Surfaces = tuple[TriangleMesh, TriangleMesh]
_MOST_KEPT = 200
"""Largest number of subjects whose surfaces are kept in memory."""


class SubjectSurfaces(Mapping[str, _Surfaces]):
    """Groomed surfaces by subject, each with a simplified one, in local coordinates.

    Surfaces that are not in memory are read from the project; InputError is raised if they are missing or
    damaged.

    Parameters
    ----------
    project : ProjectFolder
    subjects : sequence of ResultSubject
        Subjects of its result.
    parts : sequence of mappings
        The surfaces of each of several structures, of which those of the subjects consist.
    """

    def __init__(
        self,
        project: ProjectFolder,
        subjects: Sequence[ResultSubject],
        parts: Sequence[Mapping[str, _Surfaces]] = (),
    ) -> None:
        self._project, self._parts = project, parts
        self._subjects = {subject.name: subject for subject in subjects}
        self._kept: OrderedDict[str, _Surfaces] = OrderedDict()
        self._lock = threading.Lock()

    def read_first(self, tick: Tick = no_tick) -> None:
        """Read all surfaces, if they are kept; they then remain available if the folder is lost."""
        if len(self) <= _MOST_KEPT:
            for number, name in enumerate(self):
                tick(number / len(self), f"surface of {name}")
                self[name]

    def __getitem__(self, name: str) -> _Surfaces:
        """Return the surface of a subject, and a simplified one."""
        with self._lock:
            if name in self._kept:
                self._kept.move_to_end(name)
                return self._kept[name]
        surfaces = self._read(name)
        with self._lock:
            self._kept[name] = surfaces
            if len(self._kept) > _MOST_KEPT:
                self._kept.popitem(last=False)
        return surfaces

    def __iter__(self) -> Iterator[str]:
        """Iterate over the subjects' names."""
        return iter(self._subjects)

    def __len__(self) -> int:
        """Return the number of subjects."""
        return len(self._subjects)

    def __contains__(self, name: object) -> bool:
        """Return whether there is such a subject; reads nothing."""
        return name in self._subjects

    def _read(self, name: str) -> _Surfaces:
        if self._parts:
            fine, coarse = zip(*(part[name] for part in self._parts), strict=True)
            return joined(fine), joined(coarse)
        from homolog.grooming.subject import COARSE_VERTICES
        from homolog.surfaces.simplify import simplified

        mesh = read_surface(self._project, self._subjects[name])
        return mesh, simplified(mesh, COARSE_VERTICES)


@dataclass(frozen=True, slots=True, eq=False)
class LoadedResult:
    """A result with the subjects' surfaces.

    Attributes
    ----------
    result : Result
    surfaces : mapping of str to (TriangleMesh, TriangleMesh)
        The groomed surface of each subject, and a simplified one, in local coordinates.
    energies : (T, 4) float64 array
        Iteration and the three terms of the objective.
    frames : tuple of RecordedFrame
        Recorded frames of the run, oldest first; may be empty.
    summary : str
        Summary in one line.
    record : ResultRecord
        The record of the result.
    verdict : Verdict
        What the model is good for.
    parts : mapping of str to LoadedResult
        The result of each of several structures alone; empty for a single one.
    is_rigid : bool
        Whether particles vary to first order as structures do that only turn and move.
    """

    result: Result
    surfaces: Mapping[str, tuple[TriangleMesh, TriangleMesh]]
    energies: FloatArray
    frames: tuple[RecordedFrame, ...]
    summary: str
    record: ResultRecord
    verdict: "Verdict"
    parts: "Mapping[str, LoadedResult]" = field(default_factory=dict)
    is_rigid: bool = False

    @property
    def method(self) -> Method:
        """The method that placed the particles."""
        return self.record.settings.optimize.method

    @property
    def particles(self) -> dict[str, FloatArray]:
        """The particles of each subject, (N, 3) [mm], in common coordinates."""
        return dict(zip(self.result.names, self.result.world, strict=True))


class Recorder:
    """Records frames of a run: all at first, then fewer."""

    def __init__(self) -> None:
        self.frames: list[RecordedFrame] = []
        self.energies: list[tuple[float, float, float, float]] = []
        self._every = 1
        self._seen = 0

    def take(
        self, iteration: int, particles: FloatArray, energies: FloatArray, alignments: FloatArray
    ) -> None:
        """Add a frame."""
        sampling, ensemble, normals = (float(energy) for energy in energies)
        self.energies.append((float(iteration), sampling, ensemble, normals))
        self._seen += 1
        if self._seen % self._every == 0:
            self.frames.append(RecordedFrame(iteration, frozen(particles, np.float32), frozen(alignments)))
        if len(self.frames) > _MOST_FRAMES:
            self.frames = self.frames[::2]
            self._every *= 2

    def write(self, project: ProjectFolder) -> None:
        """Store the frames with the result."""
        arrays: dict[str, object] = {
            "result": _fingerprint(project),
            "iterations": np.array([frame.iteration for frame in self.frames]),
        }
        for index, frame in enumerate(self.frames):
            arrays[f"frame_{index:04d}"] = frame.particles
            if frame.alignments is not None:
                arrays[f"alignments_{index:04d}"] = frame.alignments
        write_arrays(project.folder / _FRAMES, arrays)


def load_result(project: ProjectFolder, tick: Tick = no_tick) -> LoadedResult:
    """Read a project's result with all data that the window shows.

    Parameters
    ----------
    project : ProjectFolder
    tick : Tick
        Progress and cancellation.

    Raises
    ------
    InputError
        If there is no result, or a file is missing or damaged.
    """
    result = read_result(project, part_of(tick, 0.0, 0.3))
    record = project.read().result
    if record is None:
        raise InputError(f"{project.folder}: has no result")
    parts = {item.name: load_result(project.structure(item.name)) for item in record.structures}
    surfaces = SubjectSurfaces(project, record.subjects, [part.surfaces for part in parts.values()])
    surfaces.read_first(part_of(tick, 0.3, 0.9))
    from homolog.inspection.verdict import read_verdict

    verdict = read_verdict(project, result.world, part_of(tick, 0.9, 1.0))
    summary = f"{record.particles} particles on {len(record.subjects)} shapes, " + (
        f"imported from {record.source}{_remarks(record)}"
        if record.source
        else f"{record.metric} distances, {record.end_text}, "
        f"{sum(record.seconds.values()):.0f}\u00a0s on {record.device}"
    )
    summary += f"; {record.mirrored_text}" if record.mirrored_text else ""
    given = result, surfaces, read_energies(project), _frames(project), summary, record, verdict, parts
    return LoadedResult(*given)


def write_from_memory(
    project: ProjectFolder, loaded: LoadedResult, cohort: Cohort, tick: Tick = no_tick
) -> None:
    """Write a result into a project from memory, if its own folder is gone.

    Parameters
    ----------
    project : ProjectFolder
        A project without a result.
    loaded : LoadedResult
        The result in memory, without groomed volumes.
    cohort : Cohort
        The subjects of the project.
    tick : Tick
        Progress and cancellation.

    Raises
    ------
    InputError
        If the folder can't be written to.
    """
    from homolog.io.meshes import write_mesh
    from homolog.io.particle_array import write_all_particles
    from homolog.io.results import surface_file
    from homolog.io.tables import write_table
    from homolog.run.shape_files import surface_of_model, write_model, write_surfaces
    from homolog.statistics.shape_model import ShapeModel

    result, record = loaded.result, loaded.record
    model = ShapeModel().fit(result.world, names=result.names)
    meshes = [loaded.surfaces[name][0] for name in result.names]
    surface = surface_of_model(model, result.world, meshes, result.alignments, part_of(tick, 0.0, 0.5))
    own = Cohort(tuple(subject for subject in cohort.subjects if subject.name in result.names), cohort.folder)
    with project.replacing_result() as new:
        write_all_particles(new, [subject.file for subject in record.subjects], result.local, result.world)
        for subject, mesh in zip(record.subjects, meshes, strict=True):
            write_mesh(surface_file(project, subject.file), mesh)
        write_model(new, own, model)
        write_surfaces(new, model, surface, part_of(tick, 0.5, 1.0))
        from homolog.inspection.verdict import write_verdict

        write_verdict(new, loaded.verdict, result.world)
        rows = ([int(row[0]), *row[1:]] for row in loaded.energies.tolist())
        write_table(new.folder / "energies.csv", ["iteration", "sampling", "ensemble", "normals"], rows)
        subjects = project.describe(cohort)
        new.write(ProjectRecord(subjects=subjects, settings=record.settings, result=record))
    recorder = Recorder()
    recorder.frames = list(loaded.frames)
    recorder.write(project)


def _remarks(record: ResultRecord) -> str:
    """Describe the limitations of an imported model."""
    noted = [subject for subject in record.subjects if subject.notes]
    return f". {len(noted)} of them: {noted[0].notes[0]}" if noted else ""


def _fingerprint(project: ProjectFolder) -> str:
    record = project.read().result
    return record.fingerprint + record.finished if record else ""


def _frames(project: ProjectFolder) -> tuple[RecordedFrame, ...]:
    path: Path = project.folder / _FRAMES
    if not path.is_file():
        return ()
    arrays = read_arrays(path)
    if str(arrays.get("result")) != _fingerprint(project):  # another run has replaced the result
        return ()
    return tuple(
        RecordedFrame(int(iteration), arrays[f"frame_{index:04d}"], arrays.get(f"alignments_{index:04d}"))
        for index, iteration in enumerate(arrays["iterations"])
    )
