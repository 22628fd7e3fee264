"""Initial particles: spread over a reference shape and mapped to the others by non-rigid registration.

If particles were split from a single one, chance would decide early which end of a shape corresponds to which
end of another; thin or branched shapes never recover from a wrong decision. A coarse registration decides
here: iterated closest points in position and normal, under a thin-plate map of decreasing stiffness. A shape
that is far from the reference is reached in steps, by way of shapes between.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Self

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from homolog.arrays import FloatArray, IntArray
from homolog.device import cores
from homolog.geometry import farthest_point_sampling
from homolog.progress import Tick, no_tick, part_of, run_in_background, run_in_threads
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.topology import edges
from homolog.threads import in_threads

__all__ = ["initial_particles", "registration_tree", "shape_distances", "snap_to_mesh", "spread_vertices"]

N_CONTROL_POINTS = 400  # of the thin-plate map, on the reference
N_ROUNDS = 12  # of closest points
MIN_LANDMARKS = 6  # for a thin-plate map; four points determine an affine map
FIRST_SMOOTHING, LAST_SMOOTHING = 1e3, 10.0  # of the thin-plate map in the first and last round
N_MATCHES, MATCH_WIDTH = (
    8,
    4.0,
)  # vertices averaged for a closest point; width of their weights [optimizer lengths]
N_CANDIDATES, N_SAMPLES = 40, 200  # for the reference; points of each shape that are compared
MIN_NORMAL_COSINE = 0.5  # between normals on the same wall
NORMAL_LENGTH = 20.0  # distance [optimizer lengths] equivalent to one radian between normals


@dataclass(frozen=True, slots=True, eq=False)
class ThinPlateMap:
    """Smoothing thin-plate maps (kernel r in 3-D; Wahba 1990) from control points to any of their targets.

    One eigendecomposition serves every smoothing and every target: with the kernel's part that no affine
    map sees, B diag(v) B', the map takes the points to ``bending @ (B' targets / (v + smoothing))`` plus
    ``affine @ targets``.
    """

    bending: FloatArray  # (points, control - 4)
    values: FloatArray  # (control - 4,)
    basis: FloatArray  # (control, control - 4)
    affine: FloatArray  # (points, control)

    @classmethod
    def fit(cls, control: FloatArray, points: FloatArray) -> Self:
        """Factorize the maps of `points` (V, 3) for control points (n, 3)."""
        kernel = -cdist(control, control)
        orthogonal, triangle = np.linalg.qr(
            np.column_stack([np.ones(len(control)), control]), mode="complete"
        )
        seen, unseen = orthogonal[:, :4], orthogonal[:, 4:]
        values, turned = np.linalg.eigh(unseen.T @ kernel @ unseen)
        basis = unseen @ turned
        affine = np.column_stack([np.ones(len(points)), points]) @ np.linalg.solve(triangle[:4], seen.T)
        bending = -cdist(points, control) @ basis - affine @ (kernel @ basis)
        return cls(bending, np.maximum(values, 0.0), basis, affine)

    def apply(self, targets: FloatArray, smoothing: float) -> FloatArray:
        """Return the mapped points (V, 3), for targets (n, 3) of the control points."""
        weights = (self.basis.T @ targets) / (self.values + smoothing)[:, None]
        result: FloatArray = self.bending @ weights + self.affine @ targets
        return result


def initial_particles(
    meshes: Sequence[TriangleMesh],
    count: int,
    seed: int = 0,
    tick: Tick = no_tick,
    landmarks: FloatArray | None = None,
) -> FloatArray:
    """Return corresponding initial particles on coarse meshes.

    Parameters
    ----------
    meshes : sequence of TriangleMesh
        The M shapes, aligned, in the optimizer's coordinates.
    count : int
        Particles a shape.
    seed : int
        Draws the vertex from which the particles are spread.
    tick : Tick
        Progress and cancelling.
    landmarks : (M, L, 3) array, optional
        Corresponding points, L <= count: the first L particles are the vertices nearest to them, and the
        registrations of the others start from the thin-plate map between them.

    Returns
    -------
    (M, count, 3) array
        On the meshes, or nearly.
    """
    normals = list(in_threads(lambda mesh: mesh.vertex_normals, meshes, cores()))
    reference, parents = registration_tree(*shape_distances(meshes, part_of(tick, 0.0, 0.1)))
    source = meshes[reference]
    control = farthest_point_sampling(source.vertices, min(N_CONTROL_POINTS, len(source.vertices)))
    landmark_vertices = _landmark_vertices(meshes, landmarks)
    if len(landmark_vertices[reference]):
        chosen = spread_vertices(source, count, landmark_vertices[reference])
    else:
        begin = int(np.random.default_rng(seed).integers(len(source.vertices)))
        chosen = spread_vertices(source, count, np.array([begin]))
    maps = run_in_background(
        lambda _: ThinPlateMap.fit(source.vertices[control], source.vertices),
        part_of(tick, 0.1, 0.1),
        "first particles",
    )

    result = np.empty((len(meshes), count, 3))
    result[reference] = source.vertices[chosen]
    deformed = {reference: source}

    def deform(index: int, inner: Tick) -> TriangleMesh:
        own = landmark_vertices[index]
        guess = _guess_of_landmarks(source, landmark_vertices[reference], meshes[index].vertices[own])
        guess = guess or deformed[int(parents[index])]
        return register(source, control, meshes[index], normals[index], maps, guess, inner)

    while len(deformed) < len(meshes):
        ready = [i for i in range(len(meshes)) if i not in deformed and int(parents[i]) in deformed]
        done = len(deformed) / len(meshes)
        part = part_of(tick, 0.1 + 0.9 * done, 0.1 + 0.9 * (done + len(ready) / len(meshes)))
        works = [partial(deform, index) for index in ready]
        deformed |= dict(zip(ready, run_in_threads(works, part, "first particles", cores()), strict=True))

    def snapped(index: int) -> FloatArray:
        mesh = deformed[index]
        return snap_to_mesh(mesh.vertices[chosen], mesh.vertex_normals[chosen], meshes[index])

    others = [index for index in deformed if index != reference]
    for index, points in zip(others, in_threads(snapped, others, cores()), strict=True):
        own = landmark_vertices[index]
        result[index] = points
        result[index, : len(own)] = meshes[index].vertices[own]
    return result


def spread_vertices(mesh: TriangleMesh, count: int, begin: IntArray) -> IntArray:
    """Return vertices far from each other along the surface, so that both sides of a wall get some.

    Parameters
    ----------
    mesh : TriangleMesh
    count : int
        How many are chosen.
    begin : (k,) int array
        The first of them.

    Returns
    -------
    (count,) int array
        In the order in which they are chosen: each is the farthest from those before by paths along edges
        (Gonzalez 1985).
    """
    pairs = edges(mesh.faces)
    lengths = np.linalg.norm(np.diff(mesh.vertices[pairs], axis=1)[:, 0], axis=1)
    rows, columns = np.concatenate([pairs, pairs[:, ::-1]]).T
    graph = coo_array((np.tile(lengths, 2), (rows, columns)), shape=(len(mesh.vertices),) * 2).tocsr()
    chosen = [int(vertex) for vertex in begin]
    gap = dijkstra(graph, indices=chosen, min_only=True)
    while len(chosen) < count:
        chosen.append(int(gap.argmax()))
        gap = np.minimum(gap, dijkstra(graph, indices=[chosen[-1]], min_only=True, limit=float(gap.max())))
    return np.array(chosen)


def _landmark_vertices(meshes: Sequence[TriangleMesh], landmarks: FloatArray | None) -> list[IntArray]:
    """Return the vertices nearest to each shape's landmarks; none for a landmark that shares its vertex."""
    if landmarks is None:
        return [np.empty(0, dtype=np.int64) for _ in meshes]
    pairs = zip(meshes, landmarks, strict=True)
    vertices = np.array([cKDTree(mesh.vertices).query(points)[1] for mesh, points in pairs])
    distinct = [
        index
        for index in range(vertices.shape[1])
        if not (vertices[:, :index] == vertices[:, index : index + 1]).any()
    ]
    return list(vertices[:, distinct])


