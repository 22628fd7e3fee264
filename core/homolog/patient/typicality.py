"""Typicality of a patient for each of several groups."""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from homolog.arrays import FloatArray
from homolog.patient.compare import PatientComparison
from homolog.patient.reference import Reference

__all__ = ["Typicality", "typicality"]

_LEVEL = 0.05
_MEASURES = 2


@dataclass(frozen=True, slots=True)
class Typicality:
    """Typicality of a patient for one group.

    Attributes
    ----------
    group : str
        Of the reference's controls, or its project's name if they have none.
    controls : int
        Number of controls of the reference.
    modes, outside : float
        Probability that a member of the group is as far from its mean in the modes, and outside of them.
    p : float
        Both together (Bonferroni): a member's is 0.05 or less in 5 % of cases or fewer.
    held_modes, held_outside : int
        Calibration: how many controls have a probability above 0.05 by the values of the others.
    """

    group: str
    controls: int
    modes: float
    outside: float
    p: float
    held_modes: int
    held_outside: int

    @property
    def is_typical(self) -> bool:
        """Whether the patient is within the 95 % of the group's members that are nearest to it."""
        return self.p > _LEVEL


def typicality(comparison: PatientComparison, reference: Reference) -> Typicality:
    """Return the typicality of a patient for a reference's group (McLachlan 1992, section 6.4).

    Distances in the modes and outside of them are set against those of the controls, each of which was fitted
    as a patient to the model of the others. Probabilities are of a new value by a normal distribution of
    their logarithms, with the uncertainty of its mean and deviation.

    Parameters
    ----------
    comparison : PatientComparison
        With this reference.
    reference : Reference

    Returns
    -------
    Typicality
    """
    about = reference.provenance
    modes = _exceedance_probability(comparison.measures.mahalanobis, reference.mahalanobis)
    outside = _exceedance_probability(comparison.measures.outside, reference.outside)
    return Typicality(
        about.group or about.project,
        about.controls,
        modes,
        outside,
        min(1.0, _MEASURES * min(modes, outside)),
        _held(reference.mahalanobis),
        _held(reference.outside),
    )


def _exceedance_probability(value: float, controls: FloatArray) -> float:
    """Return the probability that a new value is as large."""
    logs = np.log(np.maximum(controls, 1e-12))
    spread = max(float(logs.std(ddof=1)), 1e-9) * np.sqrt(1.0 + 1.0 / len(logs))
    return float(stats.t.sf((np.log(max(value, 1e-12)) - logs.mean()) / spread, len(logs) - 1))


def _held(controls: FloatArray) -> int:
    everyone = np.arange(len(controls))
    return sum(
        _exceedance_probability(float(controls[index]), controls[everyone != index]) > _LEVEL
        for index in everyone.tolist()
    )
