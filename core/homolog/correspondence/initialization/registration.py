"""Initial particles: spread over a reference shape and mapped to the others by non-rigid registration.

If all particles were split from a single one, chance would decide which ends of two shapes correspond, and
thin or branched shapes would not recover from a wrong decision. A coarse registration decides instead:
iterated closest points in position and normal, under a thin-plate map of decreasing stiffness. A shape that
is far from the reference is registered in steps, through intermediate shapes.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain
from typing import Self

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial.distance import cdist

from homolog.arrays import FloatArray, IntArray
from homolog.correspondence.initialization.spreading import spread_vertices
from homolog.geometry import farthest_point_sampling, inverse_matrices, transform_points
from homolog.progress import Tick, no_tick, part_of, run_in_background, run_in_threads
from homolog.registration.procrustes import posed_meshes
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.nearest import NearestPoints, normals_at
from homolog.threads import cores, in_threads, on_one_thread

__all__ = [
    "InitialRegistration",
    "Registration",
    "registration_tree",
    "shape_distances",
    "snap_to_mesh",
]

N_CONTROL_POINTS = 400  # of the thin-plate map, on the reference
N_MATCHES = 8  # vertices averaged for a closest point
LEAST_TURN = 1e-3  # of equal normals, as an error
N_ROUNDS = 12  # of closest points
N_TOGETHER, N_TOGETHER_OF_MANY = 8, 32  # shapes registered in one piece of work, on any number of cores
MANY_SHAPES = 128  # from which larger pieces pay
MIN_LANDMARKS = 6  # for a thin-plate map; four points determine an affine map
FIRST_SMOOTHING, LAST_SMOOTHING = 1e3, 10.0  # of the thin-plate map in the first and last round
SMOOTHINGS = np.geomspace(FIRST_SMOOTHING, LAST_SMOOTHING, N_ROUNDS).tolist()
N_CANDIDATES, N_SAMPLES = 40, 200  # for the reference; points of each shape that are compared
FEWEST_CANDIDATES, MAX_COMPARED = 10, 8000  # of large cohorts; pairs of shapes that are compared
MIN_NORMAL_COSINE = 0.5  # between normals on the same wall
NORMAL_LENGTH = 20.0  # distance [optimizer lengths] equivalent to one radian, where no registration tells it


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
        """Return the mapped points (V, 3K), for targets (n, 3K) of the control points by K maps."""
        weights = (self.basis.T @ targets) / (self.values + smoothing)[:, None]
        result: FloatArray = self.bending @ weights + self.affine @ targets
        return result


@dataclass(frozen=True, slots=True)
class MatchErrors:
    """Errors of closest points on one target, as standard deviations of a coordinate.

    Attributes
    ----------
    position : float
        In optimizer lengths; at least that of vertices in place of points between them.
    normal : float or None
        Of unit normals; None before any was measured, when positions alone decide.
    """

    position: float
    normal: float | None = None

    @property
    def normal_length(self) -> float:
        """The distance equivalent to a difference of one between unit normals."""
        return 0.0 if self.normal is None else self.position / self.normal

    @classmethod
    def measured(
        cls,
        points: FloatArray,
        normals: FloatArray,
        matched: FloatArray,
        matched_normals: FloatArray,
        target: TriangleMesh,
    ) -> Self:
        """Return the errors of closest points (n, 3) of some points, where their sides agree."""
        agree = np.einsum("nd,nd->n", normals, matched_normals) > 0.0
        agree |= not agree.any()
        squared = np.square(matched - points)[agree].sum(axis=1).mean() / 3.0
        turned = np.square(matched_normals - normals)[agree].sum(axis=1).mean() / 2.0
        least = _vertex_error(target)
        return cls(max(float(np.sqrt(squared)), least), max(float(np.sqrt(turned)), LEAST_TURN))


def _vertex_error(mesh: TriangleMesh) -> float:
    """Return the standard deviation of a coordinate between a point and the nearest vertex."""
    return mesh.mean_edge / float(np.sqrt(12.0))


@dataclass(frozen=True, slots=True, eq=False)
class Deformed:
    """A source mesh deformed onto a target.

    Attributes
    ----------
    mesh : TriangleMesh
    normal_length : float
        The distance [optimizer lengths] that counts as much as a difference of one between unit normals.
    """

    mesh: TriangleMesh
    normal_length: float


@dataclass(frozen=True, slots=True, eq=False)
class Registration:
    """A source mesh to be deformed onto others by closest points, under softening thin plates.

    A closest point is the mean of a few vertices, weighted by distance, because the surface continues between
    them. Distances are in position and normal, each in units of its error (Mahalanobis), which is measured on
    the closest points of the round before: normals decide where shapes are far apart and smooth, positions
    where they are near and rough. A control point that meets only the other side of a wall stays where it is.
    """

    source: TriangleMesh
    control: IntArray  # (n,) vertices
    maps: ThinPlateMap
    corners: IntArray  # (F, 3) vertices of the faces with a control point
    incidence: csr_array  # (n, F) which of the faces meet at a control point

    @classmethod
    @on_one_thread
    def of(cls, source: TriangleMesh) -> Self:
        """Choose the control points and factorize their maps."""
        control = farthest_point_sampling(source.vertices, min(N_CONTROL_POINTS, len(source.vertices)))
        rows = np.full(len(source.vertices), -1)
        rows[control] = np.arange(len(control))
        corners = source.faces[(rows[source.faces] >= 0).any(axis=1)]
        face, corner = np.nonzero(rows[corners] >= 0)
        entries = np.ones(len(face)), (rows[corners[face, corner]], face)
        incidence = coo_array(entries, shape=(len(control), len(corners))).tocsr()
        maps = ThinPlateMap.fit(source.vertices[control], source.vertices)
        return cls(source, control, maps, corners, incidence)

    def deform(
        self, targets: Sequence[TriangleMesh], guesses: Sequence[FloatArray], tick: Tick = no_tick
    ) -> list[Deformed]:
        """Return the source deformed onto each of some targets.

        Parameters
        ----------
        targets : sequence of TriangleMesh
            Registered together, because one product of many columns is faster than many of three.
        guesses : sequence of (V, 3) arrays
            The source's vertices, deformed as the first closest points are searched from.
        tick : Tick
            Cancelling.
        """
        deformed = np.stack(guesses, axis=1)  # (V, targets, 3)
        errors = [MatchErrors(_vertex_error(target)) for target in targets]
        for smoothing in (None, *SMOOTHINGS):
            places, normals = deformed[self.control], self._control_normals(deformed)
            matched = np.empty((len(targets), *self.control.shape, 3))
            for index, target in enumerate(targets):
                tick(0.0, "first particles")
                own = places[:, index], normals[:, index]
                closest_and_normals = _closest_points(target, *own, errors[index])
                errors[index] = MatchErrors.measured(*own, *closest_and_normals, target)
                opposes = np.einsum("nd,nd->n", own[1], closest_and_normals[1]) <= 0.0
                matched[index] = np.where(opposes[:, None], own[0], closest_and_normals[0])
            if smoothing is not None:  # the first closest points tell their errors only
                flat = matched.transpose(1, 0, 2).reshape(len(self.control), -1)
                deformed = self.maps.apply(flat, smoothing).reshape(deformed.shape)
        return [
            Deformed(TriangleMesh(deformed[:, index].copy(), self.source.faces), error.normal_length)
            for index, error in enumerate(errors)
        ]

    def _control_normals(self, deformed: FloatArray) -> FloatArray:
        """Return the normals (n, targets, 3) at the control points of meshes (V, targets, 3)."""
        a, b, c = (deformed[self.corners[:, corner]] for corner in range(3))
        across = np.cross(b - a, c - a).reshape(len(self.corners), -1)
        sums = (self.incidence @ across).reshape(len(self.control), -1, 3)
        normals: FloatArray = sums / np.maximum(np.linalg.norm(sums, axis=2, keepdims=True), 1e-300)
        return normals


def _closest_points(
    target: TriangleMesh, points: FloatArray, normals: FloatArray, errors: MatchErrors
) -> tuple[FloatArray, FloatArray]:
    """Return the closest points of a target, and unit normals there, (n, 3) each.

    They are means of the vertices nearest in position and normal, weighted by their distances.
    """
    vertices = NearestPoints.of(target, errors.normal_length)
    distances, rows = vertices.nearest(points, normals, count=N_MATCHES)
    squared = np.square(distances)
    weights = np.exp(-0.5 * (squared - squared[:, :1]) / errors.position**2)
    weights /= weights.sum(axis=1, keepdims=True)
    matched = np.einsum("nk,nkd->nd", weights, vertices.points[rows])
    turned = np.einsum("nk,nkd->nd", weights, vertices.normals[rows])
    turned /= np.maximum(np.linalg.norm(turned, axis=1, keepdims=True), 1e-9)
    return matched, turned


class InitialRegistration:
    """Corresponding particles on coarse meshes, computed again as the poses of the shapes improve.

    Data independent of poses are computed once: the reference, its particles, and
    the paths to the other shapes.

    Parameters
    ----------
    meshes : sequence of TriangleMesh
        The M shapes in the optimizer's coordinates, roughly aligned.
    count : int
        Particles a shape.
    seed : int
        Draws the vertex from which the particles are spread.
    landmarks : (M, L, 3) array, optional
        Corresponding points, L <= count: the first L particles are the vertices nearest to them, and the
        registrations of the others start from the thin-plate map between them.
    tick : Tick
        Progress and cancellation.
    """

    def __init__(
        self,
        meshes: Sequence[TriangleMesh],
        count: int,
        seed: int = 0,
        landmarks: FloatArray | None = None,
        tick: Tick = no_tick,
    ) -> None:
        self._meshes, self._landmarks = meshes, _landmark_vertices(meshes, landmarks)
        self._reference, self._parents = registration_tree(*shape_distances(meshes, tick))
        source = meshes[self._reference]
        begin = self._landmarks[self._reference]
        if not len(begin):
            begin = np.array([int(np.random.default_rng(seed).integers(len(source.vertices)))])
        self._chosen = spread_vertices(source, count, begin)
        self._registration = run_in_background(
            lambda _: Registration.of(source), part_of(tick, 1.0, 1.0), "first particles"
        )

    @on_one_thread
    def particles(self, poses: FloatArray, tick: Tick = no_tick) -> FloatArray:
        """Return the particles (M, count, 3) on the meshes, or nearly.

        Parameters
        ----------
        poses : (M, 4, 4) array
            Similarities that align the shapes.
        tick : Tick
            Progress and cancellation.
        """
        relative = inverse_matrices(poses[self._reference][None])[0] @ poses  # to the reference's frame
        meshes = posed_meshes(self._meshes, relative)
        source, chosen = meshes[self._reference], self._chosen
        deformed = {self._reference: Deformed(source, 0.0)}
        while len(deformed) < len(meshes):
            ready = [k for k in range(len(meshes)) if k not in deformed and int(self._parents[k]) in deformed]
            done, end = len(deformed) / len(meshes), (len(deformed) + len(ready)) / len(meshes)
            guesses = [self._guess(meshes, deformed, k) for k in ready]
            deformed |= self._deform(meshes, ready, guesses, part_of(tick, done, end))
        del deformed[self._reference]

        def snapped(index: int) -> FloatArray:
            mesh = deformed[index].mesh
            points = snap_to_mesh(
                mesh.vertices[chosen],
                mesh.vertex_normals[chosen],
                meshes[index],
                deformed[index].normal_length,
            )
            own = self._landmarks[index]
            points[: len(own)] = meshes[index].vertices[own]
            return points

        result = np.empty((len(meshes), len(chosen), 3))
        result[self._reference] = source.vertices[chosen]
        for index, points in zip(deformed, in_threads(snapped, deformed, cores()), strict=True):
            result[index] = points
        return transform_points(inverse_matrices(relative), result)

    def _guess(
        self, meshes: Sequence[TriangleMesh], deformed: Mapping[int, Deformed], index: int
    ) -> FloatArray:
        """Return the reference's vertices as the first closest points of a shape are searched from."""
        of_reference, own = self._landmarks[self._reference], self._landmarks[index]
        guess = _guess_of_landmarks(meshes[self._reference], of_reference, meshes[index].vertices[own])
        return deformed[int(self._parents[index])].mesh.vertices if guess is None else guess

    def _deform(
        self,
        meshes: Sequence[TriangleMesh],
        chosen: Sequence[int],
        guesses: Sequence[FloatArray],
        tick: Tick,
    ) -> dict[int, Deformed]:
        """Return the reference deformed onto some of the shapes."""

        def deform(some: slice, inner: Tick) -> list[Deformed]:
            targets = [meshes[index] for index in chosen[some]]
            return self._registration.deform(targets, guesses[some], inner)

        size = N_TOGETHER if len(chosen) < MANY_SHAPES else N_TOGETHER_OF_MANY
        works = [partial(deform, slice(k, k + size)) for k in range(0, len(chosen), size)]
        deformed = chain(*run_in_threads(works, tick, "first particles", cores()))
        return dict(zip(chosen, deformed, strict=True))


