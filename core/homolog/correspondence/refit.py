"""Optimization of some of a result's particles: repair of a patch, fit of new subjects to a fixed model.

Free particles start at the positions that the other subjects predict.
"""

from collections.abc import Sequence

import numpy as np

from homolog.arrays import BoolArray, FloatArray
from homolog.correspondence.initialization.registration import (
    NORMAL_LENGTH,
    Registration,
    ThinPlateMap,
    snap_to_mesh,
)
from homolog.correspondence.mirror_images import with_mirror_images
from homolog.correspondence.misplaced import predict_positions
from homolog.correspondence.optimizer import optimize
from homolog.correspondence.surface_sets import Similarity, length_unit, normalize_size
from homolog.correspondence.types import FrameCallback, InitialParticles, OptimizedParticles, Shape
from homolog.errors import InputError
from homolog.progress import Tick, no_tick, part_of
from homolog.settings import OptimizeSettings
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.nearest import NearestPoints, normals_at
from homolog.threads import on_one_thread

__all__ = ["carry_particles", "initialize_fit", "repair"]

N_CONTROL_POINTS = 400  # of a thin-plate map
INTERPOLATION_SMOOTHING = 1e-6  # of a thin-plate map that interpolates its targets
ANNEAL_ITERATIONS, SETTLE_ITERATIONS = 100, 200  # iterations of a repair, at most
REGULARIZATION_START = 0.2  # at the start of a repair


def repair(
    shapes: Sequence[Shape],
    settings: OptimizeSettings,
    local: FloatArray,
    free: BoolArray,
    *,
    misplaced: BoolArray | None = None,
    device: str = "auto",
    tick: Tick = no_tick,
    observe: FrameCallback | None = None,
) -> OptimizedParticles:
    """Optimize some particles of a result again; the others stay bit-identical.

    Parameters
    ----------
    shapes : sequence of Shape
        M of them, aligned as they were in the end.
    settings : OptimizeSettings
        Of the run that made the result.
    local : (M, N, 3) array
        All particles in file coordinates [mm].
    free : (M, N) bool array
        Those that may move: a patch on one subject, or on several.
    misplaced : (M, N) bool array, optional
        Misplaced ones, which start where the other subjects predict them. By default
        all free ones.
    device, tick, observe
        As in `optimize`.

    Returns
    -------
    OptimizedParticles
        Of all subjects.

    Raises
    ------
    InputError
        If the arrays do not fit the shapes, or no particle is free.
    """
    untrusted = free if misplaced is None else misplaced
    if local.shape[:2] != (len(shapes), *free.shape[1:]) or untrusted.shape != free.shape:
        raise InputError("the particles and the free ones do not belong to the same cohort")
    settings = settings.model_copy(
        update={
            "particles": local.shape[1],
            "anneal_iterations": ANNEAL_ITERATIONS,
            "settle_iterations": SETTLE_ITERATIONS,
            "regularization_start": max(REGULARIZATION_START, settings.regularization_end),
        }
    )
    images = with_mirror_images(shapes)
    initial_points = images.points(_predict_misplaced(images.shapes, images.points(local), untrusted))
    start = InitialParticles(initial_points, free)
    return optimize(shapes, settings, device=device, tick=tick, observe=observe, initial=start)


