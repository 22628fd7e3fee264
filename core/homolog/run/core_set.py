"""A core set of subjects that span the shapes of a cohort, and the fits of all others to it.

The core set is optimized jointly. Every other subject is then fitted to its ensemble individually, in worker
processes. Further passes fit every subject to the ensemble of all, which is block descent of the joint
objective. Each fit is stored: an interrupted run continues with the missing ones, and the result does not
depend on the number of workers. No step needs more surfaces in memory than those of the core set.
"""

import hashlib
import json
import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from homolog.arrays import FloatArray, IntArray
from homolog.cluster import SubjectWorkers
from homolog.cohort import Cohort
from homolog.correspondence import Shape
from homolog.correspondence.ensemble import Ensemble, ShapeState, generalization_error, make_ensemble
from homolog.correspondence.fields import opening_scale
from homolog.correspondence.mirror_images import with_mirror_images
from homolog.correspondence.poses import align_to_mean, entropy_step, generalized_procrustes
from homolog.correspondence.shape_fit import first_particles, fit_shape, nearest_template, shape_state
from homolog.correspondence.surface_sets import Similarity, length_unit, normalize_size
from homolog.errors import InputError
from homolog.files.arrays import read_arrays, write_arrays
from homolog.files.atomic import report_os_errors
from homolog.files.names import file_stems
from homolog.geometry import scale_of, transform_points
from homolog.grooming import GroomedSubject
from homolog.grooming.cache import read_groomed
from homolog.progress import Tick, no_tick, part_of
from homolog.run.fingerprints import surface_hash
from homolog.run.result import OnDemand, OptimizationInput, OptimizationOutcome
from homolog.settings import OptimizeSettings, Procrustes, RunSettings
from homolog.surfaces.mirroring import MIRROR

__all__ = ["first_placement", "fit_others", "joint_ensemble", "prepare_from_disk", "read_core", "write_core"]

_log = logging.getLogger(__name__)

_POSE_ROUNDS = 30
_MOST_PASSES, _ENOUGH = 5, 0.99
"""Largest number of passes, and the ratio of successive generalization errors that ends them."""
_MOST_SPREADS = 32
"""Number of subjects of the core set whose opening angles determine the common scale."""


def prepare_from_disk(
    cohort: Cohort,
    outlines: Sequence[GroomedSubject],
    alignments: FloatArray,
    settings: RunSettings,
    folder: Path,
    device: str,
) -> OptimizationInput:
    """Return a cohort's shapes, each read from the folder of groomed subjects on demand."""
    names = [item.name for item in outlines]
    shapes = OnDemand(len(names), lambda index: _shape(folder, names[index], alignments[index]))
    return OptimizationInput(cohort, settings, outlines, shapes, "", device)


def write_core(path: Path, outcome: OptimizationOutcome) -> None:
    """Write the particles of a core set, for a run that is interrupted during its fits."""
    with report_os_errors(path.parent):
        path.parent.mkdir(parents=True, exist_ok=True)
    arrays = {name: getattr(outcome, name) for name in ("world", "local", "alignments", "energies")}
    notes = json.dumps([item.report.notes for item in outcome.inputs.groomed])
    write_arrays(
        path,
        {
            **arrays,
            "iterations": outcome.iterations,
            "ended": outcome.ended,
            "notes": notes,
            "fingerprint": outcome.inputs.fingerprint,
        },
    )


def read_core(path: Path, inputs: OptimizationInput) -> OptimizationOutcome | None:
    """Return the particles written by `write_core`; None if there are none for these shapes."""
    if not path.is_file():
        return None
    stored = read_arrays(path)
    if str(stored["fingerprint"]) != inputs.fingerprint:
        return None
    groomed = [
        replace(item, report=replace(item.report, notes=tuple(notes)))
        for item, notes in zip(inputs.groomed, json.loads(str(stored["notes"])), strict=True)
    ]
    return OptimizationOutcome(
        replace(inputs, groomed=groomed),
        np.asarray(stored["world"], np.float64),
        np.asarray(stored["local"], np.float64),
        np.asarray(stored["alignments"], np.float64),
        np.asarray(stored["energies"], np.float64),
        int(stored["iterations"]),
        str(stored["ended"]),
        {},
    )


