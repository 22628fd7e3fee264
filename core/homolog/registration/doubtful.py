"""Registered shapes that fit the others about as well in another orientation.

Points of the most typical shape are carried to the others by bending its surface. Each shape is compared with
the mean and the modes of all others (leave-one-out) in its orientation and in those of other registrations.
What the modes do not explain of its positions and normals tells orientations apart far better than distances
before or after bending: modes do not bend a shape in ways in which no other shape differs.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Self

import numpy as np
from scipy.spatial.transform import Rotation

from homolog.arrays import FloatArray
from homolog.geometry import fit_similarity, inverse_matrices, rotation_of, transform_points
from homolog.progress import Tick, run_in_threads
from homolog.registration.closest_points import SearchedPoints
from homolog.registration.icp import Bending, OrientedPoints, candidates
from homolog.threads import cores

__all__ = ["OtherTurn", "other_turns", "unclear"]

_FEWEST, _COMPARED = 5, 40
"""Fewest shapes that show how they vary; largest number of others with which a shape is compared."""
_ROUNDS, _REACH = 10, 0.08
"""Alternations of closest points and poses; largest distance of a closest point from a vertex, which is about
an edge of the mesh, at size 1."""
_PLAIN_POSITIONS, _PLAIN_NORMALS, _PLAIN_TARGETS = 3e-4, 0.03, 3e-3
"""Variances that need no mode: of positions and normals that are compared, and of the targets of poses."""
_ANOTHER = 30.0
"""Smallest rotation that counts as another orientation [degrees]."""
_CLEAR, _USUALLY_CLEAR = 0.3, 0.6
"""Least margin of a clear orientation. If the median is below the second, shapes of this kind hardly tell
orientations, and some of the others may be turned, too: then margins below the second are not clear. Below
minus the first the other orientation fits better."""


@dataclass(frozen=True, slots=True)
class OtherTurn:
    """A rotation by an angle [degrees] after which a shape fits the others about as well, or better."""

    angle: float
    is_better: bool = False


def other_turns(
    units: Sequence[OrientedPoints],
    rotations: FloatArray,
    order: Sequence[int],
    tested: Sequence[int],
    tick: Tick,
) -> dict[int, OtherTurn]:
    """Return rotations after which shapes fit the others about as well, or better, by index of the shape.

    Parameters
    ----------
    units : sequence of M OrientedPoints
        Shapes of size 1.
    rotations : (M, 3, 3) array
        Rotations that register them to each other.
    order : sequence of int
        Their indices, the most typical first.
    tested : sequence of int
        Indices of the shapes whose orientation may be wrong.
    tick : Tick
        Progress and cancellation.
    """
    if len(units) < _FEWEST or not tested:
        return {}

    def surface(index: int) -> SearchedPoints:  # not kept: memory for thousands
        pose = np.eye(4)
        pose[:3, :3] = rotations[index]
        return SearchedPoints(units[index].placed(pose))

    template = Bending(surface(order[0]))

    def carried(index: int, inner: Tick) -> FloatArray:
        inner(0.0, "aligning")
        target = surface(index)
        return _nearest(target, *template.bent(target, np.eye(4)))

    compared = order[: _COMPARED + 1]
    works = [partial(carried, k) for k in compared]
    points = dict(zip(compared, run_in_threads(works, tick, "aligning", cores()), strict=True))

    def margin(index: int, inner: Tick) -> tuple[float, float]:
        inner(0.0, "aligning")
        others = _Others.of(np.array([points[k] for k in compared if k != index][:_COMPARED]))
        own = points[index] if index in points else carried(index, inner)
        return others.margin(surface(index), own)

    margins = run_in_threads([partial(margin, k) for k in tested], tick, "aligning", cores())
    are_unclear = unclear([item for item, _ in margins])
    return {
        k: OtherTurn(angle, is_better=own_margin < -_CLEAR)
        for k, (own_margin, angle), is_one in zip(tested, margins, are_unclear, strict=True)
        if is_one
    }


def unclear(margins: Sequence[float]) -> list[bool]:
    """Return which orientations are not clear.

    Parameters
    ----------
    margins : sequence of float
        Of each shape: logarithm of what is unexplained in the best other orientation, relative to its own.
    """
    least = _USUALLY_CLEAR if np.median(margins) < _USUALLY_CLEAR else _CLEAR
    return [bool(margin < least) for margin in margins]


@dataclass(frozen=True, slots=True, eq=False)
class _Others:
    """Mean, modes (as unit rows) and variances of corresponding positions and normals, (2, n, 3) a shape."""

    mean: FloatArray
    modes: FloatArray
    variances: FloatArray

    @classmethod
    def of(cls, shapes: FloatArray) -> Self:
        """Return the statistics of shapes (M, 2, n, 3)."""
        mean = shapes.mean(axis=0)
        rows = (shapes - mean).transpose(1, 0, 2, 3).reshape(2, len(shapes), -1)
        _, values, modes = np.linalg.svd(rows, full_matrices=False)
        mean[1] /= np.maximum(np.linalg.norm(mean[1], axis=1, keepdims=True), 1e-9)
        return cls(mean, modes, np.square(values) / ((len(shapes) - 1) * mean.shape[1]))

    def margin(self, surface: SearchedPoints, carried: FloatArray) -> tuple[float, float]:
        """Return how clear the orientation of a shape is, and by what angle the next best differs [degrees].

        Parameters
        ----------
        surface : SearchedPoints
        carried : (2, n, 3) array
            Corresponding points and normals of the shape.
        """
        mean = SearchedPoints(OrientedPoints(self.mean[0], self.mean[1], np.zeros(3)))
        ends = [self._followed(surface, fit.pose) for fit in candidates(surface, mean)]
        values = [(self._unexplained(carried), 0.0), *((value, _angle(pose)) for pose, value in ends)]
        own = min(value for value, angle in values if angle < _ANOTHER)
        other = [(value - own, angle) for value, angle in values if angle >= _ANOTHER]
        return min(other, default=(np.inf, 0.0))

    def _unexplained(self, shape: FloatArray) -> float:
        """Return the logarithm of what the modes leave of a shape's (2, n, 3) positions and normals."""
        rests = [
            self._rest(part, shape[part], plain)
            for part, plain in enumerate((_PLAIN_POSITIONS, _PLAIN_NORMALS))
        ]
        return float(sum(np.log(np.linalg.norm(rest) + 1e-9) for rest in rests))

    def _followed(self, surface: SearchedPoints, pose: FloatArray) -> tuple[FloatArray, float]:
        """Return the pose that closest points and modes reach from a given one, and what is unexplained."""
        targets = self.mean[0]
        for left in reversed(range(_ROUNDS)):
            goals = transform_points(inverse_matrices(pose), targets)
            points, normals = _nearest(surface, goals, self.mean[1] @ rotation_of(pose))
            placed = transform_points(pose, points)
            if left:
                targets = placed - self._rest(0, placed, _PLAIN_TARGETS)
                pose = fit_similarity(points, targets, scaling=True)
        return pose, self._unexplained(np.stack([placed, normals @ rotation_of(pose).T]))

    def _rest(self, part: int, values: FloatArray, plain: float) -> FloatArray:
        """Return deviations (n, 3) from the mean without what the modes explain."""
        row, variances = (values - self.mean[part]).ravel(), self.variances[part]
        along = self.modes[part] @ row
        rest: FloatArray = row - (variances / (variances + plain) * along) @ self.modes[part]
        return rest.reshape(-1, 3)


def _nearest(surface: SearchedPoints, points: FloatArray, normals: FloatArray) -> FloatArray:
    """Return positions and normals (2, n, 3) of a surface, nearest to points whose normals agree."""
    there = surface.nearest(points, normals)[1]
    vertices, planes = surface.points[there], surface.normals[there]
    along = points - vertices
    along -= np.einsum("ni,ni->n", along, planes)[:, None] * planes
    far = np.linalg.norm(along, axis=1, keepdims=True)
    return np.stack([vertices + along * np.minimum(1.0, _REACH / np.maximum(far, 1e-9)), planes])


def _angle(pose: FloatArray) -> float:
    return float(np.degrees(Rotation.from_matrix(rotation_of(pose)).magnitude()))
