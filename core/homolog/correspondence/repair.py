"""Optimizing only some of a result's particles: a patch put right, new subjects fitted to a frozen model.

Particles that are to move first go where the other subjects' correspondence predicts them, so that the
optimizer has to find the place but not the neighbourhood.
"""

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from homolog.arrays import BoolArray, FloatArray, IntArray
from homolog.correspondence.mirror_images import with_mirror_images
from homolog.correspondence.optimizer import optimize
from homolog.correspondence.start import (
    SmoothingMap,
    features,
    register,
    snapped,
    spread_indices,
    vertex_normals,
)
from homolog.correspondence.strays import predicted
from homolog.correspondence.surfaces import Placement, length_unit, of_one_size
from homolog.correspondence.types import Observe, OptimizedParticles, Shape, Start
from homolog.errors import InputError
from homolog.progress import Tick, no_tick, part_of
from homolog.settings import OptimizeSettings
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["fitting_start", "repair"]

CONTROL = 400  # points that drive a thin-plate map
TIGHT = 1e-6  # smoothing of a thin-plate map that passes through its targets
ANNEAL, SETTLE = 100, 200  # iterations of a repair, at most
LOOSE = 0.2  # regularisation at its start


def repair(
    shapes: Sequence[Shape],
    settings: OptimizeSettings,
    local: FloatArray,
    movable: BoolArray,
    *,
    misplaced: BoolArray | None = None,
    device: str = "auto",
    tick: Tick = no_tick,
    observe: Observe | None = None,
) -> OptimizedParticles:
    """Put some particles of a result right; the others stay as they are, to the bit.

    Parameters
    ----------
    shapes : sequence of Shape
        M of them, aligned as they were in the end.
    settings : OptimizeSettings
        Of the run that made the result.
    local : (M, N, 3) array
        All particles in file coordinates [mm].
    movable : (M, N) bool array
        Those that may move: a patch on one subject, or on several.
    misplaced : (M, N) bool array, optional
        Those that are not trusted at all: they begin where the other subjects predict them. By default
        all that are movable.
    device, tick, observe
        As in `optimize`.

    Returns
    -------
    OptimizedParticles
        Of all subjects.

    Raises
    ------
    InputError
        If the arrays do not fit the shapes, or nothing is movable.
    """
    wrong = movable if misplaced is None else misplaced
    if local.shape[:2] != (len(shapes), *movable.shape[1:]) or wrong.shape != movable.shape:
        raise InputError("the particles and the choice of those that may move are not of the same cohort")
    settings = settings.model_copy(
        update={
            "particles": local.shape[1],
            "anneal_iterations": ANNEAL,
            "settle_iterations": SETTLE,
            "regularization_start": max(LOOSE, settings.regularization_end),
        }
    )
    images = with_mirror_images(shapes)
    placed = images.points(_placed(images.shapes, images.points(local), wrong))
    start = Start(placed, movable)
    return optimize(shapes, settings, device=device, tick=tick, observe=observe, start=start)


def fitting_start(
    shapes: Sequence[Shape], local: FloatArray, known: BoolArray, tick: Tick = no_tick
) -> Start:
    """Return where to begin fitting new subjects to a frozen model.

    Parameters
    ----------
    shapes : sequence of Shape
        M of them, the known ones aligned as the model has them.
    local : (K, N, 3) array
        Particles of the known shapes, in their order, in file coordinates [mm].
    known : (M,) bool array
        Which K of the shapes they are.
    tick : Tick
        Progress and cancelling.

    Returns
    -------
    Start
        On each new shape the particles of the known one that is nearest to it, carried by the registration
        that also places first particles; only those may move.
    """
    images = with_mirror_images(shapes)
    shapes, placements = images.shapes, _placements(of_one_size(images.shapes))
    start = np.zeros((len(shapes), *local.shape[1:]))
    start[known] = local
    start = images.points(start)
    coarse = [_moved(s.coarse_mesh, p) for s, p in zip(shapes, placements, strict=True)]
    points = [mesh.vertices[:: max(1, len(mesh.vertices) // CONTROL)] for mesh in coarse]
    unknown = np.flatnonzero(~known).tolist()
    for number, k in enumerate(unknown):
        here = part_of(tick, number / len(unknown), (number + 1) / len(unknown))
        here(0.0, f"first particles of {shapes[k].name}")
        tree = cKDTree(coarse[k].vertices)
        costs = [float(np.mean(tree.query(points[j])[0])) for j in np.flatnonzero(known)]
        nearest = int(np.flatnonzero(known)[int(np.argmin(costs))])
        fine = _moved(shapes[nearest].mesh, placements[nearest])
        particles = placements[nearest].apply(start[nearest])
        normals = _normals_at(fine, particles)
        moved, normals = _carried(coarse[nearest], coarse[k], particles, normals, here)
        feet = snapped(moved, normals, _moved(shapes[k].mesh, placements[k]))
        start[k] = placements[k].invert(feet)
    return Start(images.points(start), np.repeat(~known[:, None], local.shape[1], axis=1))


def _placed(shapes: Sequence[Shape], local: FloatArray, misplaced: BoolArray) -> FloatArray:
    """Return the local particles, the misplaced ones predicted and snapped to their surface."""
    placements = _placements(shapes)
    world = np.stack([p.apply(one) for p, one in zip(placements, local, strict=True)])
    goals = predicted(world, misplaced)
    result = local.copy()
    for k in np.flatnonzero(misplaced.any(axis=1)).tolist():
        columns = misplaced[k]
        normals = np.zeros((int(columns.sum()), 3))
        for j, shape in enumerate(shapes):
            if j != k:
                normals += _normals_at(_moved(shape.mesh, placements[j]), world[j, columns])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        feet = snapped(goals[k, columns], normals, _moved(shapes[k].mesh, placements[k]))
        result[k, columns] = placements[k].invert(feet)
    return result


def _placements(shapes: Sequence[Shape]) -> list[Placement]:
    unit = length_unit(shapes)
    return [Placement(s.alignment[:3, :3] / unit, s.alignment[:3, 3] / unit) for s in shapes]


def _moved(mesh: TriangleMesh, placement: Placement) -> TriangleMesh:
    return TriangleMesh(placement.apply(mesh.vertices), mesh.faces)


def _normals_at(mesh: TriangleMesh, points: FloatArray) -> FloatArray:
    """Return the mesh's normals at points on it, (n, 3)."""
    nearest: IntArray = np.asarray(cKDTree(mesh.vertices).query(points)[1])
    normals: FloatArray = vertex_normals(mesh)[nearest]
    return normals


def _carried(
    source: TriangleMesh, target: TriangleMesh, points: FloatArray, normals: FloatArray, tick: Tick
) -> tuple[FloatArray, FloatArray]:
    """Return points and normals on one coarse mesh carried towards another, (n, 3) each."""
    control = spread_indices(source.vertices, min(CONTROL, len(source.vertices)))
    maps = SmoothingMap.between(source.vertices[control], source.vertices)
    deformed = register(source, control, target, vertex_normals(target), maps, tick=tick)
    through = SmoothingMap.between(source.vertices[control], points)
    near = cKDTree(features(source.vertices, vertex_normals(source))).query(features(points, normals))[1]
    return through.moved(deformed.vertices[control], TIGHT), vertex_normals(deformed)[near]
