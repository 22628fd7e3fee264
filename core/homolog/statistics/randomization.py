"""Randomization of residuals: the null distribution of all tests of means, slopes and covariances.

A test fits the reduced model, which lacks what is tested, and flips the signs of its residuals, those of one
independent unit (a subject, with all its rows) together. Each unit thus keeps its own covariance, whatever
its amount and pattern, and its own dependence within. The tested coefficients are studentized by the
covariance that the units themselves show (HC2 of MacKinnon and White 1985; for units of several rows CR2 of
Bell and McCaffrey 2002), anew for each flip. This is the wild bootstrap with the null hypothesis imposed (Wu
1986, Davidson and Flachaire 2008), for units of several rows that of clusters (Cameron, Gelbach and Miller
2008). For differences of pairs it is the exact test of signs. The reduced model is fitted with weights where
dispersions change along the design, so that few dispersed subjects don't determine the common mean.

Permuting subjects instead gives all of them one covariance: it is exact if covariances are equal, but finds
effects where only dispersions differ. It is used where signs are too few: up to twelve rows, if they have
more permutations than flips, as along a number, or so few that no p can be 0.05. The statistic is the same.
"""

from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import islice, permutations
from math import factorial, prod

import numpy as np

from homolog.arrays import Array, FloatArray, IntArray, frozen
from homolog.progress import Tick, no_tick
from homolog.statistics.design import Hypothesis
from homolog.statistics.shape_model import leading_scores
from homolog.threads import MOST_THREADS, blas_threads, cores

__all__ = [
    "LEVEL",
    "Randomization",
    "RandomizationTest",
    "SurfaceTest",
    "adjusted_columns",
    "dispersions",
    "p_values",
    "shape_test",
]

MANY = 300
"""Number of rows from which on all variables together are tested in this many leading modes, and are not
compared with independent rows, whose effect is of the order of 1 / rows."""
LEVEL = 0.05
"""Significance level of corrected p-values."""
LEAST_FLIPS = 4000
"""Of fewer flips than this, a p of 0.001 rests on three or fewer."""
_ROUNDING = 1e-9
"""Statistics with a smaller relative difference are equal."""
_LEAST_LEFT = 1e-9
"""Directions of a unit's rows with less than this share left by the model have no residual."""
_FLAT = 1e-12
"""Directions at a particle with less than this share of their variance left by the others count nothing."""
_CHUNK_VALUES = 400_000

_Rows = Callable[[FloatArray], FloatArray]
"""Exchanges the rows of an array (M, …) in c ways, (c, M, …)."""


def p_values(observed: FloatArray | float, null: FloatArray) -> FloatArray:
    """Return the share of a null distribution at least as extreme, the observed included.

    Parameters
    ----------
    observed : (...) array
        Statistics, larger meaning more extreme.
    null : (B,) array
        The statistic, or its maximum over a surface, of each randomization.

    Returns
    -------
    (...) array
        ``(b + 1) / (B + 1)``, never zero (Phipson and Smyth 2010).
    """
    limit = np.asarray(observed) - _ROUNDING * np.abs(observed)
    beyond = len(null) - np.searchsorted(np.sort(null), limit, side="left")
    return np.asarray((beyond + 1.0) / (len(null) + 1.0), np.float64)


def dispersions(hypothesis: Hypothesis, data: FloatArray) -> FloatArray:
    """Return the dispersion of each row, relative to their geometric mean, (M,).

    Its logarithm is a linear function of the columns of the hypothesis, so that each group has its own, and
    along a number it grows or shrinks by a constant factor per unit (Harvey 1976).

    Parameters
    ----------
    hypothesis : Hypothesis
        Tested and nuisance columns.
    data : (M, P) array
        Shapes: the root mean square of a row's residuals is its dispersion.
    """
    columns = np.hstack([hypothesis.nuisance, hypothesis.tested])
    rest = data - columns @ (columns.T @ data)
    left = np.maximum(1.0 - np.square(columns).sum(axis=1), _LEAST_LEFT)
    squares = np.square(rest).sum(axis=1) / left
    if not squares.max() > 0.0:
        return np.ones(len(data))
    logarithms = 0.5 * np.log(np.maximum(squares, _LEAST_LEFT * squares.max()))
    fitted = columns @ (columns.T @ logarithms)
    spread: FloatArray = np.exp(fitted - fitted.mean())
    return spread


