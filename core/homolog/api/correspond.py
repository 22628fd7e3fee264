"""Corresponding points on shapes in memory or in files: the pipeline of `homolog.run` in one call."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from functools import cached_property
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal, TypedDict, Unpack

import numpy as np
from pydantic import ValidationError

from homolog.api.inputs import by_structure, cohort_of
from homolog.api.mean_shape import HasMeanShape, MeanShape
from homolog.api.project import Project
from homolog.arrays import FloatArray, frozen
from homolog.cohort import Cohort, Subject
from homolog.correspondence import Reason
from homolog.device import choose_device
from homolog.errors import InputError
from homolog.grooming import GroomedSubject, Reading, check_cohort, groom_cohort
from homolog.grooming.cache import content_key, save_groomed
from homolog.grooming.cohort import landmarks_in
from homolog.inspection.verdict import Verdict, judge, worst_of
from homolog.io.atomic import report_os_errors
from homolog.io.names import file_stems
from homolog.io.project import ProjectFolder
from homolog.io.records import note_lines
from homolog.io.results import surface_file
from homolog.parameters import fault_text
from homolog.progress import no_tick, part_of, tick_of
from homolog.registration import check_sides
from homolog.run.choose_core import outline
from homolog.run.control import Control
from homolog.run.events import FinishReason, Phase
from homolog.run.grow import grow
from homolog.run.result import OptimizationOutcome, model_of, write_result
from homolog.run.steps import prepare_inputs, run_optimization
from homolog.run.structures import in_other_frames, prepare_joint_inputs
from homolog.settings import GroomSettings, OptimizeSettings, RunSettings
from homolog.statistics.reconstruction import MeanSurface
from homolog.statistics.shape_model import ShapeModel
from homolog.surfaces.mesh import TriangleMesh
from homolog.workers import worker_processes

__all__ = ["Callback", "Correspondence", "Settings", "correspond", "run_settings"]

Callback = Callable[[float, str], object]
"""``callback(fraction, message)``: the fraction done, in [0, 1], and the current step."""


class Settings(TypedDict, total=False):
    """Further settings of `correspond`, named as on the command line."""

    label: int | str | None
    structures: str | None
    structure_grooming: str | None
    values: Literal["labels", "distance", "probability"] | None
    pieces: Literal["largest", "all"]
    spacing: float | None
    smoothing: float
    tunnels: float
    openings: Literal["auto", "open", "close"]
    alignment: Literal["none", "center", "axes", "icp"]
    mirror: Literal["auto", "left", "right", "off"]
    scaling: bool
    mesh_edge: float | None
    adaptive_mesh: bool
    method: Literal["geodesic-normals", "geodesic", "normals", "euclidean"]
    structure_particles: str | None
    align_by: str | None
    random_state: int
    procrustes: Literal["auto", "off", "rigid", "form", "shape"]
    core_set: int | None
    landmarks: bool
    ensemble_weight: float | None
    coherence: float
    normals_weight: float
    opening_weight: float
    regularization_start: float
    regularization_end: float
    split_iterations: int
    anneal_iterations: int
    settle_iterations: int
    tolerance: float


@dataclass(frozen=True, eq=False)
class Correspondence(HasMeanShape):
    """Corresponding points on a cohort: what `correspond` returns. All arrays are read-only.

    Attributes
    ----------
    names : tuple of str
        Names of the M subjects.
    groups : tuple of str or None
        Their groups, from the cohort's table.
    covariates : dict of str to tuple of str
        The further columns of the cohort's table, one value for each subject, empty where missing.
    particles : (M, N, 3) float64 array
        Each subject's particles in its own frame, that of its file or mesh [mm]. Particles of
        equal index correspond.
    aligned : (M, N, 3) float64 array
        Particles in one common frame [mm], the data of statistics.
    alignments : (M, 4, 4) float64 array
        Similarities from `particles` to `aligned`; reflections for mirrored subjects.
    meshes : tuple of TriangleMesh
        The smoothed surfaces of the particles, each in its own frame.
    energies : (T, 4) float64 array
        Iteration, and the three terms of the objective (sampling, ensemble, normals); lower is better.
    iterations : int
        Number of iterations of the optimization.
    converged : bool
        Whether the objective converged before the maximum number of iterations.
    notes : tuple of str
        Findings and changes, one line for each kind.
    structures : mapping of str to Correspondence
        Of several structures, each on its own, aligned with its like, by name: of all subjects that have it.
        The particles of all, one after another, are those of the subjects that have all. Empty for one.
    """

    names: tuple[str, ...]
    groups: tuple[str | None, ...]
    covariates: Mapping[str, tuple[str, ...]]
    particles: FloatArray
    aligned: FloatArray
    alignments: FloatArray
    meshes: tuple[TriangleMesh, ...]
    energies: FloatArray
    iterations: int
    converged: bool
    notes: tuple[str, ...]
    structures: Mapping[str, Correspondence] = field(repr=False)
    _outcome: OptimizationOutcome = field(repr=False)
    _keys: Mapping[str, Mapping[str, str]] = field(repr=False)

    @property
    def _own(self) -> Mapping[str, slice]:
        ends = np.cumsum([item.particles.shape[1] for item in self.structures.values()]).tolist()
        return dict(zip(self.structures, map(slice, [0, *ends], ends), strict=True))

    def __repr__(self) -> str:
        """Return a one-line summary."""
        subjects, count = self.particles.shape[:2]
        ended = "converged" if self.converged else f"not converged in {self.iterations} iterations"
        return f"Correspondence({count} particles on {subjects} subjects, {ended})"

    @cached_property
    def verdict(self) -> Verdict:
        """How much of the model is reproducible, and what follows."""
        if self.structures:
            return worst_of({name: item.verdict for name, item in self.structures.items()})
        pairs = zip(self.meshes, self.alignments, strict=True)
        placed = [mesh.placed(alignment) for mesh, alignment in pairs]
        return judge(self.aligned, placed, alignments=self.alignments)

    @cached_property
    def _modelled(self) -> tuple[ShapeModel, MeanSurface]:
        return model_of(self._outcome, no_tick)

    def _surfaces(self) -> tuple[TriangleMesh, ...]:
        return self.meshes

    @property
    def _mean_shape(self) -> MeanShape:
        model, mean = self._modelled
        return MeanShape(model.mean_, TriangleMesh(mean.vertices, mean.faces), mean.smoothing, mean.parts)

    def save(self, folder: str | PathLike[str]) -> Project:
        """Write a project folder, which the command line and the window open like one of their own.

        Parameters
        ----------
        folder : path
            A new or empty folder, or a project, whose result is replaced. It is created if necessary.

        Returns
        -------
        Project
            The folder, read back.

        Raises
        ------
        InputError
            If the folder contains other files or can't be written to; an existing result is not changed.
        """
        project = ProjectFolder(Path(folder))
        project.check_is_free()
        with project.locked():
            for name, own in self._outcome.parts.items() or [("", self._outcome)]:
                groomed_here = (project.structure(name) if name else project).groomed
                with report_os_errors(groomed_here):
                    groomed_here.mkdir(parents=True, exist_ok=True)
                for groomed in own.inputs.groomed:
                    key = content_key(groomed.mesh, own.inputs.settings.groom)
                    key = self._keys[name].get(groomed.name, key)
                    save_groomed(groomed_here, groomed, key)
            write_result(project, self._placed_in(project), *self._modelled, no_tick)
        return Project(project.folder)

    def _placed_in(self, project: ProjectFolder) -> OptimizationOutcome:
        """Return the outcome with the project's surfaces as files of what is in memory."""
        files: dict[str, dict[str, Path]] = {}
        for name, own in self._outcome.parts.items() or [("", self._outcome)]:
            folder = project.structure(name) if name else project
            names = [item.name for item in own.inputs.groomed]
            for subject, stem in zip(names, file_stems(names), strict=True):
                if subject not in self._keys[name]:
                    files.setdefault(subject, {})[name] = surface_file(folder, stem).absolute()

        def placed(outcome: OptimizationOutcome) -> OptimizationOutcome:
            subjects = [
                replace(
                    subject,
                    path=files[subject.name].get("", project.folder.absolute()),
                    structures={
                        **subject.structures,
                        **{name: path for name, path in files[subject.name].items() if name},
                    },
                )
                if subject.name in files
                else subject
                for subject in outcome.inputs.cohort.subjects
            ]
            inputs = replace(outcome.inputs, cohort=Cohort(tuple(subjects), project.folder))
            parts = {name: placed(part) for name, part in outcome.parts.items()}
            return replace(
                outcome, inputs=replace(inputs, parts={n: p.inputs for n, p in parts.items()}), parts=parts
            )

        return placed(self._outcome)


