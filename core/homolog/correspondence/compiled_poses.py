"""Steps of poses by a compiled kernel on the host, for runs on a GPU, which waits for them meanwhile.

Results differ from those of numpy in the last digits.
"""

import numpy as np
import warp as wp

from homolog.arrays import FloatArray, IntArray
from homolog.correspondence.kernels.poses import align_shapes

__all__ = ["CompiledSteps"]


class CompiledSteps:
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
        Parameter of the robust weights (see `homolog.correspondence.poses`).
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