def _shape(folder: Path, name: str, alignment: FloatArray) -> Shape:
    groomed = read_groomed(folder, name)
    return Shape(name, groomed.field, groomed.mesh, groomed.coarse_mesh, alignment)


@dataclass(frozen=True, slots=True)
class _Job:
    """A job of a worker: the fit of a subject.

    Attributes
    ----------
    groomed, ensemble : Path
        Folder of the groomed subjects, and file of the ensemble.
    name : str
    placement : (4, 4) array
        Initial placement of the fit.
    local : (n, 3) array or None
        Initial particles; None to warp those of a template.
    templates : tuple of str
        Names of the templates.
    settings : OptimizeSettings
    key : str
        Hash of all inputs of the fit.
    """

    groomed: Path
    ensemble: Path
    name: str
    placement: FloatArray
    local: FloatArray | None
    templates: tuple[str, ...]
    settings: OptimizeSettings
    key: str


def fit_others(
    shapes: Sequence[Shape],
    names: Sequence[str],
    core: IntArray,
    outcome: OptimizationOutcome,
    folder: Path,
    groomed: Path,
    settings: RunSettings,
    workers: SubjectWorkers,
    tick: Tick = no_tick,
) -> tuple[FloatArray, FloatArray]:
    """Fit the subjects that are not in the core set to it, then all subjects to the ensemble of all.

    Passes over all subjects are repeated until the shape model hardly generalizes better.

    Parameters
    ----------
    shapes : sequence of M Shape
        The whole cohort, aligned; read one at a time.
    names : sequence of M str
    core : (K,) int array
        Indices of the core set.
    outcome : OptimizationOutcome
        Outcome of the core set's optimization.
    folder : Path
        Folder for a file of each subject and pass; existing files are used.
    groomed : Path
        Folder of the groomed subjects, which workers read.
    settings : RunSettings
    workers : SubjectWorkers
        Workers for the fits.
    tick : Tick

    Returns
    -------
    local : (M, n, 3) array
        Particles in file coordinates [mm].
    alignments : (M, 4, 4) array
        From file to world coordinates.

    Raises
    ------
    InputError
        If a file can't be read or written.
    NumericalError
        If a fit fails, or workers die repeatedly.
    """
    fits = _Fits(shapes, names, folder, groomed, settings.placing, workers)
    templates = tuple(names[index] for index in core)
    placed = [
        replace(shape, alignment=alignment)
        for shape, alignment in zip(outcome.inputs.shapes, outcome.alignments, strict=True)
    ]
    known, ensemble = joint_ensemble(placed, outcome.local, fits.placing, part_of(tick, 0.0, 0.05))
    states = dict(zip(core.tolist(), known, strict=True))
    others = [index for index in range(len(shapes)) if index not in states]
    begin = {index: (None, first_placement(shapes[index], ensemble, fits.placing)) for index in others}
    states |= fits.run(ensemble, begin, templates, 0, part_of(tick, 0.05, 0.5))
    error = _error(states)
    for number in range(1, _MOST_PASSES + 1):
        share = part_of(tick, 0.4 + 0.1 * number, 0.5 + 0.1 * number)
        every = [states[index] for index in range(len(shapes))]
        ensemble = make_ensemble(
            every, fits.placing, unit=float(ensemble.unit[0]), area=float(ensemble.area[0]),
            opening_scale=float(ensemble.opening_scale[0]), templates=(),
        )  # fmt: skip
        begin = {index: (state.local, state.placement) for index, state in enumerate(every)}
        following = fits.run(ensemble, begin, (), number, share)
        before, error = error, _error(following)
        _log.info("pass %d over all subjects: generalization error %.5g, before %.5g", number, error, before)
        if error < before:
            states = following
        if error > _ENOUGH * before:
            break
    local = np.stack([states[index].local for index in range(len(shapes))])
    alignments = np.stack([shape.alignment for shape in shapes])
    alignments[core] = outcome.alignments
    return local, _alignments(local, alignments, core, fits.placing)


