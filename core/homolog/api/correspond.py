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

from homolog.api.inputs import cohort_of
from homolog.api.mean_shape import HasMeanShape, MeanShape
from homolog.api.project import Project
from homolog.arrays import FloatArray, frozen
from homolog.cohort import Cohort
from homolog.correspondence import Reason
from homolog.device import choose_device
from homolog.errors import InputError
from homolog.grooming import GroomedSubject, Reading, check_cohort, groom_cohort
from homolog.grooming.cache import content_key, save_groomed
from homolog.inspection.verdict import Verdict, judge
from homolog.io.atomic import report_os_errors
from homolog.io.names import file_stems
from homolog.io.project import ProjectFolder
from homolog.io.records import note_lines
from homolog.io.results import surface_file
from homolog.parameters import fault_text
from homolog.progress import no_tick, tick_of
from homolog.registration import check_sides
from homolog.run.choose_core import outline
from homolog.run.control import Control
from homolog.run.events import FinishReason, Phase
from homolog.run.grow import grow
from homolog.run.result import OptimizationOutcome, model_of, write_result
from homolog.run.steps import prepare_inputs, run_optimization
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
    segment: str | None
    structures: str | None
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
    _outcome: OptimizationOutcome = field(repr=False)
    _keys: Mapping[str, str] = field(repr=False)

    def __repr__(self) -> str:
        """Return a one-line summary."""
        subjects, count = self.particles.shape[:2]
        ended = "converged" if self.converged else f"not converged in {self.iterations} iterations"
        return f"Correspondence({count} particles on {subjects} subjects, {ended})"

    @cached_property
    def verdict(self) -> Verdict:
        """How much of the model is reproducible, and what follows."""
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
        return MeanShape(model.mean_, TriangleMesh(mean.vertices, mean.faces), mean.smoothing)

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
        inputs = self._outcome.inputs
        stems = dict(zip(self.names, file_stems(self.names), strict=True))
        subjects = [
            subject
            if subject.name in self._keys
            else replace(subject, path=surface_file(project, stems[subject.name]).absolute())
            for subject in inputs.cohort.subjects
        ]
        outcome = replace(
            self._outcome, inputs=replace(inputs, cohort=Cohort(tuple(subjects), project.folder))
        )
        with project.locked():
            with report_os_errors(project.groomed):
                project.groomed.mkdir(exist_ok=True)
            for groomed in inputs.groomed:
                key = self._keys.get(groomed.name) or content_key(groomed.mesh, inputs.settings.groom)
                save_groomed(project.groomed, groomed, key)
            write_result(project, outcome, *self._modelled, no_tick)
        return Project(project.folder)


def correspond(
    shapes: Cohort | str | PathLike[str] | Mapping[str, Any] | Iterable[Any],
    n_particles: int = 1024,
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
        and of volume cells the surface is taken.
    n_particles : int
        Corresponding points on every shape.
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
    """
    chosen = run_settings(dict(settings), n_particles, device, workers)
    if chosen.groom.structures is not None:
        raise InputError(
            f"{chosen.groom.structures}: several structures are modelled together in a project: run it from "
            "the command line or the window, and open it as Project"
        )
    alias = choose_device(device)
    cohort, sources = cohort_of(shapes, voxel_size, chosen.groom)
    if len(cohort.subjects) < 2:
        raise InputError(f"a correspondence needs two or more shapes, not {len(cohort.subjects)}; give more")
    control, size = Control(), chosen.optimize.core_set
    if grows := size is not None and size < len(cohort.subjects):
        control.expect_fits()
    if callback is not None:
        tick = tick_of(callback)
        control.observer = lambda status: tick(status.fraction, status.message)
    control.enter(Phase.READING, "reading")
    readings: dict[str, Reading] = {}
    keys: dict[str, str] = {}
    with _executor(workers) as executor:
        if bad := check_cohort(
            cohort, chosen.groom, control.tick, executor=executor, sources=sources, readings=readings
        ):
            raise InputError("\n".join(problem.message for problem in bad))
        check_sides(cohort, chosen.groom)
        control.enter(Phase.GROOMING, "grooming")
        groomed = groom_cohort(
            cohort,
            chosen.groom,
            executor=executor,
            tick=control.tick,
            sources=sources,
            readings=readings,
            keys=keys,
        )
    control.enter(Phase.ALIGNING, "aligning")
    if grows:
        outcome = _grown(cohort, groomed, chosen, alias, control)
    else:
        outcome = run_optimization(prepare_inputs(cohort, groomed, chosen, alias, control.tick), control)
    control.finish(FinishReason.COMPLETED, "completed")
    return _correspondence(outcome, {name: key for name, key in keys.items() if name not in sources})


def _grown(
    cohort: Cohort, groomed: Sequence[GroomedSubject], settings: RunSettings, device: str, control: Control
) -> OptimizationOutcome:
    """Optimize a core set and fit the others to it, with surfaces and fits in a temporary folder."""
    with TemporaryDirectory(prefix="homolog-") as name, report_os_errors(Path(name)):
        folder = Path(name)
        for item in groomed:
            save_groomed(folder, item, item.name)
        outcome = grow(
            cohort,
            [outline(item) for item in groomed],
            settings,
            (folder, folder / "fits"),
            device,
            control,
            lambda inputs: run_optimization(inputs, control),
            in_process=settings.workers == 1,
        )
        noted = [
            replace(item, report=other.report)
            for item, other in zip(groomed, outcome.inputs.groomed, strict=True)
        ]
        return replace(
            outcome, inputs=replace(outcome.inputs, groomed=noted, shapes=list(outcome.inputs.shapes))
        )


def run_settings(given: dict[str, Any], n_particles: int, device: str, workers: int) -> RunSettings:
    """Return the settings of a run.

    Raises
    ------
    TypeError
        If a name is not a setting.
    InputError
        With a line for each invalid value.
    """
    if isinstance(given.get("label"), str):
        given["segment"] = given.pop("label")  # as projects store it
    if "random_state" in given:
        given["seed"] = given.pop("random_state")
    unknown = sorted(given.keys() - Settings.__annotations__.keys() - {"seed"})
    if unknown:
        raise TypeError(f"correspond() got an unexpected keyword argument {unknown[0]!r}")
    values = {
        "groom": {name: given[name] for name in GroomSettings.model_fields if name in given},
        "optimize": {"particles": n_particles}
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


def _executor(workers: int) -> AbstractContextManager[Executor]:
    """Return the executor of grooming; one worker is a thread, for which scripts need no guard."""
    return ThreadPoolExecutor(1) if workers == 1 else worker_processes(workers)


def _correspondence(outcome: OptimizationOutcome, keys: Mapping[str, str]) -> Correspondence:
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
        _outcome=outcome,
        _keys=keys,
    )