def adjusted_columns(hypothesis: Hypothesis, *, hc4: bool = False) -> FloatArray:
    """Return the tested columns whose products with residuals show the variance of the coefficients, (M, d).

    Residuals are smaller than errors by the leverage of their unit, which the columns make up for. The sum
    over units of the squared products with their residuals is the variance of ``tested.T @ data``.

    Parameters
    ----------
    hypothesis : Hypothesis
        Tested and nuisance columns, and units.
    hc4 : bool
        Whether to use the exponents of HC4 (Cribari-Neto 2004), for intervals: min(4, leverage over its
        mean) in place of 1, since a unit of large leverage and dispersion attracts the fit.
    """
    columns = np.hstack([hypothesis.tested, hypothesis.nuisance])
    adjusted = np.zeros_like(hypothesis.tested)
    usual = columns.shape[1] / hypothesis.n_units
    for unit in range(hypothesis.n_units):
        own = np.flatnonzero(hypothesis.units == unit)
        leverage, vectors = np.linalg.eigh(columns[own] @ columns[own].T)
        left = 1.0 - leverage
        power = np.minimum(4.0, np.maximum(leverage, 0.0) / usual) if hc4 else 1.0
        root = np.where(left > _LEAST_LEFT, np.maximum(left, _LEAST_LEFT) ** (-0.5 * power), 0.0)
        adjusted[own] = (vectors * root) @ (vectors.T @ hypothesis.tested[own])
    return adjusted


@dataclass(frozen=True, slots=True, eq=False)
class RandomizationTest:
    """A statistic and its null distribution.

    Attributes
    ----------
    statistic : float
        The tested sum of squares divided by the one expected without an effect.
    null : (B,) array
        The statistic of each randomization. Read-only.
    exact : bool
        Whether these are all distinct ones.
    """

    statistic: float
    null: FloatArray
    exact: bool

    def __post_init__(self) -> None:
        """Freeze the array."""
        object.__setattr__(self, "null", frozen(self.null, np.float64))

    @property
    def p(self) -> float:
        """p-value."""
        return float(p_values(self.statistic, self.null))

    @property
    def z(self) -> float:
        """Effect size: standard deviates of the statistic's logarithm from its null distribution."""
        logarithms = np.log(np.maximum(self.null, np.finfo(float).tiny))
        spread = float(logarithms.std())
        own = np.log(max(self.statistic, np.finfo(float).tiny))
        return float((own - logarithms.mean()) / spread) if spread > 0.0 else 0.0


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceTest:
    """Tests at every particle. Arrays are read-only.

    Attributes
    ----------
    statistic : (N,) array
        Wald statistics: the tested coefficients, squared by the inverse of the covariance that units show.
    p : (N,) array
        p of each particle alone.
    p_fwe : (N,) array
        p of each particle, corrected over the surface (family-wise error).
    count : int
        Number of randomizations.
    exact : bool
        Whether these are all distinct ones.
    """

    statistic: FloatArray
    p: FloatArray
    p_fwe: FloatArray
    count: int
    exact: bool

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in ("statistic", "p", "p_fwe"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.float64))