def _error(states: Mapping[int, ShapeState]) -> float:
    return generalization_error(np.stack([states[index].aligned for index in range(len(states))]))


@dataclass(frozen=True, slots=True)
class _Fits:
    """Fits of a cohort, each in its own file."""

    shapes: Sequence[Shape]
    names: Sequence[str]
    folder: Path
    groomed: Path
    placing: OptimizeSettings
    workers: SubjectWorkers

    def run(
        self,
        ensemble: Ensemble,
        begin: Mapping[int, tuple[FloatArray | None, FloatArray]],
        templates: tuple[str, ...],
        number: int,
        tick: Tick,
    ) -> dict[int, ShapeState]:
        """Fit subjects, by index, from initial particles (None to warp a template's) and placements."""
        folder = self.folder / f"pass{number}"
        with report_os_errors(folder):
            folder.mkdir(parents=True, exist_ok=True)
        path, whole_key = folder / "ensemble.npz", _ensemble_key(ensemble, self.placing)
        write_arrays(path, ensemble.arrays)
        stems = file_stems([f"fit {self.names[index]}" for index in begin])
        states: dict[int, ShapeState] = {}
        jobs: dict[str, _Job] = {}
        places: dict[str, tuple[int, Path]] = {}
        for (index, (local, placement)), stem in zip(begin.items(), stems, strict=True):
            name, file = self.names[index], folder / f"{stem}.npz"
            tick(0.0, f"looking for the fit of {name}")
            key = _key(whole_key, self.shapes[index], placement, local)
            stored = _stored(file, key)
            if stored is not None:
                states[index] = stored
                continue
            places[name] = index, file
            jobs[name] = _Job(self.groomed, path, name, placement, local, templates, self.placing, key)
        for name, state in self.workers.each(_fitted, jobs, "fitting", tick):
            index, file = places[name]
            arrays = {field.name: getattr(state, field.name) for field in fields(state)}
            write_arrays(file, {"key": jobs[name].key, **arrays})
            states[index] = state
        return states