def _guess_of_landmarks(
    source: TriangleMesh, landmark_vertices: IntArray, targets: FloatArray
) -> TriangleMesh | None:
    """Return the source deformed by the thin-plate map of its landmarks; None if there are too few."""
    points = source.vertices[landmark_vertices]
    if len(landmark_vertices) < MIN_LANDMARKS or np.linalg.matrix_rank(points - points.mean(axis=0)) < 3:
        return None
    maps = ThinPlateMap.fit(points, source.vertices)
    return TriangleMesh(maps.apply(targets, LAST_SMOOTHING), source.faces)


def register(
    source: TriangleMesh,
    control: IntArray,
    target: TriangleMesh,
    normals: FloatArray,
    maps: ThinPlateMap,
    initial_guess: TriangleMesh,
    tick: Tick = no_tick,
) -> TriangleMesh:
    """Return the source mesh deformed onto the target by closest points, under softening thin plates.

    A closest point is the mean of a few vertices, by their distances: between vertices there is surface too.
    The first closest points are those of the guess, a deformed source.
    """
    deformed = initial_guess
    tree = cKDTree(features(target.vertices, normals))
    for number, smoothing in enumerate(np.geomspace(FIRST_SMOOTHING, LAST_SMOOTHING, N_ROUNDS)):
        tick(number / N_ROUNDS, "first particles")
        source_features = features(deformed.vertices, deformed.vertex_normals)
        nearest = tree.query(source_features[control], k=N_MATCHES)
        distances, vertices = np.asarray(nearest[0]), np.asarray(nearest[1])
        weights = np.exp(-0.5 * (np.square(distances) - np.square(distances[:, :1])) / MATCH_WIDTH**2)
        weights /= weights.sum(axis=1, keepdims=True)
        matched = np.einsum("nk,nkd->nd", weights, target.vertices[vertices])
        deformed = TriangleMesh(maps.apply(matched, float(smoothing)), source.faces)
    return deformed


