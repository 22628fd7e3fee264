"""Search for the pose of one shape against an ensemble, with particles that slide over its surface.

The pose of a shape that is nearly symmetric about an axis is hardly determined by its surface, and particles
hold it: a turn with all particles fixed is costly, and so is moving all particles under a fixed pose. Here
the surface is turned beneath particles that stay where the ensemble expects them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from homolog.arrays import FloatArray
from homolog.geometry import inverse_matrices, transform_points
from homolog.threads import cores, in_threads

__all__ = ["follow_pose", "search_poses"]

_TURNS = np.radians(np.arange(-24.0, 25.0, 4.0))
"""Rotations about the axis of least resistance that are tried."""
_BEGUN = 2
"""Number of minima among these rotations from which the search continues."""
_STEPS = 6
_DIFFERENCE = 0.002
"""Step of the numerical derivatives by pose, as a fraction of the size."""
_DAMPING, _SMALLEST_STEP, _ENOUGH = 1e-6, 0.2, 1e-3
"""Gauss-Newton steps: damping relative to the mean diagonal of the matrix, smallest fraction of a step, and
relative decrease of the objective below which the search ends."""
_DISTINCT = 0.5
"""Smallest distance of two different poses, root mean square over the particles [spacings]."""


class Ensemble(Protocol):
    """What is expected of n corresponding points, and deviations from it (`correspondence.ensemble`)."""

    @property
    def mean(self) -> FloatArray:
        """Expected positions (n, 3)."""

    @property
    def normals(self) -> FloatArray:
        """Expected unit normals (n, 3)."""

    @property
    def scale(self) -> float:
        """Divisor of the squared deviations."""

    def deviation(self, aligned: FloatArray, /) -> FloatArray:
        """Return the deviation (3n,) of positions (n, 3)."""

    def logs(self, normals: FloatArray, openings: FloatArray, /) -> FloatArray:
        """Return the deviation of normals (n, 3), weighted by opening angles (n,)."""

    def rest_of_positions(self, row: FloatArray, regularization: float, /) -> FloatArray:
        """Return what the modes leave of a deviation of positions."""

    def rest_of_normals(self, row: FloatArray, regularization: float, /) -> FloatArray:
        """Return what the modes leave of a deviation of normals."""


class Term(Protocol):
    """Weight and regularization of one of the two entropies."""

    @property
    def weight(self) -> float:
        """Factor of the entropy in the objective."""

    @property
    def regularization(self) -> float:
        """Variance added to the covariance."""


class Surface(Protocol):
    """The surface of one shape."""

    @property
    def area(self) -> float:
        """Its area before it is posed."""

    def nearest(
        self, pose: FloatArray, targets: FloatArray, normals: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return points (n, 3) of the posed surface nearest to targets, their normals and opening angles."""


def search_poses(
    ensemble: Ensemble,
    terms: tuple[Term, Term],
    surface: Surface,
    poses: Sequence[FloatArray],
    *,
    scaling: bool,
) -> list[tuple[FloatArray, FloatArray]]:
    """Return the poses of low objective, and particles on the surface in each, the lowest first.

    Parameters
    ----------
    ensemble : Ensemble
    terms : pair of Term
        Of H(Z) and H(V).
    surface : Surface
    poses : sequence of (4, 4) arrays
        Where the search begins.
    scaling : bool
        Whether the pose has a scale.

    Returns
    -------
    list of ((4, 4) array, (n, 3) array)
        Pose, and particles as posed. Particles of two poses are at least half a spacing apart on the surface.
    """
    search = _Search(ensemble, terms, surface, scaling)
    minima = in_threads(search.minima, poses, min(len(poses), cores()))
    ends = sorted((end for ends in minima for end in ends), key=lambda item: item[0])
    kept: list[tuple[FloatArray, FloatArray]] = []
    places: list[FloatArray] = []
    least = _DISTINCT * np.sqrt(surface.area / len(ensemble.mean))
    for _, pose, targets in ends:
        points = surface.nearest(pose, targets, ensemble.normals)[0]
        place = transform_points(inverse_matrices(pose), points)
        apart = [float(np.sqrt(np.square(place - other).sum(axis=1).mean())) for other in places]
        if all(gap >= least for gap in apart):
            kept.append((pose, points))
            places.append(place)
    return kept