def _landmark_vertices(meshes: Sequence[TriangleMesh], landmarks: FloatArray | None) -> list[IntArray]:
    """Return the vertices nearest to each shape's landmarks; none for a landmark that shares its vertex."""
    if landmarks is None:
        return [np.empty(0, dtype=np.int64) for _ in meshes]
    pairs = zip(meshes, landmarks, strict=True)
    vertices = np.array([NearestPoints.of(mesh).nearest(points)[1] for mesh, points in pairs])
    distinct = [
        index
        for index in range(vertices.shape[1])
        if not (vertices[:, :index] == vertices[:, index : index + 1]).any()
    ]
    return list(vertices[:, distinct])


def _guess_of_landmarks(
    source: TriangleMesh, landmark_vertices: IntArray, targets: FloatArray
) -> FloatArray | None:
    """Return the source's vertices, mapped by the thin plate of its landmarks; None if those are too few."""
    points = source.vertices[landmark_vertices]
    if len(landmark_vertices) < MIN_LANDMARKS or np.linalg.matrix_rank(points - points.mean(axis=0)) < 3:
        return None
    maps = ThinPlateMap.fit(points, source.vertices)
    return maps.apply(targets, LAST_SMOOTHING)


def shape_distances(meshes: Sequence[TriangleMesh], tick: Tick = no_tick) -> tuple[IntArray, FloatArray]:
    """Return at most 40 shapes (K,) and their mean distances to all shapes, both ways, shape (K, M).

    Of more than 200 shapes fewer are candidates for the reference, as comparing takes K M.
    """
    count = min(N_CANDIDATES, max(FEWEST_CANDIDATES, MAX_COMPARED // len(meshes)))
    candidates = np.arange(0, len(meshes), max(1, len(meshes) // count))
    vertices = [NearestPoints.of(mesh) for mesh in meshes]
    points = []

    def spread_points(mesh: TriangleMesh) -> FloatArray:
        return mesh.vertices[farthest_point_sampling(mesh.vertices, N_SAMPLES)]

    for index, chosen in enumerate(in_threads(spread_points, meshes, cores())):
        tick(0.5 * index / len(meshes), "most typical shape")
        points.append(chosen)
    chosen_points = [points[k] for k in candidates]

    def means(own: NearestPoints, points: Sequence[FloatArray]) -> FloatArray:
        result: FloatArray = own.nearest(np.concatenate(points))[0].reshape(len(points), -1).mean(axis=1)
        return result

    forward = in_threads(lambda k: means(vertices[k], points), candidates.tolist(), cores())
    back = in_threads(lambda own: means(own, chosen_points), vertices, cores())
    distances = np.zeros((len(candidates), len(meshes)))
    for row, row_distances in enumerate(forward):
        tick(0.5 + 0.25 * row / len(candidates), "most typical shape")
        distances[row] += row_distances
    for column, column_distances in enumerate(back):
        tick(0.75 + 0.25 * column / len(meshes), "most typical shape")
        distances[:, column] += column_distances
    return candidates, distances


def registration_tree(candidates: IntArray, distances: FloatArray) -> tuple[int, IntArray]:
    """Return the reference, and the shape from which each is reached, (M,); itself for the reference.

    The reference is the candidate nearest to all. Each other shape is reached by the path through candidates
    with the least sum of squared steps. Shapes that vary in many independent ways are reached directly,
    because the squared distance of two is then the sum of their squared distances to the reference. If one
    large variation dominates, several steps along it have a smaller sum than one.
    """
    n_shapes = distances.shape[1]
    reference = int(candidates[int(np.argmin(distances.sum(axis=1)))])
    squared = np.zeros((n_shapes, n_shapes))
    squared[candidates] = np.square(distances)
    parents = dijkstra(squared, indices=[reference], return_predecessors=True)[1][0]
    return reference, np.where(parents < 0, reference, parents)


def snap_to_mesh(
    points: FloatArray, normals: FloatArray, mesh: TriangleMesh, normal_length: float = NORMAL_LENGTH
) -> FloatArray:
    """Return points on a mesh close to the given ones, where the normals agree.

    Parameters
    ----------
    points, normals : (n, 3) arrays
        Points near the mesh, and the outward unit normals that are expected there.
    mesh : TriangleMesh
        In the same coordinates.
    normal_length : float
        The distance equivalent to a difference of one between unit normals.

    Returns
    -------
    (n, 3) array
        Points on the mesh.
    """
    snapped, planes, nearest = NearestPoints.of(mesh, normal_length).touched(points, normals, mesh.mean_edge)
    # the wall may be thin and bend
    crosses = np.einsum("nd,nd->n", normals_at(mesh, snapped), planes) < MIN_NORMAL_COSINE
    snapped[crosses] = mesh.vertices[nearest[crosses]]
    return snapped
