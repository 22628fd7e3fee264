"""Which way round shapes lie: one orientation for each, chosen for all of them together.

Each shape has some orientations in which it fits the most typical shape about as well. Points of that shape
are carried to all others, in each of their orientations, by bending its surface. Chosen are the orientations
in which mean and modes of the others (leave-one-out) explain each shape best, in positions and normals. This
tells orientations apart far better than distances between surfaces do: a shape that differs much from the
typical one may fit it more closely the wrong way round, but modes do not bend it in ways in which no other
shape differs.

How the files lie decides only where shapes do not tell.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from homolog.arrays import FloatArray
from homolog.geometry import fit_similarity, rotation_of, transform_points
from homolog.progress import Tick, run_in_threads
from homolog.registration.closest_points import Fit, OrientedPoints, SearchedPoints
from homolog.registration.icp import Bending
from homolog.registration.typicality import angles_from, typical_rotation
from homolog.surfaces.orientation import FILES_SPREAD, INDEPENDENT, TURNED_FILES
from homolog.threads import cores

__all__ = ["Choice", "Files", "choose"]

_MEDIAN_ANGLE = 1.538
"""Median length of a vector of three standard normal numbers (chi distribution)."""
_CLEAR = float(np.log(2.0))
"""Least difference of that sum to another orientation if shapes tell."""
_COMPARED = 40
"""Most shapes that show how shapes vary."""
_FARTHEST = 2.0
"""Orientations are not tried whose distance exceeds this factor times the closest one."""
_SWEEPS = 20
_REACH = 0.08
"""Largest distance of a closest point from a vertex, which is about an edge of the mesh, at size 1."""
_PLAIN = (3e-4, 0.03)
"""Variances of positions (at size 1) and of normals that need no mode."""


@dataclass(frozen=True, slots=True, eq=False)
class Choice:
    """The orientation of a shape.

    Attributes
    ----------
    fit : Fit
        Its registration to the most typical shape.
    is_clear : bool
        Whether at least twice as much is unexplained in any other orientation.
    other : float
        Angle to the next best orientation [degrees], 0 if there is none.
    """

    fit: Fit
    is_clear: bool
    other: float


@dataclass(frozen=True, slots=True, eq=False)
class _Candidates:
    """Registrations of a shape in K orientations, that of its file first, and carried points (K, 2, n, 3)."""

    fits: Sequence[Fit]
    rows: FloatArray

    def chosen(self, unexplained: FloatArray, files: "Files") -> int:
        """Return the number of the best one, judged by the shape and by how the other files lie."""
        return int(np.argmin(unexplained + files.costs(self.fits)))

    def choice(self, number: int, unexplained: FloatArray) -> Choice:
        """Return the orientation of a number; see `Choice`."""
        others = unexplained - unexplained[number]
        others[number] = np.inf
        nearest = int(np.argmin(others))
        apart = rotation_of(self.fits[nearest].pose) @ rotation_of(self.fits[number].pose).T
        angle = float(np.degrees(Rotation.from_matrix(apart).magnitude()))
        return Choice(self.fits[number], bool(others[nearest] >= _CLEAR), angle)


@dataclass(frozen=True, slots=True, eq=False)
class Files:
    """How the files lie against each other: a common rotation, and their spread about each axis [rad]."""

    common: Rotation
    spread: float

    @classmethod
    def of(cls, fits: Sequence[Fit]) -> "Files":
        """Return what the chosen registrations show, one of each shape."""
        poses = np.array([fit.pose for fit in fits])
        common = typical_rotation(poses)
        median = float(np.median(np.radians(angles_from(poses, common))))
        return cls(common, max(median / _MEDIAN_ANGLE, FILES_SPREAD))

    def costs(self, fits: Sequence[Fit]) -> FloatArray:
        """Return what speaks against orientations of a file, (K,).

        It is a sum of two logarithms, of what is unexplained in positions and normals: minus the logarithm of
        the prior density of the rotation, with the likelihood of independent deviations. Most files are
        distributed normally about the common rotation, some lie in any way.
        """
        angles = np.radians(angles_from(np.array([fit.pose for fit in fits]), self.common))
        volumes = np.square(np.sinc(0.5 * angles / np.pi))  # of rotations, by that of rotation vectors
        near = np.exp(-0.5 * np.square(angles / self.spread)) / ((2.0 * np.pi) ** 1.5 * self.spread**3)
        near /= volumes
        density = (1.0 - TURNED_FILES) * near + TURNED_FILES / (8.0 * np.pi**2)
        costs: FloatArray = -np.log(density) / (0.5 * INDEPENDENT)
        return costs


def choose(
    units: Sequence[OrientedPoints], order: Sequence[int], fits: Sequence[Sequence[Fit]], tick: Tick
) -> list[Choice]:
    """Return the orientation of each shape.

    Parameters
    ----------
    units : sequence of M OrientedPoints
        Shapes of size 1.
    order : sequence of int
        Their indices, the most typical first.
    fits : sequence of M sequences of Fit
        Registrations of each shape to the most typical one in different orientations, that of the file first
        (`candidates`).
    tick : Tick
        Progress and cancellation.
    """
    template = Bending(SearchedPoints(units[order[0]]))
    usual = float(np.median([min(fit.distance for fit in item) for item in fits]))

    def made(index: int, inner: Tick) -> _Candidates:
        given, *others = fits[index]
        limit = _FARTHEST * max(usual, min(fit.distance for fit in fits[index]))
        near = [given, *(fit for fit in others if fit.distance <= limit)]
        return _Candidates(near, np.array(list(_carried(template, units[index], near, inner))))

    compared = order[:_COMPARED]
    works = [partial(made, k) for k in compared]
    among = run_in_threads(works, tick, "aligning", cores())
    closest = tuple(int(np.argmin([fit.distance for fit in item.fits])) for item in among)
    ends = [_descended(among, start) for start in sorted({closest, (0,) * len(among)})]
    numbers = min(ends, key=lambda end: _total(among, end))
    files = Files.of(_chosen(among, numbers))
    everyone = _Others.of(among, numbers)

    def judged(index: int, inner: Tick) -> Choice:
        own = made(index, inner)
        unexplained = everyone.unexplained(own.rows)
        return own.choice(own.chosen(unexplained, files), unexplained)

    result = {
        k: item.choice(number, _Others.of(among, numbers, without=place).unexplained(item.rows))
        for place, (k, item, number) in enumerate(zip(compared, among, numbers, strict=True))
    }
    rest = order[_COMPARED:]
    works_of_rest = [partial(judged, k) for k in rest]
    result |= dict(zip(rest, run_in_threads(works_of_rest, tick, "aligning", cores()), strict=True))
    back = np.linalg.inv(result[order[0]].fit.pose)  # the most typical shape gives the directions
    return [
        replace(item, fit=replace(item.fit, pose=back @ item.fit.pose)) for _, item in sorted(result.items())
    ]


def _carried(
    template: Bending, unit: OrientedPoints, fits: Sequence[Fit], tick: Tick
) -> Iterator[FloatArray]:
    """Yield positions and normals (2, n, 3) of a shape that correspond to a template, in each orientation."""
    for fit in fits:
        tick(0.0, "aligning")
        surface = SearchedPoints(unit.placed(fit.pose))
        points, normals = template.bent(surface, np.eye(4))
        yield np.stack(surface.touched(points, normals, _REACH)[:2])


def _descended(among: Sequence[_Candidates], start: Sequence[int]) -> list[int]:
    """Return the numbers of orientations that can't be improved by changing that of one shape."""
    numbers = list(start)
    for _ in range(_SWEEPS):
        before, files = list(numbers), Files.of(_chosen(among, numbers))
        for place, item in enumerate(among):
            others = _Others.of(among, numbers, without=place)
            numbers[place] = item.chosen(others.unexplained(item.rows), files)
        if numbers == before:
            break
    return numbers


