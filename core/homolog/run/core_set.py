"""A core set of subjects that span the shapes of a cohort, and the fits of all others to it.

The core set is optimized jointly. Every other subject is then fitted to its ensemble individually, in worker
processes. Further passes move every subject against the ensemble of all: block descent of the joint
objective. Fits are stored until the pass after the next is begun: an
interrupted run continues with the missing ones, and the result does not depend on the number of workers. No
step needs more surfaces in memory than those of the core set.
"""

import json
import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from homolog.arrays import Array, FloatArray, IntArray
from homolog.cluster import SubjectWorkers
from homolog.correspondence import Shape
from homolog.correspondence.ensemble import (
    Ensemble,
    ShapeState,
    StateArrays,
    generalization_error,
    make_ensemble,
)
from homolog.correspondence.entropy.weight import weighted
from homolog.correspondence.fields import opening_scale
from homolog.correspondence.mirror_images import with_mirror_images
from homolog.correspondence.passes import EXTRAPOLATION, plan_passes
from homolog.correspondence.shape_fit import shape_state
from homolog.correspondence.surface_sets import Similarity, length_unit, normalize_size
from homolog.geometry import scale_of, transform_points
from homolog.io.arrays import read_arrays, write_arrays
from homolog.io.atomic import report_os_errors
from homolog.memory import Store, in_memory
from homolog.progress import Tick, no_tick, part_of
from homolog.registration.entropy import entropy_step
from homolog.registration.procrustes import align_to_mean, generalized_procrustes
from homolog.run.result import OptimizationInput, OptimizationOutcome
from homolog.run.subject_fits import Reached, SubjectFits
from homolog.settings import OptimizeSettings, Procrustes, RunSettings
from homolog.surfaces.mirroring import MIRROR

__all__ = [
    "alignments_to_core",
    "first_placement",
    "fit_others",
    "joint_ensemble",
    "read_core",
    "write_core",
]

_log = logging.getLogger(__name__)

_POSE_ROUNDS = 30
_MOST_SETTLING, _ENOUGH = 5, 0.99
"""Largest number of passes after annealing, and the ratio of generalization errors that ends them."""
_MOST_SPREADS = 32
"""Number of subjects of the core set whose opening angles determine the common scale."""


_ARRAYS = ("world", "local", "alignments", "energies", "iterations", "ended")


def write_core(path: Path, outcome: OptimizationOutcome) -> None:
    """Write the particles of a core set, for a run that is interrupted during its fits."""
    with report_os_errors(path.parent):
        path.parent.mkdir(parents=True, exist_ok=True)
    values: dict[str, object] = {"fingerprint": outcome.inputs.fingerprint}
    for number, item in enumerate((outcome, *outcome.parts.values())):
        notes = json.dumps([subject.report.notes for subject in item.inputs.groomed])
        own = {name: getattr(item, name) for name in _ARRAYS} | {"notes": notes}
        values |= {f"{number}.{name}" if number else name: value for name, value in own.items()}
    write_arrays(path, values)


def read_core(path: Path, inputs: OptimizationInput) -> OptimizationOutcome | None:
    """Return the particles written by `write_core`; None if there are none for these shapes."""
    if not path.is_file():
        return None
    stored = read_arrays(path)
    if str(stored["fingerprint"]) != inputs.fingerprint:
        return None
    parts = {
        name: _read_outcome(stored, f"{number}.", part)
        for number, (name, part) in enumerate(inputs.parts.items(), start=1)
    }
    return replace(_read_outcome(stored, "", inputs), parts=parts)


