"""Surfaces from particles: a thin-plate spline that is one matrix product once its centres are fixed.

The spline is the interpolant with the smallest bending energy in three dimensions, kernel ``r`` and an
affine part (Bookstein 1989; Wahba 1990). It is linear in the target positions, so with fixed centres the
surface of any particle configuration, mode or difference is ``operator @ particles``.
"""

from dataclasses import dataclass

import numpy as np
from scipy import linalg
from scipy.spatial import KDTree
from scipy.spatial.distance import cdist

from homolog.arrays import BoolArray, FloatArray, IntArray, frozen
from homolog.errors import NumericalError
from homolog.progress import Tick, no_tick

__all__ = [
    "MeanSurface", "mean_surface", "medoid", "spread_centres", "thin_plate_moved", "thin_plate_operator",
]  # fmt: skip

MOST_CENTRES = 2048
"""Above this count the spline takes evenly spread particles only: the others add cost, not shape."""

ROUNDS = 12
"""Most times that the spline is made smoother where faces are folded."""

_FIRST_SMOOTHING = 0.1
"""Of a centre near a folded face, in mean distances of neighbouring centres; doubled in each round."""

_NEAR = 3
"""Centres made smoother for each folded face."""

_CHUNK = 4096


@dataclass(frozen=True, slots=True, eq=False)
class MeanSurface:
    """A mesh that follows any particle configuration of its shape model. Arrays are read-only.

    Attributes
    ----------
    vertices : (V, 3) array
        The mean surface [mm].
    faces : (F, 3) int array
        Those of the template mesh.
    operator : (V, n) array
        Thin-plate weights: see `moved`.
    centres : (n,) int array
        Indices of the particles that carry the spline; all of them unless there are very many.
    smoothing : (n,) array
        Smoothing of the spline at each centre [mm]: 0, where it interpolates, but near faces that would
        have come out folded.
    folded : int
        Faces that are folded even so: 0 unless correspondences cross each other.
    """

    vertices: FloatArray
    faces: IntArray
    operator: FloatArray
    centres: IntArray
    smoothing: FloatArray
    folded: int

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in ("vertices", "faces", "operator", "centres", "smoothing"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    def moved(self, particles: FloatArray) -> FloatArray:
        """Return what the vertices are, for what the particles are: (..., N, 3) to (..., V, 3).

        Positions give positions; displacements (a mode, a group difference) give displacements.
        """
        result: FloatArray = self.operator @ particles[..., self.centres, :]
        return result


def mean_surface(
    mean: FloatArray,
    particles: FloatArray,
    vertices: FloatArray,
    faces: IntArray,
    *,
    tick: Tick = no_tick,
) -> MeanSurface:
    """Warp one subject's mesh to the mean shape, without folds, and prepare it for any other shape.

    Parameters
    ----------
    mean : (N, 3) array
        Mean particles [mm].
    particles : (N, 3) array
        The subject's particles [mm], best those of the `medoid`.
    vertices : (V, 3) array
        The subject's mesh in the same frame as its particles [mm].
    faces : (F, 3) int array
        Its faces, counter-clockwise seen from outside.
    tick : Tick
    """
    centres = spread_centres(mean, MOST_CENTRES)
    start, tree = particles[centres], KDTree(particles[centres])
    first = _FIRST_SMOOTHING * _mean_spacing(start)
    smoothing = np.zeros(len(centres))
    for attempt in range(ROUNDS):
        tick(attempt / (ROUNDS + 1), "mean surface")
        weights = _solve(start, mean[centres], smoothing)
        warped = _evaluate(start, vertices, weights)
        folded = _folded(start, vertices, warped, faces, weights)
        if not folded.any():
            break
        middles = vertices[faces[folded]].mean(axis=1)
        _, near = tree.query(middles, k=range(1, min(_NEAR, len(centres)) + 1))
        touched = np.unique(near)
        smoothing[touched] = np.maximum(2.0 * smoothing[touched], first)
    tick(ROUNDS / (ROUNDS + 1), "mean surface")
    operator = thin_plate_operator(mean[centres], warped, smoothing=smoothing)
    return MeanSurface(warped, faces, operator, centres, smoothing, int(folded.sum()))


def thin_plate_operator(
    centres: FloatArray, points: FloatArray, *, smoothing: float | FloatArray = 0.0
) -> FloatArray:
    """Return the matrix that takes target positions of the centres to those of the points.

    Parameters
    ----------
    centres : (N, 3) array
        Where the particles are before the warp [mm]; not all in one plane.
    points : (V, 3) array
        Where the vertices are before the warp [mm].
    smoothing : float or (N,) array
        Of each centre [mm]: 0 interpolates, larger values trade fidelity for smoothness.

    Returns
    -------
    (V, N) array
        ``operator @ targets`` are the warped points; it has the affine part in it, so an affine motion of
        the particles moves the points by exactly that.

    Raises
    ------
    NumericalError
        If two centres coincide or all lie in one plane.
    """
    weights = _solve(centres, np.eye(len(centres)), smoothing)
    return _evaluate(centres, points, weights)


def thin_plate_moved(centres: FloatArray, points: FloatArray, displacements: FloatArray) -> FloatArray:
    """Return how points move with the centres, for a few displacements, without the whole operator.

    Parameters
    ----------
    centres : (N, 3) array
        The particles before they move [mm]; not all in one plane.
    points : (V, 3) array
        The vertices before they move [mm].
    displacements : (K, N, 3) array
        K displacements of the centres, such as modes [mm].

    Returns
    -------
    (K, V, 3) array
        What `thin_plate_operator` gives for each of them.

    Raises
    ------
    NumericalError
        If two centres coincide or all lie in one plane.
    """
    columns = displacements.transpose(1, 0, 2).reshape(len(centres), -1)
    moved = _evaluate(centres, points, _solve(centres, columns, 0.0))
    return moved.reshape(len(points), -1, 3).transpose(1, 0, 2)


def medoid(particles: FloatArray, mean: FloatArray) -> int:
    """Return the index of the subject whose particles are nearest to the mean, in the least-squares sense."""
    return int(np.square(particles - mean).sum(axis=(1, 2)).argmin())


def spread_centres(points: FloatArray, most: int) -> IntArray:
    """Return the indices of at most so many points, each as far from those before it as can be."""
    if len(points) <= most:
        return np.arange(len(points))
    chosen = np.zeros(most, dtype=np.int64)
    gap = np.full(len(points), np.inf)
    for position in range(1, most):
        newest = points[chosen[position - 1]]
        gap = np.minimum(gap, np.square(points - newest).sum(axis=1))
        chosen[position] = gap.argmax()
    return np.sort(chosen)


def _solve(centres: FloatArray, targets: FloatArray, smoothing: float | FloatArray) -> FloatArray:
    """Weights of the kernel (N rows) and of the affine part (4 rows) for each column of the targets."""
    count = len(centres)
    system = np.zeros((count + 4, count + 4))
    # The kernel r is conditionally negative definite, so smoothing makes the diagonal smaller.
    system[:count, :count] = cdist(centres, centres) - np.diag(np.broadcast_to(smoothing, count))
    system[:count, count] = system[count, :count] = 1.0
    middle = centres.mean(axis=0)
    system[:count, count + 1 :] = centres - middle
    system[count + 1 :, :count] = (centres - middle).T
    right = np.vstack([targets, np.zeros((4, targets.shape[1]))])
    try:
        weights: FloatArray = linalg.solve(system, right, assume_a="general")
    except (linalg.LinAlgError, linalg.LinAlgWarning) as error:
        raise NumericalError("thin-plate warp: particles coincide or lie in one plane") from error
    return weights


def _evaluate(centres: FloatArray, points: FloatArray, weights: FloatArray) -> FloatArray:
    middle = centres.mean(axis=0)
    parts = []
    for start in range(0, len(points), _CHUNK):
        some = points[start : start + _CHUNK]
        basis = np.hstack([cdist(some, centres), np.ones((len(some), 1)), some - middle])
        parts.append(basis @ weights)
    return np.concatenate(parts)


def _folded(
    centres: FloatArray, vertices: FloatArray, warped: FloatArray, faces: IntArray, weights: FloatArray
) -> BoolArray:
    """Whether each face is turned inside out: its outward side has come to lie inside."""
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    middles = corners.mean(axis=1)
    step = 1e-3 * np.sqrt(lengths.mean())
    outward = _evaluate(centres, middles + step * normals / lengths, weights)
    outward -= _evaluate(centres, middles, weights)
    corners = warped[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    folded: BoolArray = np.einsum("fi,fi->f", outward, normals) <= 0.0
    return folded


def _mean_spacing(points: FloatArray) -> float:
    """Mean distance of each point to its nearest other [mm]."""
    distances, _ = KDTree(points).query(points, k=[2])
    return float(np.mean(distances))