def initialize_fit(
    shapes: Sequence[Shape], local: FloatArray, known: BoolArray, tick: Tick = no_tick
) -> InitialParticles:
    """Return initial particles for fitting new subjects to a fixed model.

    Parameters
    ----------
    shapes : sequence of Shape
        M of them, the known ones aligned as the model has them.
    local : (K, N, 3) array
        Particles of the known shapes, in their order, in file coordinates [mm].
    known : (M,) bool array
        The K known shapes.
    tick : Tick
        Progress and cancellation.

    Returns
    -------
    InitialParticles
        On each new shape the particles of the nearest known one, transferred by the registration that also
        places first particles. Only these particles may move.
    """
    images = with_mirror_images(shapes)
    shapes, to_optimizer = images.shapes, _similarities(normalize_size(images.shapes))
    start = np.zeros((len(shapes), *local.shape[1:]))
    start[known] = local
    start = images.points(start)
    coarse = [_transform_mesh(s.coarse_mesh, p) for s, p in zip(shapes, to_optimizer, strict=True)]
    points = [mesh.vertices[:: max(1, len(mesh.vertices) // N_CONTROL_POINTS)] for mesh in coarse]
    unknown = np.flatnonzero(~known).tolist()
    for number, k in enumerate(unknown):
        part_tick = part_of(tick, number / len(unknown), (number + 1) / len(unknown))
        part_tick(0.0, f"first particles of {shapes[k].name}")
        vertices = NearestPoints.of(coarse[k])
        costs = [float(np.mean(vertices.nearest(points[j])[0])) for j in np.flatnonzero(known)]
        nearest = int(np.flatnonzero(known)[int(np.argmin(costs))])
        carried = carry_particles(
            (_transform_mesh(shapes[nearest].mesh, to_optimizer[nearest]), coarse[nearest]),
            to_optimizer[nearest].apply(start[nearest]),
            (_transform_mesh(shapes[k].mesh, to_optimizer[k]), coarse[k]),
            part_tick,
        )
        start[k] = to_optimizer[k].invert(carried)
    return InitialParticles(images.points(start), np.repeat(~known[:, None], local.shape[1], axis=1))


@on_one_thread
def carry_particles(
    source: tuple[TriangleMesh, TriangleMesh],
    particles: FloatArray,
    target: tuple[TriangleMesh, TriangleMesh],
    tick: Tick = no_tick,
) -> FloatArray:
    """Transfer particles from one shape to another by registration, in one frame.

    Parameters
    ----------
    source, target : pair of TriangleMesh
        The fine and the coarse mesh of both.
    particles : (n, 3) array
        On the source.
    tick : Tick

    Returns
    -------
    (n, 3) array
        On the target.
    """
    moved, normals = _warp(source[1], target[1], particles, normals_at(source[0], particles), tick)
    return snap_to_mesh(moved, normals, target[0])


def _predict_misplaced(shapes: Sequence[Shape], local: FloatArray, misplaced: BoolArray) -> FloatArray:
    """Return the local particles, the misplaced ones predicted and snapped to their surface."""
    to_optimizer = _similarities(shapes)
    world = np.stack([p.apply(points) for p, points in zip(to_optimizer, local, strict=True)])
    predicted = predict_positions(world, misplaced)
    result = local.copy()
    for k in np.flatnonzero(misplaced.any(axis=1)).tolist():
        columns = misplaced[k]
        normals = np.zeros((int(columns.sum()), 3))
        for j, shape in enumerate(shapes):
            if j != k:
                normals += normals_at(_transform_mesh(shape.mesh, to_optimizer[j]), world[j, columns])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        snapped = snap_to_mesh(
            predicted[k, columns], normals, _transform_mesh(shapes[k].mesh, to_optimizer[k])
        )
        result[k, columns] = to_optimizer[k].invert(snapped)
    return result


def _similarities(shapes: Sequence[Shape]) -> list[Similarity]:
    unit = length_unit(shapes)
    return [Similarity.of(shape.alignment, unit) for shape in shapes]


def _transform_mesh(mesh: TriangleMesh, placement: Similarity) -> TriangleMesh:
    return TriangleMesh(placement.apply(mesh.vertices), mesh.faces)


def _warp(
    source: TriangleMesh, target: TriangleMesh, points: FloatArray, normals: FloatArray, tick: Tick
) -> tuple[FloatArray, FloatArray]:
    """Warp points and normals from one coarse mesh towards another, (n, 3) each."""
    registration = Registration.of(source)
    deformed = registration.deform([target], [source.vertices], tick)[0]
    control = registration.control
    through = ThinPlateMap.fit(source.vertices[control], points)
    near = NearestPoints.of(source, NORMAL_LENGTH).nearest(points, normals)[1]
    mesh = deformed.mesh
    return through.apply(mesh.vertices[control], INTERPOLATION_SMOOTHING), mesh.vertex_normals[near]
