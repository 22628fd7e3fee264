"""Pairs of particles of one shape whose exchange lowers the entropies across the shapes.

An exchange leaves the particles of a shape where they are, and so their sampling entropy; only H(Z) and H(V)
change. It adds a row d to one of the rows Y, and C = Y Y'/c changes by two vectors across the shapes: p, the
unit vector of the shape, centred, and y = Y d. So log det(C + aI) changes by the logarithm of a 2 x 2
determinant.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from homolog.arrays import BoolArray, FloatArray, IntArray
from homolog.correspondence.entropy.terms import Term
from homolog.correspondence.near_pairs import PlacedParticles, Survey, promising_pairs
from homolog.registration.entropy import covariance

__all__ = ["LEAST_GAIN", "EnsembleRows", "Exchanges"]

LEAST_GAIN = 0.05
"""Smallest decrease of the objective by an exchange, summed over all particles."""


@dataclass(frozen=True, slots=True, eq=False)
class EnsembleRows:
    """Aligned particles for the entropies across shapes.

    Attributes
    ----------
    positions, normals : (M, N, 3) arrays
        In the optimizer's length, and of unit length.
    means : (N, 3) array
        Fréchet means of the normals.
    openings : (M, N) array
        Weighted opening angles; zeros if they are not used.
    terms : pair of Term
        H(Z) and H(V) in the objective.
    """

    positions: FloatArray
    normals: FloatArray
    means: FloatArray
    openings: FloatArray
    terms: tuple[Term, Term]

    def of_normals(self) -> FloatArray:
        """Return the rows of H(V), (M, N, 3): Logs of the normals, and opening angles along their means."""
        return _logs(self.normals, self.means) + self.openings[..., None] * self.means


class Exchanges:
    """Exchanges of two particles of one shape, and how far they lower the objective.

    Parameters
    ----------
    rows : EnsembleRows

    Attributes
    ----------
    order : (M, N) int array
        Index of the given particle at each position after the exchanges.
    """

    def __init__(self, rows: EnsembleRows) -> None:
        self._rows = rows
        self._entropies = (
            _Entropy(rows.positions, rows.terms[0].regularization),
            _Entropy(rows.of_normals(), rows.terms[1].regularization),
        )
        self.order: IntArray = np.tile(np.arange(rows.positions.shape[1]), (len(rows.positions), 1))

    def gains(self, shape: int, pairs: IntArray) -> FloatArray:
        """Return by how much exchanges of pairs (P, 2) on a shape lower w_Z H(Z) and w_V H(V), (P, 2).

        Values are sums over all particles.
        """
        steps = zip(self._entropies, self._steps(shape, pairs), strict=True)
        changed = [part.change(shape, pairs, step) for part, step in steps]
        return -np.stack(changed, axis=1) * [term.weight for term in self._rows.terms]

    def lower(self, shape: int, pair: IntArray, least: float) -> bool:
        """Return whether an exchange lowers H(Z), and the objective by more than `least`."""
        return bool(_sums(self.gains(shape, pair[None]))[0] > least)

    def make_all(
        self, allowed: BoolArray, poll_cancel: Callable[[], None] = lambda: None, device: str = "cpu"
    ) -> None:
        """Exchange near particles until no exchange lowers H(Z) and the objective any more.

        Exchanges that only improve normals are not made: on noisy surfaces normals agree better by chance.

        Parameters
        ----------
        allowed : (M, N) bool array
            Particles that may be exchanged.
        poll_cancel : callable
            Called before each shape; it may raise to stop the work.
        device : str
            Warp device that judges pairs.
        """
        made = True
        while made:
            poll_cancel()
            made = False
            for shape, pairs in self._candidates(allowed, device):
                poll_cancel()
                made |= self._make_best(shape, pairs)

    def _candidates(self, allowed: BoolArray, device: str) -> list[tuple[int, IntArray]]:
        """Return for some shapes the near pairs (P, 2) whose exchange lowers both when a pass begins."""
        rows, own = self._rows, np.arange(len(allowed))[:, None]
        placed = PlacedParticles(
            rows.positions[own, self.order],
            rows.normals[own, self.order],
            rows.openings[own, self.order],
            rows.means,
        )
        surveys = [part.survey(term.weight) for part, term in zip(self._entropies, rows.terms, strict=True)]
        divisor = self._entropies[0].divisor
        return promising_pairs(placed, allowed, surveys, divisor=divisor, least=LEAST_GAIN, device=device)

    def _make_best(self, shape: int, pairs: IntArray) -> bool:
        """Make exchanges of some pairs of a shape, the best one first; return whether there were any."""
        count = len(pairs)
        while len(pairs):
            gains = _sums(self.gains(shape, pairs))
            best = int(gains.argmax())
            if gains[best] <= LEAST_GAIN:
                break
            self.make(shape, pairs[best])
            pairs = np.delete(pairs, best, axis=0)
        return len(pairs) < count

    def make(self, shape: int, pair: IntArray) -> None:
        """Exchange two particles of a shape."""
        for part, step in zip(self._entropies, self._steps(shape, pair[None]), strict=True):
            part.add(shape, pair, step[0])
        self.order[shape, pair] = self.order[shape, pair[::-1]]

    def _steps(self, shape: int, pairs: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return the changes of the rows of H(Z) and H(V) at the two particles, (P, 2, 3) each."""
        own, other = self.order[shape, pairs], self.order[shape, pairs[:, ::-1]]
        rows, means = self._rows, self._rows.means[pairs]
        positions, normals, openings = rows.positions[shape], rows.normals[shape], rows.openings[shape]
        turned = _logs(normals[other], means) - _logs(normals[own], means)
        turned += (openings[other] - openings[own])[..., None] * means
        return positions[other] - positions[own], turned


