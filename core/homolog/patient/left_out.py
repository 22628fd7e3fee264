"""Controls fitted as patients: each to the model of all others, from its own surface alone."""

from concurrent.futures import BrokenExecutor
from dataclasses import dataclass

import numpy as np

from homolog.arrays import BoolArray, FloatArray, frozen
from homolog.cluster import each_in_workers
from homolog.correspondence import Shape
from homolog.correspondence.ensemble import make_ensemble
from homolog.errors import NumericalError
from homolog.geometry import rms_radius
from homolog.patient.change import distances_to_times
from homolog.patient.controls import COARSE_VERTICES, Controls
from homolog.patient.fit import SurfaceFit, fit_surface
from homolog.patient.placed import Placing
from homolog.patient.surface_model import SurfaceModel
from homolog.patient.wall import local_maps
from homolog.progress import Tick, no_tick
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.mirroring import MIRROR
from homolog.surfaces.simplify import simplified
from homolog.threads import cores
from homolog.workers import worker_processes

__all__ = ["LeftOut", "Measures", "fit_left_out", "gap_of_image", "measures_of"]

_MOST_PLACED = 12
"""Largest number of controls whose particles are placed, to estimate their error."""


@dataclass(frozen=True, slots=True)
class Measures:
    """Global numbers of a fit.

    Attributes
    ----------
    mahalanobis : float
        Distance from the mean in the retained modes [standard deviations].
    outside : float
        Root mean square of the residual over the surface [mm].
    size : float
        Ratio of the size to the size expected from the covariates.
    gap : float
        Median distance from the fitted model, relative to the size; a measure of the fit.
    """

    mahalanobis: float
    outside: float
    size: float
    gap: float


@dataclass(frozen=True, slots=True, eq=False)
class LeftOut:
    """M controls fitted as patients; arrays are read-only.

    Attributes
    ----------
    measures : tuple of Measures
    maps : (2, M, V) array
        Local differences from the expected shape [mm], and relative thickness (`local_maps`).
    totals : (M, V) array
        Local differences from the mean [mm].
    errors : (E, N) array
        Distances of particles from their positions in the joint run [particle spacings], for at most 12
        controls.
    changes : (P, V) array
        Changes of controls with a later time from the first one [mm].
    volumes : (P,) array
        Ratios of the later volumes of these controls to the first ones.
    mirrored : (M,) array
        Ratios of `Measures.gap` of the mirror image to that of the control itself.
    borders : (k, 3) array
        Unit vectors out of the images where controls touch the border, in the frames of their models.
    poses : (M, 4, 4) array
        From the frames of `Controls.meshes` to those of the models.
    """

    measures: tuple[Measures, ...]
    maps: FloatArray
    totals: FloatArray
    errors: FloatArray
    changes: FloatArray
    volumes: FloatArray
    mirrored: FloatArray
    borders: FloatArray
    poses: FloatArray

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in ("maps", "totals", "errors", "changes", "volumes", "mirrored", "borders", "poses"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.float64))


def measures_of(
    model: SurfaceModel,
    fit: SurfaceFit,
    columns: FloatArray,
    modes: int,
    missing: BoolArray | None = None,
) -> tuple[Measures, FloatArray]:
    """Return the global numbers of a fit, and the map of differences from the mean (V,) [mm].

    Parameters
    ----------
    model : SurfaceModel
    fit : SurfaceFit
        Fit of this model.
    columns : (c,) array
        The subject's covariates.
    modes : int
        Number of retained modes for the Mahalanobis distance.
    missing : (V,) bool array, optional
        Vertices cut off by the border of the image. Distances exclude them; size is that of the expected
        shape.
    """
    mean = model.expected(columns)
    surface = model.surface(fit.expected)
    seen = np.ones(model.vertices, np.bool_) if missing is None else ~missing
    areas = seen * surface.vertex_areas
    share = areas / areas.sum()
    scores = fit.scores[:modes]
    particles = fit.particles if seen.all() else fit.expected[model.vertices :]
    sizes = rms_radius(particles), rms_radius(mean[model.vertices :])
    moved = (fit.expected - mean)[: model.vertices]
    total = np.einsum("vi,vi->v", moved, model.surface(mean).vertex_normals) + fit.residual
    measures = Measures(
        mahalanobis=float(np.sqrt(np.sum(np.square(scores) / model.variances[:modes]))),
        outside=float(np.sqrt(share @ np.square(fit.residual))),
        size=float(sizes[0] / sizes[1]),
        gap=float(np.median(np.abs(fit.residual[seen])) / sizes[1]),
    )
    return measures, total


def gap_of_image(
    model: SurfaceModel, mesh: TriangleMesh, columns: FloatArray, modes: int, tick: Tick = no_tick
) -> float:
    """Return `Measures.gap` of the model fitted to a surface's mirror image."""
    image = mesh.placed(MIRROR)
    fit = fit_surface(model, image, simplified(image, COARSE_VERTICES), columns, tick)
    return measures_of(model, fit, columns, modes)[0].gap


