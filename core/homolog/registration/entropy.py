"""Poses that lower the entropy of the ensemble.

Steps are taken by numpy or, several times as fast, by a kernel on the host, where a GPU computes the rest
and waits for them meanwhile; last digits differ.
"""

import numpy as np
import warp as wp

from homolog.arrays import BoolArray, Float32Array, FloatArray, IntArray
from homolog.geometry import scale_of, transform_points
from homolog.registration.kernels.poses import align_shapes
from homolog.registration.procrustes import OUTLIER_RATIO, blocks, even_steps, rescale

__all__ = ["covariance", "entropy_step", "inverse_dual"]

N_SWEEPS = 3  # over the shapes
# Many shapes: one sweep, which the next step continues, one product for a block, and some moved together.
MANY_SHAPES, BLOCK, TOGETHER = 128, 32, 8


def covariance(rows: Float32Array | FloatArray) -> FloatArray:
    """Return C = rows rows' / (N (M - 1)) in float64 for rows (M, 3N)."""
    shapes, numbers = rows.shape
    wide = rows.astype(np.float64)
    result: FloatArray = wide @ wide.T / (numbers / 3 * max(shapes - 1, 1))
    return result


def inverse_dual(matrix: FloatArray, regularization: float) -> FloatArray:
    """Return (C + aI)^-1 without the translation of all shapes, which the covariance does not contain."""
    shapes = len(matrix)
    inverse = np.linalg.inv(matrix + regularization * np.eye(shapes))
    result: FloatArray = (inverse - 1.0 / (regularization * shapes)).astype(np.float64)
    return result


def entropy_step(
    points: FloatArray,
    poses: FloatArray,
    free: BoolArray,
    *,
    scaling: bool,
    regularization: float,
    compiled: bool = False,
) -> FloatArray:
    """Return poses with a lower ensemble entropy H(Z): Newton's method, one shape after another.

    For a large regularization these are rounds of generalized Procrustes analysis, which minimizes the trace
    of the covariance; for a small one poses depend on what few modes do not explain, so that a part that
    varies independently does not rotate the rest. Particles much farther away than the shape's others have
    little weight, as in `procrustes_step`.

    Parameters
    ----------
    points : (M, n, 3) array
        Particles of each shape, as posed.
    poses : (M, 4, 4) array
        The similarities that posed them.
    free : (M,) bool array
        Shapes whose pose may change.
    scaling : bool
        Whether sizes are taken out too; the geometric mean of the scales then stays, if all are free.
    regularization : float
        The a of H(Z), a squared length.
    compiled : bool
        Whether steps are computed by a kernel, several times as fast; last digits differ.

    Returns
    -------
    (M, 4, 4) float64 array
    """
    points, result = points.copy(), poses.copy()
    shapes = len(points)
    flat = points.reshape(shapes, -1)
    many = shapes >= MANY_SHAPES
    together, size = (TOGETHER, BLOCK) if many else (1, 1)
    steps_of = (
        _CompiledSteps(
            points,
            np.flatnonzero(free),
            block=size,
            together=together,
            outlier_ratio=OUTLIER_RATIO,
            scaling=scaling,
        )
        if compiled
        else None
    )
    for _ in range(1 if many else N_SWEEPS):
        weights = inverse_dual(covariance(flat - flat.mean(axis=0)), regularization)
        for number, block in enumerate(blocks(free, size)):
            if steps_of is None:
                pulls = weights[block] @ flat
            else:
                pulls = np.matmul(weights[block], flat, out=steps_of.pulls[: len(block)])
            for begin in range(0, len(block), together):
                chosen, later = block[begin : begin + together], block[begin + together :]
                if steps_of is not None:
                    first = number * size + begin
                    steps, change = steps_of.move(first, begin, len(chosen), weights[chosen, chosen])
                else:
                    before = points[chosen]
                    pull = pulls[begin : begin + together] / weights[chosen, chosen, None]
                    steps = even_steps(before, -pull.reshape(before.shape), scaling)
                    points[chosen] = moved = transform_points(steps, before)
                    change = (moved - before).reshape(len(chosen), -1)
                result[chosen] = steps @ result[chosen]
                pulls[begin + together :] += weights[np.ix_(later, chosen)] @ change
    if scaling and free.all():
        centre = points.mean(axis=(0, 1))
        scales = scale_of(result)
        result = rescale(
            result, scales * np.exp(np.log(scale_of(poses) / scales).mean()), np.tile(centre, (shapes, 1))
        )
    return result


class _CompiledSteps:
    """Moves shapes by robust steps.

    Parameters
    ----------
    points : (M, n, 3) array
        Contiguous; moved in place.
    rows : (R,) int array
        Indices of the shapes that may move.
    block : int
        Number of shapes whose pulls are stored at once.
    together : int
        Number of shapes that are moved at once.
    outlier_ratio : float
        Parameter of the robust weights (see `homolog.registration.procrustes`).
    scaling : bool
        Whether shapes may grow.
    """

    def __init__(
        self,
        points: FloatArray,
        rows: IntArray,
        *,
        block: int,
        together: int,
        outlier_ratio: float,
        scaling: bool,
    ) -> None:
        count = points.shape[1]
        self._options = [outlier_ratio, int(scaling)]
        self.pulls, self._factors = np.zeros((block, 3 * count)), np.zeros(block)
        self._changes, self._steps = np.zeros((together, 3 * count)), np.zeros((together, 4, 4))
        space = np.zeros((together, count))
        self._rows = wp.array(rows, dtype=wp.int32, device="cpu")
        self._given = [
            _shared(self.pulls.reshape(block, count, 3), wp.vec3d),
            _shared(self._factors, wp.float64),
        ]
        self._made = [
            _shared(points, wp.vec3d),
            _shared(self._changes.reshape(together, count, 3), wp.vec3d),
            _shared(space, wp.float64),
            _shared(self._steps, wp.mat44d),
        ]

    def move(
        self, begin: int, place: int, number: int, stiffness: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Move some successive shapes; return their similarities (k, 4, 4) and changes (k, 3n).

        Parameters
        ----------
        begin : int
            Index of the first shape among the rows.
        place : int
            Index of its pull.
        number : int
            Number of shapes, k.
        stiffness : (k,) array
            Divisors of the pulls, which point away from where the shapes should go.
        """
        self._factors[place : place + number] = -1.0 / stiffness
        inputs = [self._rows, begin, place, *self._given, *self._options, *self._made]
        wp.launch(align_shapes, number, inputs=inputs, device="cpu")
        return self._steps[:number], self._changes[:number]


def _shared(array: FloatArray, dtype: type) -> wp.array:
    return wp.array(array, dtype=dtype, device="cpu", copy=False)