def correspond(
    shapes: Cohort | str | PathLike[str] | Mapping[str, Any] | Iterable[Any],
    n_particles: int | Mapping[str, int] = 1024,
    *,
    voxel_size: float | Iterable[float] | None = None,
    device: str = "auto",
    workers: int = 1,
    callback: Callback | None = None,
    **settings: Unpack[Settings],
) -> Correspondence:
    """Place corresponding particles on the surfaces of a cohort.

    The pipeline of ``homolog run``, with the same defaults, without a project folder: surfaces are smoothed,
    remeshed and aligned, and particles are placed so that they cover every surface evenly and describe the
    cohort with as little variation as possible, by geodesic distances and surface normals.

    Parameters
    ----------
    shapes : Cohort, path, mapping or iterable
        Two or more shapes: a `Cohort` (`read_cohort`), the path of a folder or table, a list of shapes, or a
        dict of them by name. Each shape is the path of a segmentation or mesh, a `TriangleMesh`, a mesh of
        trimesh, pyvista, VTK (``vtkPolyData``, ``vtkUnstructuredGrid``) or meshio, a pair (vertices (V, 3),
        faces (F, 3)) of arrays, an image of SimpleITK or nibabel, a label array (I, J, K) with `voxel_size`,
        or a pair (labels, index_to_world (4, 4)) in LPS. Lengths are in mm; meshes may be open or damaged,
        and of volume cells the surface is taken. Several structures of each subject are a dict of the
        structures, each a dict of shapes by subject or a list with an item a subject, as they lie in the
        body; what a subject lacks is None or missing. A cohort's structures are named by ``structures``.
    n_particles : int, or dict of str to int
        Corresponding points on every shape; of several structures, on each one, or by structure.
    voxel_size : float or three floats, optional
        Voxel size of label arrays along their axes [mm].
    device : str
        ``"auto"`` (the first GPU if there is one, else the CPU), ``"cpu"`` or ``"cuda:<n>"``; several, such
        as ``"cuda:0,cuda:1"``, share the shapes.
    workers : int
        Number of processes that smooth and remesh shapes, and fit them to a core set. With more than one, a
        script must call this function under ``if __name__ == "__main__":``.
    callback : callable, optional
        ``callback(fraction, message)``, about ten times per second. It may raise `Cancelled`, or any other
        error, to stop.
    **settings
        Any setting of ``homolog run`` by its name, such as ``alignment="center"``, ``smoothing=0.5`` or
        ``random_state=1``: see the table of settings in docs/api.md. ``label`` is the value or the name of a
        structure. On a CPU, the same shapes, settings and random state give bit-identical particles. With
        ``core_set=K``, K subjects are optimized jointly and the others fitted to them, with surfaces and fits
        in a temporary folder; ``homolog run`` stores these in the project, so that it can be resumed, and
        needs memory for few surfaces.

    Returns
    -------
    Correspondence

    Raises
    ------
    InputError
        If shapes or settings can't be used; with a line for each, its name and the remedy.
    NumericalError
        If a computation fails.

    References
    ----------
    M. Datar et al., "Geometric correspondence for ensembles of nonregular shapes", MICCAI 2011;
    docs/method.md describes the differences.

    Examples
    --------
    Meshes of trimesh, from which a shape model is computed (docs/examples has complete programs):

    >>> import homolog as hl
    >>> result = hl.correspond({"a": mesh_a, "b": mesh_b, "c": mesh_c}, n_particles=512)  # doctest: +SKIP
    >>> model = hl.ShapeModel().fit(result.aligned, names=result.names)  # doctest: +SKIP

    Two bones of each knee together:

    >>> bones = {"femur": {"a": femur_a, "b": femur_b}, "tibia": tibiae}  # doctest: +SKIP
    >>> knees = hl.correspond(bones, n_particles={"femur": 512, "tibia": 256})  # doctest: +SKIP
    >>> knees.structures["femur"].aligned, knees.relative_poses("femur").rotations  # doctest: +SKIP
    """
    given = by_structure(shapes)
    if given is not None and "structures" in settings:
        raise InputError("structures: the shapes are given by structure; leave it out")
    if given is not None:
        settings["structures"] = ",".join(given)
    chosen = run_settings(dict(settings), n_particles, device, workers)
    if chosen.unknown_structures:
        raise InputError(f"{', '.join(chosen.unknown_structures)}: is none of the structures")
    alias = choose_device(device)
    grooms = chosen.groom.of_structures or {"": chosen.groom}
    everybody = Cohort((), Path())
    if given is None:
        everybody, memory = cohort_of(shapes, voxel_size, chosen.groom)
        read = {name: (everybody, memory, groom) for name, groom in grooms.items()}
    else:
        whole = {"label": None, "segment": None}  # of a structure's own file or array
        grooms = {name: groom.model_copy(update=whole) for name, groom in grooms.items()}
        read = {name: (*cohort_of(given[name], voxel_size, groom), groom) for name, groom in grooms.items()}
    control, size = Control(), chosen.optimize.core_set
    complete = set.intersection(*({item.name for item in own.subjects} for own, _, _ in read.values()))
    if len(complete) < 2:
        of_all = " of all structures" if given else ""
        raise InputError(f"a correspondence needs two or more shapes{of_all}, not {len(complete)}; give more")
    if grows := size is not None and size < len(complete):
        control.expect_fits()
    if callback is not None:
        tick = tick_of(callback)
        control.observer = lambda status: tick(status.fraction, status.message)
    control.enter(Phase.READING, "reading")
    readings: dict[str, dict[str, Reading]] = {name: {} for name in read}
    share = 1.0 / len(read)
    ticks = [part_of(control.tick, number * share, (number + 1) * share) for number in range(len(read))]
    with _executor(workers) as executor:
        bad = [
            problem
            for tick, (name, (cohort, sources, groom)) in zip(ticks, read.items(), strict=True)
            for problem in check_cohort(
                cohort, groom, tick, executor=executor, sources=sources, readings=readings[name]
            )
        ]
        if bad:
            raise InputError("\n".join(problem.message for problem in bad))
        cohorts = {name: cohort for name, (cohort, _, _) in read.items()}
        if given is not None:
            everybody = _everybody(cohorts)
        check_sides(everybody, chosen.groom)
        control.enter(Phase.GROOMING, "grooming")
        groomed = {
            name: groom_cohort(
                cohort,
                groom,
                executor=executor,
                tick=tick,
                sources=sources,
                readings=readings[name],
            )
            for tick, (name, (cohort, sources, groom)) in zip(ticks, read.items(), strict=True)
        }
    if misplaced := in_other_frames(groomed):
        raise InputError("\n".join(problem.message for problem in misplaced))
    control.enter(Phase.ALIGNING, "aligning")
    if grows:
        outcome = _grown(everybody, groomed, chosen, alias, control)
    else:
        marks = landmarks_in(readings.values())
        inputs = (
            prepare_inputs(everybody, groomed[""], chosen, alias, control.tick, landmarks=marks)
            if "" in groomed
            else prepare_joint_inputs(everybody, groomed, chosen, alias, control.tick, landmarks=marks)
        )
        outcome = run_optimization(inputs, control)
    control.finish(FinishReason.COMPLETED, "completed")
    known = {name: {subject: item.key for subject, item in own.items()} for name, own in readings.items()}
    return _correspondence(outcome, known)


