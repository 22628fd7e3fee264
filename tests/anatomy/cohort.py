"""Random cohorts of known correspondence: one random solid, deformed in eight ways, as files that a user has.

All shapes of a cohort are images of the same vertices, so that a vertex number is a place of the anatomy.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import ndimage
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation
from skimage import measure

from homolog.io.meshes import write_mesh
from homolog.surfaces.isosurface import marching_cubes
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.mesh_level import mesh_level

__all__ = ["FAMILIES", "KINDS", "RandomCohort", "carried", "carried_errors", "random_cohort", "write_cohort"]

_NODES = 72  # of the base solid's grid along its longest axis
_VERTICES = 8000
_Points = np.ndarray


@dataclass(frozen=True, slots=True)
class RandomCohort:
    """Meshes that share their faces.

    Attributes
    ----------
    family : str
        How the subjects differ: a name of `FAMILIES`.
    kind : str
        What they are written as: a name of `KINDS`.
    meshes : tuple of TriangleMesh
        One a subject [mm]; vertices correspond.
    """

    family: str
    kind: str
    meshes: tuple[TriangleMesh, ...]


def random_cohort(seed: int, subjects: int = 8) -> RandomCohort:
    """Return a random cohort; the same seed gives the same one."""
    rng = np.random.default_rng([20261123, seed])
    names = list(FAMILIES)
    family = names[seed % len(names)]
    base = _walled(rng) if family == "thin a wall" else _solid(rng)
    deform = FAMILIES[family](rng, base)
    size = 10.0 ** rng.uniform(0.8, 2.2)
    meshes = []
    for amount in rng.permutation(np.linspace(-1.0, 1.0, subjects)):
        vertices = size * _smooth_noise(rng, deform(np.array(base.vertices), float(amount)))
        turn = Rotation.from_rotvec(np.deg2rad(rng.uniform(-15.0, 15.0, 3)))
        vertices = turn.apply(vertices) + size * rng.uniform(-0.3, 0.3, 3)
        meshes.append(TriangleMesh(vertices, base.faces))
    return RandomCohort(family, KINDS[seed // len(names) % len(KINDS)], tuple(meshes))


def write_cohort(cohort: RandomCohort, folder: Path) -> None:
    """Write one file a subject: a mesh, or a label map of some hundred thousand voxels."""
    from anatomy import LabelMap, write_label_map

    for number, mesh in enumerate(cohort.meshes, start=1):
        if cohort.kind == "meshes":
            write_mesh(folder / f"subject{number:02d}.ply", mesh)
            continue
        low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
        step = float(((high - low).prod() / 250_000.0) ** (1 / 3))
        shape = tuple((np.ceil((high - low) / step) + 5).astype(int))
        mask = mesh_level(mesh, low - 2.0 * step, step, shape) < 0.0
        made = LabelMap(mask, np.full(3, step), np.eye(3), low - 2.0 * step)
        write_label_map(made, folder / f"subject{number:02d}.nrrd")


def carried_errors(cohort: RandomCohort, particles: np.ndarray) -> np.ndarray:
    """Return how far particles carried by the known correspondence are from those of the same number.

    Parameters
    ----------
    cohort : RandomCohort
        The truth.
    particles : (S, N, 3) array
        In the frames of the files [mm].

    Returns
    -------
    (S * (S - 1) * N,) array
        In spacings of the particles on the shape carried to.
    """
    spacing = np.sqrt([mesh.area / particles.shape[1] * 2.0 / np.sqrt(3.0) for mesh in cohort.meshes])
    errors = []
    for i, points in enumerate(particles):
        distance = np.linalg.norm(carried(cohort.meshes, i, points) - particles, axis=2) / spacing[:, None]
        errors.append(np.delete(distance, i, axis=0).ravel())
    return np.concatenate(errors)


def carried(meshes: Sequence[TriangleMesh], source: int, particles: np.ndarray) -> np.ndarray:
    """Return particles (N, 3) of one shape carried to each by the known correspondence, (S, N, 3)."""
    face, weights = _places(meshes[source], particles)
    return np.stack([(mesh.vertices[mesh.faces[face]] * weights[:, :, None]).sum(axis=1) for mesh in meshes])


def _places(mesh: TriangleMesh, points: _Points) -> tuple[np.ndarray, np.ndarray]:
    """Return the nearest faces and the barycentric coordinates there, of faces around the nearest middles."""
    corners = mesh.vertices[mesh.faces]
    _, candidates = KDTree(corners.mean(axis=1)).query(points, k=24)
    best, weights, distance = (
        np.zeros(len(points), int),
        np.zeros((len(points), 3)),
        np.full(len(points), np.inf),
    )
    for faces in candidates.T:
        result = _barycentric(corners[faces], points)
        off = np.linalg.norm((corners[faces] * result[:, :, None]).sum(axis=1) - points, axis=1)
        closer = off < distance
        best[closer], weights[closer], distance[closer] = faces[closer], result[closer], off[closer]
    return best, weights


def _barycentric(triangles: np.ndarray, points: _Points) -> np.ndarray:
    """Return coordinates of the projections of points to triangles, clipped to the triangles."""
    a, u, v = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    w = points - a
    uu, uv, vv, wu, wv = (
        (item * other).sum(axis=1) for item, other in ((u, u), (u, v), (v, v), (w, u), (w, v))
    )
    scale = np.maximum(uu * vv - uv * uv, 1e-30)
    result = np.stack([np.zeros(len(a)), (vv * wu - uv * wv) / scale, (uu * wv - uv * wu) / scale], axis=1)
    result[:, 0] = 1.0 - result[:, 1] - result[:, 2]
    result = np.clip(result, 0.0, None)
    return result / result.sum(axis=1, keepdims=True)


def _mesh_of(values: np.ndarray, box: _Points) -> TriangleMesh:
    from homolog.surfaces.simplify import simplified

    nodes, faces = marching_cubes(values)
    vertices = nodes / (np.array(values.shape) - 1) * 2.0 * box - box
    return simplified(TriangleMesh(vertices, faces), _VERTICES)


def _solid(rng: np.random.Generator) -> TriangleMesh:
    """Return a random solid without handles, no two axes alike, about 2 wide."""
    axes = np.array([1.0, rng.uniform(0.55, 0.75), rng.uniform(0.35, 0.5)])
    box = 1.6 * axes
    shape = np.maximum((_NODES * box / box.max()).astype(int), 24)
    grid = np.stack(
        np.meshgrid(*(np.linspace(-b, b, n) for b, n in zip(box, shape, strict=True)), indexing="ij"), -1
    )
    while True:
        field = ndimage.gaussian_filter(rng.normal(size=shape), _NODES / 8.0, mode="nearest")
        values = np.linalg.norm(grid / axes, axis=-1) - 1.0 + 0.25 * field / field.std()
        inside = ndimage.label(values < 0.0)[0]
        inside = ndimage.binary_fill_holes(inside == 1 + np.argmax(np.bincount(inside.ravel())[1:]))
        at_border = any(np.moveaxis(inside, axis, 0)[[0, 1, -2, -1]].any() for axis in range(3))
        if not at_border and measure.euler_number(inside, 1) == measure.euler_number(inside, 3) == 1:
            values = np.where(inside == (values < 0.0), values, np.where(inside, -0.05, 0.05))
            return _mesh_of(ndimage.gaussian_filter(values, 1.0), box)


def _walled(rng: np.random.Generator) -> TriangleMesh:
    """Return an uneven cup, about 2 high: a thick wall around an open cavity."""
    box = np.array([1.2, 1.2, 1.4])
    shape = (64, 64, 74)
    x, y, z = np.meshgrid(*(np.linspace(-b, b, n) for b, n in zip(box, shape, strict=True)), indexing="ij")
    noise = ndimage.gaussian_filter(rng.normal(size=shape), 12.0)
    noise *= 0.05 / noise.std()
    outer = np.sqrt((x / 0.8) ** 2 + (y / rng.uniform(0.6, 0.7)) ** 2 + (z / 1.1) ** 2) - 1.0 + noise
    inner = np.sqrt((x / 0.5) ** 2 + (y / 0.36) ** 2 + ((z - 0.1) / 0.85) ** 2) - 1.0
    return _mesh_of(np.maximum(np.maximum(0.7 * outer, -0.45 * inner), z - 0.45 - 0.2 * x), box)


_Deformation = Callable[[_Points, float], _Points]


def _bend(rng: np.random.Generator, _: TriangleMesh) -> _Deformation:
    """Bend the long axis to an arc."""
    most = np.deg2rad(rng.uniform(15.0, 35.0))

    def deform(points: _Points, amount: float) -> _Points:
        angle = most * amount * points[:, 0]  # at a place along the axis
        curvature = most * amount + 1e-9
        radius = 1.0 / curvature - points[:, 1]
        return np.stack(
            [radius * np.sin(angle), 1.0 / curvature - radius * np.cos(angle), points[:, 2]], axis=1
        )

    return deform


def _twist(rng: np.random.Generator, _: TriangleMesh) -> _Deformation:
    most = np.deg2rad(rng.uniform(12.0, 30.0))

    def deform(points: _Points, amount: float) -> _Points:
        return Rotation.from_rotvec(np.outer(most * amount * points[:, 0], [1.0, 0.0, 0.0])).apply(points)

    return deform


def _grow(rng: np.random.Generator, base: TriangleMesh) -> _Deformation:
    """Let a process grow out of a random place."""
    root = int(rng.integers(len(base.vertices)))
    centre, direction = base.vertices[root], base.vertex_normals[root]
    width, height = rng.uniform(0.25, 0.4), rng.uniform(0.4, 0.8)

    def deform(points: _Points, amount: float) -> _Points:
        near = np.exp(-0.5 * ((points - centre) ** 2).sum(axis=1) / width**2)
        return points + height * 0.5 * (amount + 1.0) * near[:, None] * direction

    return deform


def _thin(rng: np.random.Generator, _: TriangleMesh) -> _Deformation:
    """Make the wall of a cup thinner or thicker from its inside, and its cavity wider or narrower."""
    most = rng.uniform(0.12, 0.2)

    def deform(points: _Points, amount: float) -> _Points:
        return points * (1.0 + most * amount * np.exp(-3.0 * (points[:, :2] ** 2).sum(axis=1)))[:, None]

    return deform


def _resize(rng: np.random.Generator, base: TriangleMesh) -> _Deformation:
    """Change the size threefold, with some bending."""
    bend = _bend(rng, base)
    return lambda points, amount: 3.0 ** (0.5 * amount) * bend(points, 0.4 * amount)


def _stretch(rng: np.random.Generator, _: TriangleMesh) -> _Deformation:
    most = rng.uniform(0.2, 0.4, 3) * rng.choice([-1.0, 1.0], 3)
    return lambda points, amount: points * np.exp(most * amount)


def _smooth_noise(rng: np.random.Generator, points: _Points) -> _Points:
    """Move places by a smooth random field of a few per cent: subjects differ in more than one way."""
    waves = rng.normal(scale=1.2, size=(12, 3))
    phases, moves = rng.uniform(0.0, 2.0 * np.pi, 12), rng.normal(scale=0.012, size=(12, 3))
    return points + np.sin(points @ waves.T + phases) @ moves


FAMILIES: dict[str, Callable[[np.random.Generator, TriangleMesh], _Deformation]] = {
    "bend": _bend,
    "twist": _twist,
    "grow a process": _grow,
    "thin a wall": _thin,
    "change size threefold": _resize,
    "stretch": _stretch,
}
KINDS = ("meshes", "label maps")