class _Entropy:
    """H(Z) or H(V) of rows (M, N, 3), and its change with two particles of one of them."""

    def __init__(self, rows: FloatArray, regularization: float) -> None:
        shapes, count = rows.shape[:2]
        self._rows = rows - rows.mean(axis=0)
        self.divisor = count * max(shapes - 1, 1)
        self._factor = 0.5 * (shapes - 1) * count
        self._common = 1.0 / (shapes * regularization)
        matrix = covariance(self._rows.reshape(shapes, -1)) + regularization * np.eye(shapes)
        self._inverse = np.linalg.inv(matrix)

    def survey(self, weight: float) -> Survey:
        """Return what the changes by all pairs of all shapes have in common."""
        pulled = (self._inverse @ self._rows.reshape(len(self._rows), -1)).reshape(self._rows.shape)
        own = self._inverse.diagonal() - self._common
        rows, pulled = (np.ascontiguousarray(array.swapaxes(0, 1)) for array in (self._rows, pulled))
        return Survey(own, rows, pulled, weight * self._factor)

    def change(self, shape: int, pairs: IntArray, steps: FloatArray) -> FloatArray:
        """Return by how much the entropy changes, summed over all particles."""
        across = self._across(pairs, steps)
        pulled = self._inverse @ across
        own = float(self._inverse[shape, shape]) - self._common
        return self.logarithm(own, steps, pulled[shape], np.einsum("mp,mp->p", across, pulled))

    def logarithm(self, own: float, steps: FloatArray, mixed: FloatArray, both: FloatArray) -> FloatArray:
        """Return the change from p' C^-1 p, p' C^-1 y and y' C^-1 y; the latter two are (P,)."""
        c = self.divisor
        squared = np.square(steps).sum(axis=(1, 2))
        determinant = (c + squared * own + mixed) * (c + mixed) - own * (squared * mixed + both)
        return np.asarray(self._factor * np.log(determinant / c**2))

    def add(self, shape: int, pair: IntArray, step: FloatArray) -> None:
        """Change the rows (Woodbury's identity)."""
        unit = -np.full(len(self._rows), 1.0 / len(self._rows))
        unit[shape] += 1.0
        changed = np.stack([unit, self._across(pair[None], step[None])[:, 0]], axis=1)
        pulled = self._inverse @ changed
        core = self.divisor * np.array([[0.0, 1.0], [1.0, -np.square(step).sum()]]) + changed.T @ pulled
        self._inverse -= pulled @ np.linalg.solve(core, pulled.T)
        self._rows[shape, pair] += step
        self._rows[:, pair] -= self._rows[:, pair].mean(axis=0)

    def _across(self, pairs: IntArray, steps: FloatArray) -> FloatArray:
        """Return y = Y d, (M, P)."""
        return np.asarray(np.einsum("mpki,pki->mp", self._rows[:, pairs], steps))


def _sums(gains: FloatArray) -> FloatArray:
    """Return the gains (P,) of exchanges, 0 where H(Z) would not fall."""
    return np.where(gains[:, 0] > 0.0, gains.sum(axis=1), 0.0)


def _logs(normals: FloatArray, means: FloatArray) -> FloatArray:
    """Return the Logs of unit normals (..., 3) at means (..., 3)."""
    cosine = np.clip(np.sum(normals * means, axis=-1, keepdims=True), -1.0 + 1e-9, 1.0)
    return np.asarray((normals - cosine * means) / np.sinc(np.arccos(cosine) / np.pi))