def _everybody(cohorts: Mapping[str, Cohort]) -> Cohort:
    """Return the subjects of all structures, with the files of each."""
    subjects: dict[str, Subject] = {}
    for name, cohort in cohorts.items():
        for subject in cohort.subjects:
            known = subjects.setdefault(subject.name, subject)
            if subject.path != Path(subject.name):
                files = {**known.structures, name: subject.path}
                subjects[subject.name] = replace(known, structures=files)
    return Cohort(tuple(subjects.values()), next(iter(cohorts.values())).folder)


def _grown(
    cohort: Cohort,
    groomed: Mapping[str, Sequence[GroomedSubject]],
    settings: RunSettings,
    device: str,
    control: Control,
) -> OptimizationOutcome:
    """Optimize a core set and fit the others to it, with surfaces and fits in a temporary folder."""
    with TemporaryDirectory(prefix="homolog-") as place, report_os_errors(Path(place)):
        project = ProjectFolder(Path(place))
        for name, items in groomed.items():
            folder = (project.structure(name) if name else project).groomed
            folder.mkdir(parents=True)
            for item in items:
                save_groomed(folder, item, item.name)
        outcome = grow(
            cohort,
            {name: [outline(item) for item in items] for name, items in groomed.items()},
            settings,
            project,
            device,
            control,
            lambda inputs: run_optimization(inputs, control),
            in_process=settings.workers == 1,
        )
        return _in_memory(outcome, groomed)