def _total(among: Sequence[_Candidates], numbers: Sequence[int]) -> float:
    """Return what is unexplained in all shapes, with what speaks against the orientations of their files."""
    files = Files.of(_chosen(among, numbers))
    return float(
        sum(
            _Others.of(among, numbers, without=place).unexplained(item.rows[[number]])[0]
            + files.costs(item.fits)[number]
            for place, (item, number) in enumerate(zip(among, numbers, strict=True))
        )
    )


def _chosen(among: Sequence[_Candidates], numbers: Sequence[int]) -> list[Fit]:
    return [item.fits[number] for item, number in zip(among, numbers, strict=True)]


@dataclass(frozen=True, slots=True, eq=False)
class _Others:
    """Mean (2, n, 3) of corresponding positions and normals, and the deviations of k shapes, (2, k, 3n)."""

    mean: FloatArray
    deviations: FloatArray

    @classmethod
    def of(
        cls, among: Sequence[_Candidates], numbers: Sequence[int], without: int | None = None
    ) -> "_Others":
        """Return the statistics of shapes in the chosen orientations, or of all but one."""
        shapes = np.array(
            [
                item.rows[number]
                for place, (item, number) in enumerate(zip(among, numbers, strict=True))
                if place != without or len(among) == 1
            ]
        )
        mean = shapes.mean(axis=0)
        deviations = (shapes - mean).transpose(1, 0, 2, 3).reshape(2, len(shapes), -1)
        mean[1] /= np.maximum(np.linalg.norm(mean[1], axis=1, keepdims=True), 1e-9)
        return cls(mean, deviations)

    def unexplained(self, rows: FloatArray) -> FloatArray:
        """Return the logarithm of what the modes leave of K shapes (K, 2, n, 3), each aligned to the mean."""
        parts = [
            (mean, deviations, np.linalg.inv(deviations @ deviations.T + self._noise(plain)))
            for mean, deviations, plain in zip(self.mean, self.deviations, _PLAIN, strict=True)
        ]
        values = np.zeros(len(rows))
        for number, (points, normals) in enumerate(rows):
            pose = fit_similarity(points, self.mean[0], scaling=True)
            aligned = transform_points(pose, points), normals @ rotation_of(pose).T
            for own, (mean, deviations, inverse) in zip(aligned, parts, strict=True):
                row = (own - mean).ravel()
                rest = row - inverse @ (deviations @ row) @ deviations
                values[number] += np.log(np.linalg.norm(rest) + 1e-9)
        return values

    def _noise(self, variance: float) -> FloatArray:
        """Return what a variance of all coordinates adds to the products of deviations, (k, k)."""
        count = self.deviations.shape[1]
        noise: FloatArray = variance * max(count - 1, 1) * self.mean.shape[1] * np.eye(count)
        return noise