def features(vertices: FloatArray, normals: FloatArray) -> FloatArray:
    """Return the features for closest points: positions and weighted normals, shape (V, 6)."""
    return np.hstack([vertices, NORMAL_LENGTH * normals])


def shape_distances(meshes: Sequence[TriangleMesh], tick: Tick = no_tick) -> tuple[IntArray, FloatArray]:
    """Return at most 40 shapes (K,) and their mean distances to all shapes, both ways, shape (K, M)."""
    trees = [cKDTree(mesh.vertices) for mesh in meshes]
    points = []

    def spread_points(mesh: TriangleMesh) -> FloatArray:
        return mesh.vertices[farthest_point_sampling(mesh.vertices, N_SAMPLES)]

    for index, chosen in enumerate(in_threads(spread_points, meshes, cores())):
        tick(0.5 * index / len(meshes), "most typical shape")
        points.append(chosen)
    together = np.concatenate(points)

    def to_all(k: int) -> FloatArray:
        forward = np.asarray(trees[k].query(together)[0]).reshape(len(meshes), -1)
        back = [np.mean(np.asarray(tree.query(points[k])[0])) for tree in trees]
        both: FloatArray = forward.mean(axis=1) + np.array(back)
        return both

    candidates = np.arange(0, len(meshes), max(1, len(meshes) // N_CANDIDATES))
    distances = np.empty((len(candidates), len(meshes)))
    for row, row_distances in enumerate(in_threads(to_all, candidates.tolist(), cores())):
        tick(0.5 + 0.5 * row / len(candidates), "most typical shape")
        distances[row] = row_distances
    return candidates, distances


def registration_tree(candidates: IntArray, distances: FloatArray) -> tuple[int, IntArray]:
    """Return the reference, and by way of which shape each is reached, shape (M,); itself for the reference.

    The reference is the candidate nearest to all. Others are reached by the path through candidates whose
    squared steps sum to the least. Shapes that vary in many independent ways are reached directly, since
    the squared distance of two is then the sum of theirs to the reference. Where one large variation
    prevails, steps along it are shorter than the whole.
    """
    n_shapes = distances.shape[1]
    reference = int(candidates[int(np.argmin(distances.sum(axis=1)))])
    squared = np.zeros((n_shapes, n_shapes))
    squared[candidates] = np.square(distances)
    parents = dijkstra(squared, indices=[reference], return_predecessors=True)[1][0]
    return reference, np.where(parents < 0, reference, parents)


def snap_to_mesh(points: FloatArray, normals: FloatArray, mesh: TriangleMesh) -> FloatArray:
    """Return points on a mesh close to the given ones, where the normals agree.

    Parameters
    ----------
    points, normals : (n, 3) arrays
        Points near the mesh, and the outward unit normals that are expected there.
    mesh : TriangleMesh
        In the same coordinates.

    Returns
    -------
    (n, 3) array
        Points on the mesh.
    """
    normals_of_mesh = mesh.vertex_normals
    nearest: IntArray = np.asarray(
        cKDTree(features(mesh.vertices, normals_of_mesh)).query(features(points, normals))[1]
    )
    closest, closest_normals = mesh.vertices[nearest], normals_of_mesh[nearest]
    tangential = points - closest
    tangential -= closest_normals * np.einsum("nd,nd->n", tangential, closest_normals)[:, None]
    length = np.linalg.norm(tangential, axis=1, keepdims=True)
    snapped: FloatArray = closest + tangential * np.minimum(1.0, mesh.mean_edge / np.maximum(length, 1e-12))
    nearby_normals = normals_of_mesh[np.asarray(cKDTree(mesh.vertices).query(snapped)[1])]
    crosses_wall = (
        np.einsum("nd,nd->n", nearby_normals, closest_normals) < MIN_NORMAL_COSINE
    )  # the wall is thin and bends
    snapped[crosses_wall] = closest[crosses_wall]
    return snapped