def _in_memory(
    outcome: OptimizationOutcome, groomed: Mapping[str, Sequence[GroomedSubject]], name: str = ""
) -> OptimizationOutcome:
    """Return an outcome whose shapes were read from a folder that will be gone."""
    parts = {part: _in_memory(own, groomed, part) for part, own in outcome.parts.items()}
    inputs = replace(
        outcome.inputs,
        shapes=list(outcome.inputs.shapes),
        parts={part: own.inputs for part, own in parts.items()},
    )
    if not parts:
        noted = {item.name: item.report for item in inputs.groomed}
        whole = [replace(item, report=noted[item.name]) for item in groomed[name]]
        inputs = replace(inputs, groomed=whole)
    return replace(outcome, inputs=inputs, parts=parts)


def run_settings(
    given: dict[str, Any], n_particles: int | Mapping[str, int], device: str, workers: int
) -> RunSettings:
    """Return the settings of a run.

    Raises
    ------
    TypeError
        If a name is not a setting.
    InputError
        With a line for each invalid value.
    """
    if unknown := sorted(given.keys() - Settings.__annotations__.keys()):
        raise TypeError(f"correspond() got an unexpected keyword argument {unknown[0]!r}")
    if isinstance(given.get("label"), str):
        given["segment"] = given.pop("label")  # as projects store it
    if "random_state" in given:
        given["seed"] = given.pop("random_state")
    values = {
        "groom": {name: given[name] for name in GroomSettings.model_fields if name in given},
        "optimize": _particles(n_particles, given.get("structures"))
        | {name: given[name] for name in OptimizeSettings.model_fields if name in given},
        "device": device,
        "workers": workers,
    }
    try:
        return RunSettings.model_validate(values)
    except ValidationError as error:
        names = {"particles": "n_particles", "seed": "random_state", "segment": "label"}
        lines = [
            f"{names.get(str(fault['loc'][-1]), fault['loc'][-1])}={fault['input']!r}: {fault_text(fault)}"
            for fault in error.errors()
        ]
        raise InputError("\n".join(lines)) from error


