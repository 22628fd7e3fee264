"""Particles of one shape, placed against a frozen ensemble.

The gradient of H(Z) by one shape's positions y while all others are held is ``(S + aI)^-1 y / (1 + h)``, with
the covariance S of the others and ``h = y' (S + aI)^-1 y / c`` (Sherman and Morrison 1950); that of H(V) is
alike. S is known by its leading modes, so a fit costs the same whatever the number of subjects, and holds one
surface only. Going over all subjects again and again is a block descent of the joint objective.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import warp as wp
from scipy.spatial import cKDTree

from homolog.arrays import BoolArray, DeviceArray, Float32Array, FloatArray
from homolog.correspondence.engine import Engine, Particles, rotations
from homolog.correspondence.ensemble import Ensemble, ShapeState
from homolog.correspondence.entropy.coupling import HostCoupling
from homolog.correspondence.initialization.registration import snap_to_mesh
from homolog.correspondence.launcher import Launcher
from homolog.correspondence.loop import OptimizationLoop
from homolog.correspondence.mirror_images import with_mirror_images
from homolog.correspondence.misplaced import MAX_MISPLACED_FRACTION, is_misplaced, predict_positions
from homolog.correspondence.poses import robust_step
from homolog.correspondence.prepared_cohort import MEAN_AREA, PreparedCohort, prepare_cohort
from homolog.correspondence.refit import carry_particles
from homolog.correspondence.schedule import StagePlan, plan_stages
from homolog.correspondence.surface_sets import Similarity
from homolog.correspondence.types import InitialParticles, Shape
from homolog.geometry import fit_similarity, inverse_matrices, transform_points
from homolog.progress import Tick, no_tick
from homolog.settings import OptimizeSettings
from homolog.surfaces.mirroring import MIRROR, mirrors
from homolog.threads import on_one_thread

__all__ = ["first_particles", "fit_shape", "nearest_template", "shape_state"]

_ANNEAL_ITERATIONS, _FIRST_REGULARIZATION = 200, 1.0
"""Of a fit that starts from carried particles, which are near their places already."""
_SETTLE_ITERATIONS = 300
"""All are done: the objective of one shape fluctuates more than that of many."""
_TEMPLATE_POINTS = 256


def nearest_template(ensemble: Ensemble, shape: Shape) -> int:
    """Return which template's particles lie nearest to a shape, whose alignment is a placement."""
    tree = cKDTree(transform_points(shape.alignment, shape.coarse_mesh.vertices))
    every = slice(None, None, max(1, len(ensemble.mean) // _TEMPLATE_POINTS))
    distances = [float(np.mean(tree.query(points[every])[0])) for points in ensemble.templates]
    return int(np.argmin(distances))


def first_particles(ensemble: Ensemble, index: int, template: Shape, shape: Shape) -> FloatArray:
    """Carry a template's particles to a shape by registration.

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
    """Return the state of particles where they lie.

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
        cohort.fields, cohort.opening_fields, cohort.surface_set(len(local)), points[None],
        geodesic=cohort.geodesic, area=MEAN_AREA, launcher=launcher, free=np.zeros((1, len(local)), np.bool_),
    )  # fmt: skip
    return _state(engine, local, shape.alignment)


@on_one_thread
def fit_shape(
    shape: Shape,
    settings: OptimizeSettings,
    ensemble: Ensemble,
    local: FloatArray,
    *,
    settled: bool = False,
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
    settled : bool
        Whether they were placed against an earlier ensemble: the regularization is then the last one only.
    tick : Tick

    Returns
    -------
    ShapeState

    Raises
    ------
    NumericalError
        If a particle is lost.
    """
    unit, opening = float(ensemble.unit[0]), float(ensemble.opening_scale[0])
    cohort, side = _prepared(shape, settings, len(local), unit, opening, free=True, tick=tick)
    stages = plan_stages(settings, len(local))
    first = min(_FIRST_REGULARIZATION, settings.regularization_start)
    anneal = replace(
        stages[0],
        iterations=min(_ANNEAL_ITERATIONS, stages[0].iterations),
        ensemble=(max(first, settings.regularization_end), settings.regularization_end),
        normals=(0.1, 0.01),
    )
    initial = InitialParticles(transform_points(side, local)[None])
    settle = replace(stages[1], iterations=min(_SETTLE_ITERATIONS, stages[1].iterations))
    chosen = [settle] if settled else [anneal, settle]
    loop = _FitLoop(ensemble, cohort, settings, chosen, initial, settled, tick)
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


def _state(engine: Engine, local: FloatArray, placement: FloatArray) -> ShapeState:
    return ShapeState(
        local=local,
        aligned=engine.aligned_positions()[0].astype(np.float32),
        normals=engine.aligned_normals()[0].astype(np.float32),
        openings=engine.openings.numpy()[:, 3].astype(np.float32),
        placement=placement,
    )


class _EnsembleCoupling(HostCoupling):
    """H(Z) and H(V) of one shape, all others held.

    Attributes
    ----------
    normals : (n, 3) array
        Of the surface at the particles, as posed.
    """

    normals: Float32Array

    def of(self, ensemble: Ensemble, *, is_in_it: bool) -> "_EnsembleCoupling":
        """Set the ensemble, and whether the shape is one of it."""
        self._ensemble, self._is_in_it = ensemble, is_in_it
        return self

    def solve(
        self, stage: DeviceArray, iteration: DeviceArray, centred: DeviceArray, logs: DeviceArray
    ) -> None:
        """Compute both gradients for this iteration's parameters."""
        parameters = stage.numpy()[int(iteration.numpy()[0])]
        a, b = (float(parameters[name]) for name in ("regularization", "normals_regularization"))
        self._step = float(parameters["step"] * parameters["ensemble_weight"])
        self._regularization = a
        positions = np.asarray(self._rows(centred)[0], np.float64)
        normals = np.asarray(self._rows(logs)[0], np.float64)
        rests = (
            self._ensemble.rest_of_positions(positions, a) / a,
            self._ensemble.rest_of_normals(normals, b) / b,
        )
        leverages = [
            0.0 if self._is_in_it else float(row @ rest) / self._ensemble.scale
            for row, rest in zip((positions, normals), rests, strict=True)
        ]
        self._gradients = [rest / (1.0 + h) for rest, h in zip(rests, leverages, strict=True)]
        self._entropies = 0.5 * self._ensemble.subjects[0] * np.log1p(leverages)
        self.stiffness.numpy()[0] = 1.0 / (b * (1.0 + leverages[1]))

    def directions(
        self, centred: DeviceArray, logs: DeviceArray, ensemble: DeviceArray, normals: DeviceArray
    ) -> None:
        """Write the gradients of H(Z) by positions and of H(V) by Logs."""
        self._rows(ensemble)[0] = self._gradients[0]
        self._rows(normals)[0] = self._gradients[1]

    def damp(
        self, stage: DeviceArray, iteration: DeviceArray, steps: DeviceArray, damped: DeviceArray
    ) -> None:
        """Apply (I + p P (S + aI)^-1 P)^-1 across the particles, P being the projection to the surface.

        Without P, particles would be moved along modes off the surface, and what is left of that on the
        surface would be no mode. The inverse is that of a matrix of low rank and the identity (Woodbury).
        """
        step = np.asarray(self._rows(steps)[0], np.float64)
        a, p, ensemble = self._regularization, self._step, self._ensemble
        modes = ensemble.position_modes.reshape(-1, *self.normals.shape)
        modes = modes - np.einsum("rni,ni->rn", modes, self.normals)[..., None] * self.normals
        modes = modes.reshape(len(modes), -1)
        inverse_weights = (1.0 + a / ensemble.position_variances) * (a + p) / p
        inner = np.diag(inverse_weights) - modes @ modes.T
        explained = np.linalg.solve(inner, modes @ step) @ modes
        self._rows(damped)[0] = (step + explained) * a / (a + p)

    def entropies(self) -> FloatArray:
        """Return what the shape adds to H(Z) and H(V), per particle, (2,)."""
        return np.asarray(self._entropies, np.float64)


class _FitEngine(Engine):
    """The particles of one shape beside an ensemble."""

    def __init__(
        self,
        ensemble: Ensemble,
        cohort: PreparedCohort,
        points: Particles | FloatArray,
        launcher: Launcher,
        poses: FloatArray,
        *,
        is_in_it: bool,
    ) -> None:
        self._ensemble = ensemble
        count = len(ensemble.mean)
        super().__init__(
            cohort.fields, cohort.opening_fields, cohort.surface_set(count), points,
            geodesic=cohort.geodesic, area=MEAN_AREA, launcher=launcher, poses=poses,
        )  # fmt: skip
        self._ensemble_coupling = _EnsembleCoupling(self.layout, self.free, True, launcher).of(
            ensemble, is_in_it=is_in_it
        )
        self.coupling = self._ensemble_coupling
        self.means = wp.array(ensemble.normals, dtype=wp.vec3, device=launcher.device)

    def compare(self) -> None:
        """Centre positions and normals on those of the ensemble."""
        aligned, normals = self.aligned_positions()[0], self.aligned_normals()[0]
        self._ensemble_coupling.normals = normals.astype(np.float32)
        self.centred.numpy()[:] = aligned - self._ensemble.mean
        self.logs.numpy()[:] = self._ensemble.logs(normals, self.openings.numpy()[:, 3])


class _FitLoop(OptimizationLoop):
    """The loop over stages and iterations of one shape."""

    def __init__(
        self,
        ensemble: Ensemble,
        cohort: PreparedCohort,
        settings: OptimizeSettings,
        stages: Sequence[StagePlan],
        initial: InitialParticles,
        settled: bool,
        tick: Tick,
    ) -> None:
        self._ensemble, self._settled = ensemble, settled
        world = _matrix(cohort.to_optimizer[0])
        world[:3] *= cohort.unit
        super().__init__(
            [], world[None], cohort, settings, stages, initial, tick, observe=None, on_checkpoint=None
        )
        self.tolerance = 0.0

    def state(self, placement: FloatArray, side: FloatArray) -> ShapeState:
        """Return how the particles ended."""
        positions = self.engine.host_positions()[0].astype(np.float64)
        image = self.cohort.to_optimizer[0].invert(positions)
        return _state(self.engine, transform_points(side, image), self.poses[0] @ placement)

    def _initialize(self) -> None:
        assert self.initial is not None, "fits start from particles"
        points = self.cohort.to_optimizer[0].apply(self.initial.local[0])
        if self.aligns and not self._settled:
            self.poses = fit_similarity(points, self._ensemble.mean, scaling=self.scaling)[None]
        self._set_particles(len(points), points[None])

    def _set_particles(self, count: int, particles: Particles | FloatArray, repaired: object = None) -> None:
        self.repaired = np.zeros((1, count), np.int32)
        self.engine = _FitEngine(
            self._ensemble, self.cohort, particles, self.launcher, self.poses, is_in_it=self._settled
        )

    def _align(self, tangential_weight: float = 1.0, regularization: float | None = None) -> None:
        """Turn and move the shape towards what the modes of the ensemble explain of it."""
        if not self.aligns:
            return
        a = self.settings.regularization_end if regularization is None else regularization
        points, pose = self.engine.aligned_positions()[0], self.poses[0]
        rest = self._ensemble.rest_of_positions(self._ensemble.deviation(points), a).reshape(-1, 3)
        step = robust_step(points, points - rest, scaling=self.scaling)
        self.poses = (step @ pose)[None]
        self.engine.set_poses(self.poses)

    def _relocate_misplaced(self, index: int, done: int) -> bool:
        if not self.settings.method.uses_normals or 2 * done > self.stages[index].iterations:
            return False
        normals = self.engine.aligned_normals()[0]
        angles = np.arccos(np.clip(np.einsum("ni,ni->n", normals, self._ensemble.normals), -1.0, 1.0))
        misplaced = is_misplaced(angles, self._ensemble.angles) & (
            self.repaired[0] <= self.log.iteration - done
        )
        if not misplaced.any() or misplaced.mean() > MAX_MISPLACED_FRACTION:
            return False
        self._relocate(misplaced[None])
        self.repaired[0, misplaced] = self.log.iteration
        return True

    def _relocate(self, misplaced: BoolArray) -> None:
        """Move particles to where the ensemble's mean predicts them."""
        positions = self.engine.host_positions().astype(np.float64)
        own = np.where(misplaced[0, :, None], 0.0, self.engine.aligned_positions()[0])
        both = np.stack([self._ensemble.mean, own])
        targets = predict_positions(both, np.stack([np.zeros_like(misplaced[0]), misplaced[0]]))[1]
        targets = transform_points(inverse_matrices(self.poses[0]), targets)
        normals = self._ensemble.normals @ rotations(self.poses)[0]
        moved, mesh = misplaced[0], self.engine.surface_set.meshes[0]
        positions[0, moved] = snap_to_mesh(targets[moved], normals[moved], mesh)
        self.engine.set_positions(positions)


def _matrix(similarity: Similarity) -> FloatArray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = similarity.linear, similarity.origin
    return matrix