def joint_ensemble(
    shapes: Sequence[Shape], local: FloatArray, settings: OptimizeSettings, tick: Tick = no_tick
) -> tuple[list[ShapeState], Ensemble]:
    """Return the states and the ensemble of shapes whose particles were placed jointly.

    Parameters
    ----------
    shapes : sequence of M Shape
        The aligned shapes.
    local : (M, n, 3) array
        Their particles in file coordinates [mm].
    settings : OptimizeSettings
        Settings of the run that placed them.
    tick : Tick
    """
    images = with_mirror_images(shapes)
    scaled = normalize_size(images.shapes) if settings.procrustes.takes_size_out else images.shapes
    unit = length_unit(scaled)
    placements = np.stack([shape.alignment for shape in scaled])
    placements[:, :3] /= unit
    points = transform_points(placements, images.points(local))
    poses = np.tile(np.eye(4), (len(shapes), 1, 1))
    if settings.procrustes is not Procrustes.OFF:
        scaling, free = settings.procrustes.takes_size_out, np.full(len(shapes), True)
        poses = generalized_procrustes(points, poses, scaling=scaling)
        for _ in range(_POSE_ROUNDS):
            posed = transform_points(poses, points)
            poses = entropy_step(
                posed, poses, free, scaling=scaling, regularization=settings.regularization_end
            )
    every = scaled[:: -(-len(scaled) // _MOST_SPREADS)]
    weight = settings.opening_weight if settings.method.uses_normals else 0.0
    ways = [Similarity.of(shape.alignment, unit) for shape in every]
    openings = opening_scale(every, ways, weight, part_of(tick, 0.0, 0.2))
    states: list[ShapeState] = []
    for index, (shape, placement) in enumerate(
        zip(shapes, images.alignments(poses @ placements), strict=True)
    ):
        tick(0.2 + 0.8 * index / len(shapes), f"normals of {shape.name}")
        states.append(
            shape_state(
                replace(shape, alignment=placement), settings, local[index],
                unit=unit, opening_scale=openings,
            )
        )  # fmt: skip
    area = scaled[0].mesh.area * float(scale_of(placements[0])) ** 2
    return states, make_ensemble(
        states, settings, unit=unit, area=area if settings.procrustes.takes_size_out else 0.0,
        opening_scale=openings, templates=range(len(states)),
    )  # fmt: skip


def first_placement(shape: Shape, ensemble: Ensemble, settings: OptimizeSettings) -> FloatArray:
    """Return a fit's initial placement: the shape's alignment, in the ensemble's unit, size and centre."""
    placement = shape.alignment.copy()
    placement[:3] /= float(ensemble.unit[0])
    if not settings.procrustes.takes_size_out:
        return placement
    scale = float(scale_of(placement))
    placement[:3] *= np.sqrt(float(ensemble.area[0]) / shape.mesh.area) / scale
    centre = transform_points(placement, shape.mesh.vertices).mean(axis=0)
    placement[:3, 3] += ensemble.mean.mean(axis=0) - centre
    return placement


@lru_cache(maxsize=2)
def _read_ensemble(path: Path, changed: float) -> Ensemble:
    del changed  # part of the cache key: another run may rewrite the file
    return Ensemble(**read_arrays(path))


def _fitted(job: _Job) -> ShapeState:
    """Fit one subject, in a worker."""
    ensemble = _read_ensemble(job.ensemble, job.ensemble.stat().st_mtime)
    shape = _shape(job.groomed, job.name, job.placement)
    if job.local is not None:
        return fit_shape(shape, job.settings, ensemble, job.local, settled=True)
    index = nearest_template(ensemble, shape)
    template = _shape(job.groomed, job.templates[index], ensemble.placements[index])
    return fit_shape(shape, job.settings, ensemble, first_particles(ensemble, index, template, shape))


def _stored(path: Path, key: str) -> ShapeState | None:
    """Return the stored fit; None if there is none, or it belongs to another ensemble."""
    if not path.is_file():
        return None
    try:
        stored = read_arrays(path)
    except InputError:
        return None  # the subject is fitted again
    if str(stored.pop("key", "")) != key:
        return None
    return ShapeState(**stored)


def _ensemble_key(ensemble: Ensemble, settings: OptimizeSettings) -> str:
    digest = hashlib.blake2b(settings.model_dump_json(exclude_none=True).encode(), digest_size=16)
    for array in ensemble.arrays.values():
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def _key(ensemble_key: str, shape: Shape, placement: FloatArray, local: FloatArray | None) -> str:
    """Return a hash of all inputs of a fit."""
    digest = hashlib.blake2b(f"{ensemble_key} {surface_hash(shape)}".encode(), digest_size=16)
    for array in (placement, local):
        if array is not None:
            digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def _alignments(
    local: FloatArray, alignments: FloatArray, core: IntArray, settings: OptimizeSettings
) -> FloatArray:
    """Return alignments to world coordinates: shapes are aligned to their mean, in the core set's pose."""
    if settings.procrustes is Procrustes.OFF:
        return alignments
    free = np.full(len(local), True)
    free[core] = False
    side = np.where((np.linalg.det(alignments[:, :3, :3]) < 0.0)[:, None, None], MIRROR, np.eye(4))
    scaling, points = settings.procrustes is Procrustes.SIMILARITY, transform_points(side, local)
    begin = align_to_mean(points, alignments @ side, free, scaling=scaling)
    return generalized_procrustes(points, begin, scaling=scaling) @ side
