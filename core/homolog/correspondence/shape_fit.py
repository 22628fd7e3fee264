"""Particles of one shape, placed against a frozen ensemble.

The gradient of H(Z) by one shape's positions y while all others are held is ``(S + aI)^-1 y / (1 + h)``, with
the covariance S of the others and ``h = y' (S + aI)^-1 y / c`` (Sherman and Morrison 1950); that of H(V) has
the same form. S is represented by its leading modes: the cost of a fit does not depend on the number of
subjects, and one surface is in memory. Passes over all subjects are a block descent of the joint objective.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from homolog.arrays import BoolArray, FloatArray
from homolog.correspondence.engine import Engine, Particles
from homolog.correspondence.ensemble import Ensemble, ShapeState
from homolog.correspondence.entropy.sampling import LIST_ITERATIONS
from homolog.correspondence.entropy.terms import Term
from homolog.correspondence.entropy.weight import weighted
from homolog.correspondence.fit_engine import FitEngine, state_of
from homolog.correspondence.initialization.registration import snap_to_mesh
from homolog.correspondence.launcher import Launcher
from homolog.correspondence.loop import MAX_POSE_REGULARIZATION, RECORD_INTERVAL, OptimizationLoop
from homolog.correspondence.mirror_images import with_mirror_images
from homolog.correspondence.misplaced import MAX_MISPLACED_FRACTION, is_misplaced, predict_positions
from homolog.correspondence.prepared_cohort import MEAN_AREA, PreparedCohort, prepare_cohort
from homolog.correspondence.refit import carry_particles
from homolog.correspondence.schedule import NORMALS_ANNEALING, StagePlan, TimeShares, plan_stages
from homolog.correspondence.surface_points import SurfacePoints
from homolog.correspondence.types import InitialParticles, Shape
from homolog.geometry import fit_similarity, inverse_matrices, rotation_of, transform_points
from homolog.progress import Tick, no_tick
from homolog.registration.pose_search import follow_pose, search_poses
from homolog.registration.procrustes import procrustes_step, robust_step
from homolog.settings import OptimizeSettings, Procrustes
from homolog.surfaces.mirroring import MIRROR, mirrors
from homolog.surfaces.nearest import NearestPoints
from homolog.threads import on_one_thread

__all__ = ["first_particles", "fit_shape", "fit_shape_from", "nearest_template", "shape_state"]

_ANNEAL_ITERATIONS, _FIRST_REGULARIZATION = 200, 1.0
"""Annealing of a fit that starts from transferred particles, which are already near their final positions."""
_SETTLE_ITERATIONS, _SETTLED = 300, 0.01
"""Largest number of iterations, and motion of 95 % of the particles between two records at which they have
settled [spacings]: the objective of one shape fluctuates too much to decide it."""
_MOST_POSES, _PLACED_ANNEAL, _RELOCATED_AFTER = 4, 60, 40
"""Search for the pose: number of poses, iterations of each, and iterations after which its misplaced
particles are relocated."""
_MOST_ROUNDS, _GAINED = 4, 0.002
"""Largest number of further searches from the placed particles, and decrease of the objective below which the
searches end."""
_ROUND_BEGINS = 40.0, 3.0
"""Regularization of H(Z) and H(V) at the start of a search, relative to that at its end."""
_ENOUGH_SUBJECTS = 10.0
"""Subjects from which the last stage of such a fit has the run's weights. With fewer, weights are reduced by
the square of the ratio: a few subjects predict little of another one, and particles should be more even."""
_TEMPLATE_POINTS = 256


def nearest_template(ensemble: Ensemble, shape: Shape) -> int:
    """Return which template's particles lie nearest to a shape, whose alignment is a placement."""
    surface = NearestPoints.of(shape.coarse_mesh.placed(shape.alignment))
    every = slice(None, None, max(1, len(ensemble.mean) // _TEMPLATE_POINTS))
    distances = [float(np.mean(surface.nearest(points[every])[0])) for points in ensemble.templates]
    return int(np.argmin(distances))


def first_particles(ensemble: Ensemble, index: int, template: Shape, shape: Shape) -> FloatArray:
    """Transfer a template's particles to a shape by registration.

    Parameters
    ----------
    ensemble : Ensemble
    index : int
        Of the template.
    template, shape : Shape
        Both with placements (from file coordinates to the ensemble's) as alignments.

    Returns
    -------
    (n, 3) array
        On the shape or near it, in file coordinates [mm].
    """
    there, here = (
        (item.mesh.placed(item.alignment), item.coarse_mesh.placed(item.alignment))
        for item in (template, shape)
    )
    carried = carry_particles(there, np.asarray(ensemble.templates[index], np.float64), here)
    return transform_points(inverse_matrices(shape.alignment), carried)


def shape_state(
    shape: Shape, settings: OptimizeSettings, local: FloatArray, *, unit: float, opening_scale: float
) -> ShapeState:
    """Return the state of particles at given positions.

    Parameters
    ----------
    shape : Shape
        With a placement as alignment.
    settings : OptimizeSettings
    local : (n, 3) array
        In file coordinates [mm].
    unit, opening_scale : float
        See `Ensemble`.
    """
    cohort, side = _prepared(shape, settings, len(local), unit, opening_scale, free=False)
    points = cohort.to_optimizer[0].apply(transform_points(side, local))
    launcher = Launcher("cpu", 1)
    engine = Engine(
        cohort.fields,
        cohort.opening_fields,
        cohort.surface_set(len(local)),
        points[None],
        geodesic=cohort.geodesic,
        area=MEAN_AREA,
        launcher=launcher,
        free=np.zeros((1, len(local)), np.bool_),
    )
    return state_of(engine, local, shape.alignment)


@on_one_thread
def fit_shape(
    shape: Shape,
    settings: OptimizeSettings,
    ensemble: Ensemble,
    local: FloatArray,
    *,
    plan: StagePlan | None = None,
    tick: Tick = no_tick,
) -> ShapeState:
    """Place a shape's particles against an ensemble.

    Parameters
    ----------
    shape : Shape
        With a placement as alignment: where its pose begins.
    settings : OptimizeSettings
        Of the run that made the ensemble.
    ensemble : Ensemble
    local : (n, 3) array
        First particles in file coordinates [mm].
    plan : StagePlan, optional
        What to do if the ensemble contains the shape with these particles; by default it does not.
    tick : Tick

    Returns
    -------
    ShapeState

    Raises
    ------
    NumericalError
        If a particle is lost.
    """
    settings = weighted(settings, ensemble.position_variances, int(ensemble.subjects[0]))
    stages = _stages(settings, len(local), _ANNEAL_ITERATIONS) if plan is None else [plan]
    is_in_it = plan is not None
    return _fitted(shape, settings, ensemble, [local], stages, is_in_it=is_in_it, searches=False, tick=tick)


@on_one_thread
def fit_shape_from(
    shape: Shape,
    settings: OptimizeSettings,
    ensemble: Ensemble,
    starts: Sequence[FloatArray],
    *,
    tick: Tick = no_tick,
) -> ShapeState:
    """Place a shape's particles against an ensemble, in the pose that lowers the objective most.

    Parameters
    ----------
    shape : Shape
        With a placement as alignment.
    settings : OptimizeSettings
        Of the run that made the ensemble. If it does not align shapes by their particles, the pose is the
        shape's alignment, and only the first start is used.
    ensemble : Ensemble
    starts : sequence of (n, 3) arrays
        First particles in file coordinates [mm], from each of which a pose is searched for.
    tick : Tick

    Returns
    -------
    ShapeState

    Raises
    ------
    NumericalError
        If a particle is lost.
    """
    settings = weighted(settings, ensemble.position_variances, int(ensemble.subjects[0]))
    anneal, settle = _stages(settings, len(starts[0]), _PLACED_ANNEAL)
    share = min(1.0, float(ensemble.subjects[0]) / _ENOUGH_SUBJECTS) ** 2
    settle = replace(settle, ensemble=settle.ensemble.scaled(share), normals=settle.normals.scaled(share))
    terms = zip((anneal.ensemble, anneal.normals), _ROUND_BEGINS, strict=True)
    ensemble_again, normals_again = (replace(term, start=ratio * term.end) for term, ratio in terms)
    again = replace(anneal, ensemble=ensemble_again, normals=normals_again)
    searches = settings.procrustes not in (Procrustes.OFF, Procrustes.AUTO)
    stages = [anneal, again, settle] if searches else [anneal, settle]
    return _fitted(shape, settings, ensemble, starts, stages, is_in_it=False, searches=searches, tick=tick)


def _stages(settings: OptimizeSettings, count: int, anneal: int) -> list[StagePlan]:
    """Return the stages of a fit with a limited number of iterations."""
    stages = plan_stages(settings, count)
    first, last = min(_FIRST_REGULARIZATION, settings.regularization_start), settings.regularization_end
    begin = replace(
        stages[0],
        iterations=min(anneal, stages[0].iterations),
        ensemble=replace(stages[0].ensemble, start=max(first, last), end=last),
        normals=replace(stages[0].normals, start=0.1, end=NORMALS_ANNEALING[1]),
    )
    return [begin, replace(stages[1], iterations=min(_SETTLE_ITERATIONS, stages[1].iterations))]


def _fitted(
    shape: Shape,
    settings: OptimizeSettings,
    ensemble: Ensemble,
    starts: Sequence[FloatArray],
    stages: Sequence[StagePlan],
    *,
    is_in_it: bool,
    searches: bool,
    tick: Tick,
) -> ShapeState:
    unit, opening = float(ensemble.unit[0]), float(ensemble.opening_scale[0])
    cohort, side = _prepared(shape, settings, len(starts[0]), unit, opening, free=True, tick=tick)
    first = [InitialParticles(transform_points(side, local)[None]) for local in starts]
    loop = _FitLoop(ensemble, cohort, settings, stages, first, is_in_it, searches, tick)
    try:
        loop.run(None)
        return loop.state(shape.alignment, side)
    finally:
        loop.launcher.close()


def _prepared(
    shape: Shape,
    settings: OptimizeSettings,
    count: int,
    unit: float,
    opening_scale: float,
    *,
    free: bool,
    tick: Tick = no_tick,
) -> tuple[PreparedCohort, FloatArray]:
    """Return a shape on the device, as its mirror image where its placement is one, and the way to that."""
    world = shape.alignment.copy()
    world[:3] *= unit
    images = with_mirror_images([replace(shape, alignment=world)])
    cohort = prepare_cohort(
        images.shapes,
        settings,
        device="cpu",
        counts=[count],
        free_shapes=np.array([free]),
        unit=unit,
        opening_scale=opening_scale,
        tick=tick,
    )
    return cohort, MIRROR if mirrors(world) else np.eye(4)


class _FitLoop(OptimizationLoop):
    """The loop over stages and iterations of one shape."""

    def __init__(
        self,
        ensemble: Ensemble,
        cohort: PreparedCohort,
        settings: OptimizeSettings,
        stages: Sequence[StagePlan],
        starts: Sequence[InitialParticles],
        is_in_it: bool,
        searches: bool,
        tick: Tick,
    ) -> None:
        self._ensemble, self._is_in_it, self._searches, self._starts = ensemble, is_in_it, searches, starts
        if searches:
            self._trial, self._round, *stages = stages
        world, similarity = np.eye(4), cohort.to_optimizer[0]
        world[:3] = cohort.unit * np.column_stack([similarity.linear, similarity.origin])
        shares = TimeShares(stages, geodesic=cohort.geodesic, registers=False, threads=1)
        super().__init__([], world[None], cohort, settings, stages, shares, starts[0], tick)
        self._recorded = np.empty((0, 3), np.float32)

    def state(self, placement: FloatArray, side: FloatArray) -> ShapeState:
        """Return the final state of the particles."""
        positions = self.engine.host_positions()[0].astype(np.float64)
        image = self.cohort.to_optimizer[0].invert(positions)
        return state_of(self.engine, transform_points(side, image), self.poses[0] @ placement)

    def initialize(self, count: int, tick: Tick) -> None:
        starts = [self.cohort.to_optimizer[0].apply(start.local[0]) for start in self._starts]
        points, poses = starts[0], self.poses
        if self.aligns and not self._is_in_it:
            poses = np.stack([fit_similarity(p, self._ensemble.mean, scaling=self.scaling) for p in starts])
        self.poses = poses[:1]
        self._set_particles(len(points), points[None])
        if self._searches:
            self._search(poses)

    def _search(self, poses: FloatArray) -> None:
        """Take the pose of lowest objective, with particles where the ensemble expects them."""
        terms = (
            Term(self._trial.ensemble.weight, self.settings.regularization_end),
            Term(self._trial.normals.weight, NORMALS_ANNEALING[1]),
        )
        fields, surfaces = (self.cohort.fields, self.cohort.opening_fields), self.engine.surface_set
        carriers = [None] if surfaces.carriers is None else surfaces.carriers.meshes
        given = self._ensemble, terms, SurfacePoints(*fields, surfaces.meshes[0], carriers[0])
        tries = search_poses(*given, list(poses), scaling=self.scaling)
        lowest, best = np.inf, (self.engine, self.poses)
        for pose, points in tries[:_MOST_POSES]:
            objective = self._tried(self._trial, pose, points)
            if objective < lowest:
                lowest, best = objective, (self.engine, self.poses)
        for _ in range(_MOST_ROUNDS):
            self.engine, self.poses = best
            placed = self.poses[0], self.engine.aligned_positions()[0]
            objective = self._tried(self._round, *follow_pose(*given, *placed, scaling=self.scaling))
            gained = lowest - objective
            if gained > 0.0:
                lowest, best = objective, (self.engine, self.poses)
            if gained < _GAINED:
                break
        self.engine, self.poses = best

    def _tried(self, plan: StagePlan, pose: FloatArray, points: FloatArray) -> float:
        """Move particles (n, 3), as posed, through a stage, and return the objective where they end.

        A misplaced particle adds as much to it as a wrong pose does: they are relocated before the end.
        """
        self.poses = pose[None]
        self._set_particles(len(points), transform_points(inverse_matrices(pose), points)[None])
        weights = [plan.weights(iteration + 1) for iteration in range(plan.iterations)]
        self.engine.start_stage(weights)
        for done in range(0, plan.iterations, LIST_ITERATIONS):
            if done == _RELOCATED_AFTER and self.settings.method.uses_normals:
                self._relocate_misplaced()
            self.engine.iterate(min(LIST_ITERATIONS, plan.iterations - done))
            term = plan.weights(min(done + LIST_ITERATIONS, plan.iterations)).ensemble
            self.align(regularization=min(term.regularization, MAX_POSE_REGULARIZATION))
        parts = self.engine.energy(plan.coherence / plan.ensemble.weight) * plan.factors
        return float(parts.sum()) if np.isfinite(parts).all() else np.inf

    def _set_particles(self, count: int, particles: Particles | FloatArray, repaired: object = None) -> None:
        self.repaired = np.zeros((1, count), np.int32)
        self.engine = FitEngine(
            self._ensemble, self.cohort, particles, self.launcher, self.poses, is_in_it=self._is_in_it
        )

    def align(self, tangential_weight: float = 1.0, regularization: float | None = None) -> None:
        """Update the pose towards the shape's projection onto the modes of the ensemble, or its mean."""
        if not self.aligns:
            return
        points, ensemble = self.engine.aligned_positions(), self._ensemble
        if regularization is None:
            self.poses = procrustes_step(
                np.stack([ensemble.mean, points[0]]),
                np.stack([ensemble.normals, self.engine.aligned_normals()[0]]),
                np.stack([np.eye(4), self.poses[0]]),
                np.array([False, True]),
                scaling=self.scaling,
                tangential_weight=tangential_weight,
            )[1:]
        else:
            rest = ensemble.rest_of_positions(ensemble.deviation(points[0]), regularization).reshape(-1, 3)
            self.poses = robust_step(points[0], points[0] - rest, scaling=self.scaling) @ self.poses
        self.engine.set_poses(self.poses)

    def _has_converged(self, plan: StagePlan, done: int) -> bool:
        """Return whether the particles hardly move any more, if the search for a pose has placed them.

        Others may creep along the surface: all iterations are done.
        """
        before, self._recorded = self._recorded, self.engine.host_positions()[0]
        if not (self._searches and plan.until_converged) or done < 2 * RECORD_INTERVAL:
            return False
        moved = np.linalg.norm(self._recorded - before, axis=1)
        return bool(np.quantile(moved, 0.95) < _SETTLED * np.sqrt(MEAN_AREA / len(moved)))

    def _relocate_misplaced(self) -> None:
        """Move particles whose normals disagree with the ensemble's to where it expects them."""
        normals = self.engine.aligned_normals()[0]
        angles = np.arccos(np.clip(np.einsum("ni,ni->n", normals, self._ensemble.normals), -1.0, 1.0))
        misplaced = is_misplaced(angles, self._ensemble.angles)
        if misplaced.any() and misplaced.mean() <= MAX_MISPLACED_FRACTION:
            self._relocate(misplaced[None])

    def _relocate(self, misplaced: BoolArray) -> None:
        """Move particles to where the ensemble's mean predicts them."""
        positions = self.engine.host_positions().astype(np.float64)
        own = np.where(misplaced[0, :, None], 0.0, self.engine.aligned_positions()[0])
        both = np.stack([self._ensemble.mean, own])
        targets = predict_positions(both, np.stack([np.zeros_like(misplaced[0]), misplaced[0]]))[1]
        targets = transform_points(inverse_matrices(self.poses[0]), targets)
        normals = self._ensemble.normals @ rotation_of(self.poses)[0]
        moved, mesh = misplaced[0], self.engine.surface_set.meshes[0]
        positions[0, moved] = snap_to_mesh(targets[moved], normals[moved], mesh)
        self.engine.set_positions(positions)