class Randomization:
    """Randomization of the residuals of one hypothesis.

    Parameters
    ----------
    hypothesis : Hypothesis
        The tested and the nuisance columns, and the unit of each row.
    shapes : (M, P) array, optional
        Shapes whose dispersions are the weights of the reduced model; equal weights by default.
    draws : int
        Number of randomizations; if there are fewer distinct ones, each is used once.
    seed : int
        Same seed, same result.
    tick : Tick
        Progress and cancellation.
    """

    def __init__(
        self,
        hypothesis: Hypothesis,
        shapes: FloatArray | None = None,
        *,
        draws: int = 10_000,
        seed: int = 0,
        tick: Tick = no_tick,
    ) -> None:
        self.hypothesis, self._seed, self._tick = hypothesis, seed, tick
        tested, self._units = hypothesis.tested, hypothesis.n_units
        rows = len(tested)
        self._columns = np.hstack([tested, hypothesis.nuisance])
        flips = 2 ** min(self._units - 1, 62)
        alike = self._alike()
        orders = factorial(rows) // prod(map(factorial, alike)) if rows <= 20 else 0
        exchangeable = self._units == rows and hypothesis.nuisance.size > 0
        self.arrangements = flips
        """Distinct arrangements of the units; p is at least one in so many."""
        if exchangeable and orders and hypothesis.nuisance.shape[1] == 1:
            same = prod(factorial(count) for size, count in Counter(alike).items() if size > 1)
            self.arrangements = orders // same  # groups of the same size can be exchanged as a whole
        few = self.arrangements * LEVEL < 1.0
        self.permuted: bool = exchangeable and flips < LEAST_FLIPS and (orders > flips or few)
        possible = factorial(rows) if self.permuted else flips
        self.exact = possible - 1 <= draws
        self.count = possible - 1 if self.exact else draws
        self._adjusted = adjusted_columns(hypothesis)
        self._members = [np.flatnonzero(hypothesis.units == unit) for unit in range(self._units)]
        # Fitted values of a unit, weighted as its residuals are: (K, d, p), and (M, …) for each of its rows.
        self._fitted = self._summed(np.einsum("md,mp->mdp", self._adjusted, self._columns))
        self._crossed = np.einsum("md,mep->mdep", self._adjusted, self._fitted[hypothesis.units])
        self._squares = np.einsum("udp,ueq->depq", self._fitted, self._fitted)
        self._spread = np.ones(rows)
        if shapes is not None and not self.permuted:
            self._spread = dispersions(hypothesis, shapes)

    def _rest(self, values: FloatArray) -> FloatArray:
        """Return the residuals (M, P) of the reduced model, fitted with weights."""
        nuisance, spread = self.hypothesis.nuisance, self._spread[:, None]
        solved = np.linalg.lstsq(nuisance / spread, values / spread, rcond=None)[0]
        rest: FloatArray = values - nuisance @ solved
        return rest

    def _alike(self) -> list[int]:
        """Return the numbers of equal rows of the design."""
        rounded = np.round(self._columns, 10)
        return list(Counter(map(bytes, rounded + 0.0)).values())

    def _summed(self, rows: FloatArray) -> FloatArray:
        """Return the sums of rows (M, …) over each unit, (K, …)."""
        return np.stack([rows[own].sum(axis=0) for own in self._members])

    def ratio(self, values: FloatArray) -> RandomizationTest:
        """Test all variables together: the tested sum of squares over the one expected without an effect.

        Both are divided by what independent rows of these dispersions would give, which matters for few rows.

        Parameters
        ----------
        values : (M, P) array
            Variables in common units, such as coordinates [mm] or standardized scores.
        """
        rest = self._rest(values)
        many = len(rest) > MANY
        if rest.shape[1] > min(len(rest), MANY):  # the same inner products in fewer columns
            rest = leading_scores(rest, min(len(rest), MANY))[0]
        usual = None if many else self._rest(np.diag(self._spread))
        tested = self.hypothesis.tested.shape[1]
        trace = np.trace(self._squares)
        crossed = np.einsum("mddp->mp", self._crossed)
        weights = np.square(self._adjusted).sum(axis=1)

        def sums(rows: _Rows, own: FloatArray) -> FloatArray:
            fitted = rows(self._columns).swapaxes(1, 2) @ own
            cross = rows(crossed).swapaxes(1, 2) @ own
            if self.permuted:
                fixed = rows(weights) @ np.square(own).sum(axis=1)
            else:
                fixed = np.square(self._summed(self._adjusted[:, :, None] * own[:, None, :])).sum()
            expected = fixed - 2.0 * (cross * fitted).sum(axis=(1, 2))
            expected = expected + np.einsum("cpk,pq,cqk->c", fitted, trace, fitted, optimize=True)
            explained = np.square(fitted[:, :tested]).sum(axis=(1, 2))
            # Flips that turn the tested columns into nuisance columns explain nothing.
            none = explained <= _LEAST_LEFT * expected
            return np.where(none, 0.0, explained / np.where(none, 1.0, expected))

        def statistic(rows: _Rows) -> FloatArray:
            observed = sums(rows, rest)
            if usual is None:
                return observed
            expected = sums(rows, usual)
            return np.where(expected > 0.0, observed / np.where(expected > 0.0, expected, 1.0), 0.0)

        size = self._columns.shape[1] * (rest.shape[1] + len(rest))
        null, done = np.empty(self.count), 0
        with blas_threads(1), ThreadPoolExecutor(workers := min(cores(), MOST_THREADS)) as pool:
            observed = float(statistic(lambda array: array[None])[0])
            some = self._randomized(max(1, _CHUNK_VALUES // size))
            while batch := list(islice(some, workers)):
                self._tick(done / max(self.count, 1), "randomization")
                for drawn in pool.map(statistic, batch):
                    null[done : done + len(drawn)] = drawn
                    done += len(drawn)
        return RandomizationTest(observed, null, self.exact)

    def surface(self, positions: FloatArray) -> SurfaceTest:
        """Test every particle, corrected over the surface by the largest statistic (Westfall and Young 1993).

        Parameters
        ----------
        positions : (M, N, v) array
            Variables that are tested together, v at each of N particles.
        """
        statistic = self.wald(positions)
        particles, width = positions.shape[1], self._columns.shape[1]
        cost = particles * positions.shape[2] * width * (1 + self.hypothesis.tested.shape[1] ** 2)
        largest, done = np.empty(self.count), 0
        beyond = np.zeros(particles, np.int64)
        with blas_threads(1), ThreadPoolExecutor(workers := min(cores(), MOST_THREADS)) as pool:
            observed = statistic(lambda array: array[None])[0]
            limit = observed - _ROUNDING * np.abs(observed)
            some = self._randomized(max(1, _CHUNK_VALUES // cost))
            while batch := list(islice(some, workers)):
                self._tick(done / max(self.count, 1), "randomization at every particle")
                for drawn in pool.map(statistic, batch):
                    largest[done : done + len(drawn)] = drawn.max(axis=1)
                    beyond += np.count_nonzero(drawn >= limit, axis=0)
                    done += len(drawn)
        p = (beyond + 1.0) / (self.count + 1.0)
        return SurfaceTest(observed, p, p_values(observed, largest), self.count, self.exact)

    def wald(self, positions: FloatArray) -> Callable[[_Rows], FloatArray]:
        """Return the Wald statistics (c, N) of all particles as a function of exchanged rows."""
        subjects, particles, directions = positions.shape
        flat = positions.reshape(subjects, -1)
        rest = self._rest(flat)
        rest[:, np.square(rest).sum(axis=0) <= _ROUNDING**2 * np.square(flat).sum(axis=0)] = 0.0
        rest = np.ascontiguousarray(rest.reshape(positions.shape).swapaxes(1, 2))
        flat = rest.reshape(subjects, -1)
        tested, width = self.hypothesis.tested.shape[1], self._columns.shape[1]
        own = self._summed(np.einsum("md,mvn->mdvn", self._adjusted, rest))
        weights = np.einsum("md,me->mde", self._adjusted, self._adjusted)
        pairs = [(v, w) for v in range(directions) for w in range(v + 1)]

        def fixed(rows: _Rows) -> Callable[[int, int, int, int], FloatArray]:
            """Return the sums of products of the units' own parts."""
            if not self.permuted:
                return lambda d, e, v, w: np.einsum("un,un->n", own[:, d, v], own[:, e, w])
            moved = rows(weights).transpose(0, 2, 3, 1)
            products = {(v, w): moved @ (rest[:, v] * rest[:, w]) for v, w in pairs}
            return lambda d, e, v, w: products[max(v, w), min(v, w)][:, d, e]

        def statistic(rows: _Rows) -> FloatArray:
            columns, crossed = rows(self._columns), rows(self._crossed)
            draws, shape = len(columns), (directions, particles)
            fitted = (columns.swapaxes(1, 2).reshape(-1, subjects) @ flat).reshape(draws, width, *shape)
            crossed = crossed.reshape(draws, subjects, -1).swapaxes(1, 2).reshape(-1, subjects)
            cross = (crossed @ flat).reshape(draws, tested, tested, width, *shape)
            start = fixed(rows)
            covariance: list[list[FloatArray]] = []
            for row in range(tested * directions):
                d, v = divmod(row, directions)
                covariance.append([])
                for column in range(row + 1):
                    e, w = divmod(column, directions)
                    entry = start(d, e, v, w) - cross[:, d, e, 0, v] * fitted[:, 0, w]
                    for p in range(width):
                        if p:
                            entry -= cross[:, d, e, p, v] * fitted[:, p, w]
                        weighted = np.einsum("q,cqn->cn", self._squares[d, e, p], fitted[:, :, w])
                        entry += fitted[:, p, v] * (weighted - cross[:, e, d, p, w])
                    covariance[row].append(entry)
            coefficients = [fitted[:, d, v] for d in range(tested) for v in range(directions)]
            return _squared(coefficients, covariance)

        return statistic

    def _randomized(self, chunk: int) -> Iterator[_Rows]:
        """Yield exchanges of rows in chunks."""
        generator = np.random.default_rng(self._seed)
        all_orders = islice(permutations(range(len(self._columns))), 1, None)
        for start in range(0, self.count, chunk):
            size = min(chunk, self.count - start)
            if self.permuted:
                if self.exact:
                    orders = np.array(list(islice(all_orders, size)))
                else:
                    orders = generator.random((size, len(self._columns))).argsort(axis=1)
                yield _permuting(orders)
                continue
            if self.exact:
                bits = np.arange(start + 1, start + 1 + size)[:, None] >> np.arange(self._units)
            else:
                bits = generator.integers(0, 2, size=(size, self._units))
            yield _flipping(1.0 - 2.0 * (bits & 1)[:, self.hypothesis.units])


def shape_test(
    shapes: FloatArray, hypothesis: Hypothesis, *, draws: int = 10_000, seed: int = 0, tick: Tick = no_tick
) -> RandomizationTest:
    """Test shapes (M, N, 3) on all their coordinates; see `Randomization`."""
    rows = shapes.reshape(len(shapes), -1)
    return Randomization(hypothesis, rows, draws=draws, seed=seed, tick=tick).ratio(rows)


def _permuting(orders: IntArray) -> _Rows:
    return lambda array: array[orders]


def _flipping(signs: Array) -> _Rows:
    return lambda array: signs.reshape(*signs.shape, *[1] * (array.ndim - 1)) * array


def _squared(coefficients: list[FloatArray], covariance: list[list[FloatArray]]) -> FloatArray:
    """Return the squared length of coefficients by the inverse covariance, given its lower triangle.

    Its Cholesky factor is computed at all places at once. Directions without variance count nothing.
    """
    factor: list[list[FloatArray]] = []
    scaled: list[FloatArray] = []
    inverses: list[FloatArray] = []
    for row, entries in enumerate(covariance):
        factor.append([])
        for column, entry in enumerate(entries):
            rest = entry
            for k in range(column):
                rest = rest - factor[row][k] * factor[column][k]
            if column < row:
                factor[row].append(rest * inverses[column])
        floor = np.maximum(_FLAT * entries[row], np.finfo(float).tiny)
        inverses.append(np.where(rest > floor, 1.0 / np.sqrt(np.maximum(rest, floor)), 0.0))
        own = coefficients[row]
        for k in range(row):
            own = own - factor[row][k] * scaled[k]
        scaled.append(own * inverses[row])
    return np.asarray(sum(np.square(item) for item in scaled), np.float64)