def fit_left_out(
    controls: Controls,
    columns: FloatArray,
    modes: int,
    fitted_modes: int,
    *,
    workers: int | None = None,
    tick: Tick = no_tick,
) -> LeftOut:
    """Fit each control to the model of the others, in parallel processes.

    Parameters
    ----------
    controls : Controls
    columns : (M, c) array
        Standardised covariates of the controls.
    modes : int
        Number of retained modes.
    fitted_modes : int
        Number of fitted modes.
    workers : int, optional
        Number of processes; one per core by default.
    tick : Tick

    Returns
    -------
    LeftOut

    Raises
    ------
    NumericalError
        If a worker process died.
    """
    count = len(controls.names)
    placed = set(range(0, count, -(-count // _MOST_PLACED)))
    jobs: dict[str, _Job] = {}
    for index, name in enumerate(controls.names):
        others = np.arange(count) != index
        jobs[name] = _Job(
            controls.points[others],
            columns[others],
            controls.surface,
            controls.meshes[index],
            controls.particles[index],
            columns[index],
            modes,
            fitted_modes,
            _placed(controls, index) if index in placed else None,
            controls.later.get(index),
            controls.borders[index] if controls.borders else np.zeros((0, 3)),
        )
    fitted: dict[str, _Fitted] = {}
    with worker_processes(min(workers or cores(), count)) as executor:
        try:
            for name, future in each_in_workers(executor, _fitted, jobs, "fitting", tick):
                fitted[name] = future.result()
        except BrokenExecutor as error:
            raise NumericalError(
                "a process that fitted controls ended unexpectedly, probably for lack of memory; use fewer "
                "workers"
            ) from error
    done = [fitted[name] for name in controls.names]
    return LeftOut(
        tuple(item[0] for item in done),
        np.stack([item[1] for item in done], axis=1),
        np.stack([item[2] for item in done]),
        np.stack([done[index][3] for index in sorted(placed)]),
        np.array([done[index][4] for index in sorted(controls.later)]),
        np.array(
            [
                abs(mesh.volume / controls.meshes[index].volume)
                for index, mesh in sorted(controls.later.items())
            ]
        ),
        np.array([item[5] for item in done]),
        np.concatenate([item[6] for item in done]),
        np.stack([item[7] for item in done]),
    )


_Fitted = tuple[
    Measures, FloatArray, FloatArray, FloatArray, FloatArray | None, float, FloatArray, FloatArray
]


@dataclass(frozen=True, slots=True, eq=False)
class _Job:
    points: FloatArray
    columns: FloatArray
    surface: TriangleMesh
    mesh: TriangleMesh
    particles: FloatArray
    own: FloatArray
    modes: int
    fitted_modes: int
    placed: tuple[Placing, Shape, FloatArray] | None
    later: TriangleMesh | None
    borders: FloatArray


def _placed(controls: Controls, index: int) -> tuple[Placing, Shape, FloatArray] | None:
    """Return the inputs of a control's placement: the others' ensemble, its shape, and its reflection."""
    jointly = controls.jointly
    if jointly is None:
        return None
    ensemble = jointly.ensemble
    others = make_ensemble(
        [state for number, state in enumerate(jointly.states) if number != index],
        jointly.settings,
        unit=float(ensemble.unit[0]),
        area=float(ensemble.area[0]),
        opening_scale=float(ensemble.opening_scale[0]),
        templates=(),
    )
    return Placing(others, jointly.settings), jointly.shapes[index], jointly.turns[index]


def _fitted(job: _Job) -> _Fitted:
    """Fit one control, in a worker."""
    model = SurfaceModel.fit(job.points, job.columns, job.fitted_modes, job.surface.faces)
    fit = fit_surface(model, job.mesh, simplified(job.mesh, COARSE_VERTICES), job.own)
    measures, total = measures_of(model, fit, job.own, job.modes)
    spacing = np.sqrt(job.surface.area / len(job.particles))
    particles = fit.particles
    if job.placed is not None:
        placing, shape, turn = job.placed
        particles = placing.placed(shape, fit, turn)
    errors = np.linalg.norm(particles - job.particles, axis=1) / spacing
    image = gap_of_image(model, job.mesh, job.own, job.modes)
    borders = job.borders @ fit.pose[:3, :3].T
    return (
        measures,
        local_maps(model, fit, job.mesh),
        total,
        errors,
        _changed(job, model, fit),
        image / measures.gap,
        borders,
        fit.pose,
    )


def _changed(job: _Job, model: SurfaceModel, first: SurfaceFit) -> FloatArray | None:
    """Return the change to the later time (V,) [mm], measured in the same way as that of a patient."""
    if job.later is None:
        return None
    fit = fit_surface(model, job.later, simplified(job.later, COARSE_VERTICES), job.own)
    expected = model.surface(first.expected)
    vertices = expected.vertices + first.residual[:, None] * expected.vertex_normals
    meshes = job.mesh.placed(first.pose), job.later.placed(fit.pose)
    before, after = distances_to_times(TriangleMesh(vertices, expected.faces), *meshes)
    change: FloatArray = after.residual - before.residual
    return change
