"""The terms H(Z) and H(V) in the schedule: weight and regularization in an iteration, and over a stage."""

from dataclasses import dataclass

__all__ = ["Term", "TermSchedule"]


@dataclass(frozen=True, slots=True)
class Term:
    """A term of the objective in one iteration.

    Attributes
    ----------
    weight : float
        Factor of the entropy in the objective.
    regularization : float
        Variance added to the covariance: a squared optimizer length for H(Z), rad² for H(V).
    """

    weight: float
    regularization: float


@dataclass(frozen=True, slots=True)
class TermSchedule:
    """A term of the objective over the iterations of a stage.

    Attributes
    ----------
    weight : float
        Factor of the entropy in the objective.
    start, end : float
        Regularization before the first and after the last iteration, interpolated geometrically.
    """

    weight: float
    start: float
    end: float

    def at(self, done: float) -> Term:
        """Return the term when a fraction of the stage is done."""
        return Term(self.weight, self._regularization(done))

    def scaled(self, factor: float) -> "TermSchedule":
        """Return the schedule with another weight."""
        return TermSchedule(factor * self.weight, self.start, self.end)

    def part(self, begin: float, end: float) -> "TermSchedule":
        """Return the schedule from one fraction to another."""
        return TermSchedule(self.weight, self._regularization(begin), self._regularization(end))

    def _regularization(self, done: float) -> float:
        ratio: float = (self.end / self.start) ** done
        return self.start * ratio