def follow_pose(
    ensemble: Ensemble,
    terms: tuple[Term, Term],
    surface: Surface,
    pose: FloatArray,
    points: FloatArray,
    *,
    scaling: bool,
) -> tuple[FloatArray, FloatArray]:
    """Return the pose that the search reaches from placed particles, and where it puts them.

    Particles creep along a surface, since they hold each other, and the pose creeps with them. Here they are
    moved at once to the surface points nearest to their projection onto the modes.

    Parameters
    ----------
    ensemble, terms, surface, scaling
        As in `search_poses`.
    pose : (4, 4) array
        Where the search begins.
    points : (n, 3) array
        Particles as posed.

    Returns
    -------
    pose : (4, 4) array
    points : (n, 3) array
        As posed.
    """
    search = _Search(ensemble, terms, surface, scaling)
    _, pose, targets = search.descend(pose, search.projected(points))
    return pose, surface.nearest(pose, targets, ensemble.normals)[0]


_Candidate = tuple[float, FloatArray, FloatArray]


@dataclass(frozen=True, slots=True)
class _Search:
    ensemble: Ensemble
    terms: tuple[Term, Term]
    surface: Surface
    scaling: bool

    def minima(self, pose: FloatArray) -> list[_Candidate]:
        """Return objective, pose and targets of minima about a pose."""
        targets = self._expected(pose, self.ensemble.mean)
        centre = targets.mean(axis=0)
        value, pose, targets = self.descend(pose, targets)
        axis = self._softest(pose, targets)
        turned = [_moved(pose, axis * angle, centre) for angle in _TURNS]
        # With the first pose's targets and with their own: either may hold a turned pose back.
        own = [self._expected(item, self.ensemble.mean) for item in turned]
        begun = [
            (turned[k], goals[k])
            for goals in ([targets] * len(turned), own)
            for k in self._lowest_minima(turned, goals)
        ]
        return [(value, pose, targets), *(self.descend(*item) for item in begun)]

    def _lowest_minima(self, turned: Sequence[FloatArray], goals: Sequence[FloatArray]) -> list[int]:
        """Return the numbers of the lowest minima along turned poses, each with its targets."""
        values = [self._value(*both) for both in zip(turned, goals, strict=True)]
        inner = [np.inf, *values, np.inf]
        minima = [k for k in range(len(values)) if inner[k + 1] <= min(inner[k], inner[k + 2])]
        return sorted(minima, key=lambda k: values[k])[:_BEGUN]

    def _expected(self, pose: FloatArray, targets: FloatArray) -> FloatArray:
        """Return the projection onto the modes of the points nearest to the targets."""
        return self.projected(self.surface.nearest(pose, targets, self.ensemble.normals)[0])

    def projected(self, points: FloatArray) -> FloatArray:
        """Return the projection of points onto the modes."""
        row = self.ensemble.deviation(points)
        rest = self.ensemble.rest_of_positions(row, self.terms[0].regularization)
        return self.ensemble.mean + (row - rest).reshape(-1, 3)

    def _deviation(self, pose: FloatArray, targets: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return deviations (3n,) of positions and normals at the points nearest to targets."""
        points, normals, openings = self.surface.nearest(pose, targets, self.ensemble.normals)
        return self.ensemble.deviation(points), self.ensemble.logs(normals, openings).ravel()

    def _value(self, pose: FloatArray, targets: FloatArray) -> float:
        """Return the shape's contribution to the weighted entropies H(Z) and H(V), up to a factor."""
        rows = self._deviation(pose, targets)
        values = zip(self.terms, rows, self._rests(rows), strict=True)
        return float(sum(t.weight * np.log1p(row @ rest / self.ensemble.scale) for t, row, rest in values))

    def descend(self, pose: FloatArray, targets: FloatArray) -> _Candidate:
        """Return the minimum that Gauss-Newton steps reach from a pose."""
        value = self._value(pose, targets)
        for _ in range(_STEPS):
            following = self._expected(pose, targets)
            lower = self._value(pose, following)
            if lower < value:
                value, targets = lower, following
            matrix, slope = self._normal_equations(pose, targets)
            change = np.linalg.solve(
                matrix + _DAMPING * np.trace(matrix) / len(matrix) * np.eye(len(matrix)), -slope
            )
            step = 1.0
            while step > _SMALLEST_STEP:
                moved = _moved(pose, step * change, targets.mean(axis=0))
                lower = self._value(moved, targets)
                if lower < value:
                    break
                step *= 0.5
            else:
                break
            gained, value, pose = value - lower, lower, moved
            if gained < _ENOUGH * value:
                break
        return value, pose, targets

    def _softest(self, pose: FloatArray, targets: FloatArray) -> FloatArray:
        """Return the axis of the turn that changes the objective least, translations being free, (3,)."""
        matrix, _ = self._normal_equations(pose, targets)
        turn, rest = matrix[:3, :3], matrix[3:, 3:]
        free = turn - matrix[:3, 3:] @ np.linalg.solve(rest, matrix[3:, :3])
        axis: FloatArray = np.linalg.eigh(free)[1][:, 0]
        return axis

    def _normal_equations(self, pose: FloatArray, targets: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the Gauss-Newton matrix and the slope of the objective by turn, shift and growth."""
        centre = targets.mean(axis=0)
        size = float(np.sqrt(np.square(targets - centre).sum(axis=1).mean()))
        epsilon = np.array([_DIFFERENCE] * 3 + [_DIFFERENCE * size] * 3 + [_DIFFERENCE] * self.scaling)
        rows = self._deviation(pose, targets)
        columns: list[list[FloatArray]] = [[], []]
        for index, length in enumerate(epsilon):
            change = np.zeros(len(epsilon))
            change[index] = length
            for part, row, moved in zip(
                columns, rows, self._deviation(_moved(pose, change, centre), targets), strict=True
            ):
                part.append((moved - row) / length)
        matrix, slope = np.zeros((len(epsilon),) * 2), np.zeros(len(epsilon))
        stiff = [self._rests(both) for both in zip(*columns, strict=True)]
        for number, (term, row, rest) in enumerate(zip(self.terms, rows, self._rests(rows), strict=True)):
            factor = 2.0 * term.weight / (self.ensemble.scale + row @ rest)
            along = np.stack(columns[number])
            matrix += factor * (along @ np.stack([both[number] for both in stiff]).T)
            slope += factor * (along @ rest)
        return matrix, slope

    def _rests(self, rows: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
        """Return (S + aI)^-1 y of positions, and the same of normals."""
        a, b = (term.regularization for term in self.terms)
        return (
            self.ensemble.rest_of_positions(rows[0], a) / a,
            self.ensemble.rest_of_normals(rows[1], b) / b,
        )


def _moved(pose: FloatArray, change: FloatArray, centre: FloatArray) -> FloatArray:
    """Return a pose turned about a centre, and shifted and scaled if the change (3 to 7,) says so."""
    step = np.eye(4)
    step[:3, :3] = Rotation.from_rotvec(change[:3]).as_matrix()
    if len(change) > 6:
        step[:3, :3] *= np.exp(change[6])
    step[:3, 3] = centre - step[:3, :3] @ centre
    if len(change) > 3:
        step[:3, 3] += change[3:6]
    result: FloatArray = step @ pose
    return result