def _read_outcome(stored: Mapping[str, Array], prefix: str, inputs: OptimizationInput) -> OptimizationOutcome:
    world, local, alignments, energies, iterations, ended, notes = (
        stored[prefix + name] for name in (*_ARRAYS, "notes")
    )
    groomed = [
        replace(item, report=replace(item.report, notes=tuple(own)))
        for item, own in zip(inputs.groomed, json.loads(str(notes)), strict=True)
    ]
    return OptimizationOutcome(
        replace(inputs, groomed=groomed),
        np.asarray(world, np.float64),
        np.asarray(local, np.float64),
        np.asarray(alignments, np.float64),
        np.asarray(energies, np.float64),
        int(iterations),
        str(ended),
        {},
    )


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
    *,
    store: Store = in_memory,
) -> tuple[FloatArray, FloatArray]:
    """Fit the subjects that are not in the core set to it, then all subjects to the ensemble of all.

    Passes begin with annealing unless the modes of the others explain each subject up to the last
    regularization: the core set then spans the cohort, and annealing would only lose variance. After it, they
    are repeated until the shape model hardly generalizes better.

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
    store : Store
        Storage of the particles of all subjects and passes.

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
    fits = SubjectFits(shapes, names, folder, groomed, settings.placing, workers)
    templates = tuple(names[index] for index in core)
    placed = [
        replace(shape, alignment=alignment)
        for shape, alignment in zip(outcome.inputs.shapes, outcome.alignments, strict=True)
    ]
    known, ensemble = joint_ensemble(placed, outcome.local, fits.placing, part_of(tick, 0.0, 0.05))
    count, particles = len(shapes), outcome.local.shape[1]
    states, following = (StateArrays(count, particles, store) for _ in range(2))
    workspace = store(np.empty((count, 3 * particles), np.float32))
    modes = ensemble.position_variances, int(ensemble.subjects[0])
    passes, first = plan_passes(weighted(fits.placing, *modes)), part_of(tick, 0.05, 0.3)
    key = fits.key(f"{outcome.inputs.fingerprint} {passes}", first)
    reached = fits.reached(key, states, following, first)
    if reached is None:
        for index, state in zip(core.tolist(), known, strict=True):
            states[index] = state
        others = np.setdiff1d(np.arange(count), core).tolist()
        begin: dict[int, tuple[FloatArray | None, FloatArray]] = {
            index: (None, first_placement(shapes[index], ensemble, fits.placing)) for index in others
        }
        fits.run(ensemble, begin, templates, 0, states, first)
        error = generalization_error(states.aligned, workspace)
        spanned = error**2 < fits.placing.regularization_end
        reached = Reached(
            0, states.scale, error, is_last=False, annealing=0 if spanned else len(passes.annealing)
        )
    elif fits.placing.procrustes.takes_size_out:
        following.rescale(reached.scale)
    plans = [*passes.annealing[: reached.annealing], *[passes.settling] * _MOST_SETTLING]
    while not reached.is_last:
        number = reached.number + 1
        if fits.placing.procrustes.takes_size_out:
            states.rescale(reached.scale)
        if number > 1:
            following.extrapolate(states, EXTRAPOLATION)
        ensemble = make_ensemble(
            states if number == 1 else following,
            fits.placing,
            unit=float(ensemble.unit[0]),
            area=float(ensemble.area[0]),
            opening_scale=float(ensemble.opening_scale[0]),
            templates=(),
            workspace=workspace,
        )
        begin = {index: (state.local, state.placement) for index, state in enumerate(states)}
        share = part_of(tick, 0.3 + 0.7 * (number - 1) / len(plans), 0.3 + 0.7 * number / len(plans))
        fits.run(ensemble, begin, (), number, following, share, plans[number - 1])
        states, following = following, states
        error, is_last = reached.error, False
        if number >= reached.annealing:
            error = generalization_error(states.aligned, workspace)
            _log.info(
                "pass %d over all subjects: generalization error %.5g, before %.5g",
                number,
                error,
                reached.error,
            )
            settles = number > reached.annealing
            is_last = number == len(plans) or (settles and error > _ENOUGH * reached.error)
        reached = replace(reached, number=number, error=error, is_last=is_last)
        if number > 1:  # the first pass is repeated, as its start is not stored for all subjects
            fits.keep(key, reached)
    local = np.array(states.local)
    alignments = np.stack([shape.alignment for shape in shapes])
    alignments[core] = outcome.alignments
    return local, alignments_to_core(local, alignments, core, fits.placing)


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
                replace(shape, alignment=placement),
                settings,
                local[index],
                unit=unit,
                opening_scale=openings,
            )
        )
    area = scaled[0].mesh.area * float(scale_of(placements[0])) ** 2
    return states, make_ensemble(
        states,
        settings,
        unit=unit,
        area=area if settings.procrustes.takes_size_out else 0.0,
        opening_scale=openings,
        templates=range(len(states)),
    )


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


def alignments_to_core(
    local: FloatArray, alignments: FloatArray, core: IntArray, settings: OptimizeSettings
) -> FloatArray:
    """Return alignments to world coordinates: shapes are aligned to their mean, in the core set's pose."""
    if settings.procrustes is Procrustes.OFF:
        return alignments
    free = np.full(len(local), True)
    free[core] = False
    side = np.where((np.linalg.det(alignments[:, :3, :3]) < 0.0)[:, None, None], MIRROR, np.eye(4))
    scaling, points = settings.procrustes is Procrustes.SHAPE, transform_points(side, local)
    begin = align_to_mean(points, alignments @ side, free, scaling=scaling)
    return generalized_procrustes(points, begin, scaling=scaling) @ side