def _particles(given: int | Mapping[str, int], structures: str | None) -> dict[str, Any]:
    """Return the settings of a number of particles, or of one for each structure."""
    if not isinstance(given, Mapping):
        return {"particles": given}
    text = ",".join(f"{name}={count}" for name, count in given.items())
    if not given or structures is None:
        raise InputError(f"n_particles={text or given}: there is a single structure; give one number")
    return {"particles": max(given.values()), "structure_particles": text}


def _executor(workers: int) -> AbstractContextManager[Executor]:
    """Return the executor of grooming; one worker is a thread, for which scripts need no guard."""
    return ThreadPoolExecutor(1) if workers == 1 else worker_processes(workers)


def _correspondence(outcome: OptimizationOutcome, keys: Mapping[str, Mapping[str, str]]) -> Correspondence:
    inputs = outcome.inputs
    subjects = inputs.cohort.subjects
    columns = dict.fromkeys(column for subject in subjects for column in subject.columns)
    return Correspondence(
        names=tuple(subject.name for subject in subjects),
        groups=tuple(subject.group for subject in subjects),
        covariates={
            column: tuple(subject.columns.get(column, "") for subject in subjects) for column in columns
        },
        particles=frozen(outcome.local, np.float64),
        aligned=frozen(outcome.world, np.float64),
        alignments=frozen(outcome.alignments, np.float64),
        meshes=tuple(shape.mesh for shape in inputs.shapes),
        energies=frozen(outcome.energies, np.float64),
        iterations=outcome.iterations,
        converged=outcome.ended == Reason.CONVERGED,
        notes=tuple(note_lines({item.name: item.report.notes for item in inputs.groomed})),
        structures={name: _correspondence(own, {"": keys[name]}) for name, own in outcome.parts.items()},
        _outcome=outcome,
        _keys=keys,
    )
