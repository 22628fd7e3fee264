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
        Group of the reference's controls, or its project's name if they have no group.
    controls : int
        Number of controls of the reference.
    modes, outside : float
        Probabilities that a member of the group is at least as far from its mean in the modes, and outside
        them.
    p : float
        Both combined (Bonferroni): 0.05 or less in at most 5 % of the members.
    held_modes, held_outside : int
        Calibration: numbers of controls with a probability above 0.05 relative to the others.
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
        """Whether the patient is within the central 95 % of the group."""
        return self.p > _LEVEL


def typicality(comparison: PatientComparison, reference: Reference) -> Typicality:
    """Return the typicality of a patient for a reference's group (McLachlan 1992, section 6.4).

    Distances in the modes and outside them are compared with those of the controls, each of which was fitted
    as a patient to the model of the others. Probabilities are those of a new value in a log-normal
    distribution, including the uncertainty of its mean and deviation.

    Parameters
    ----------
    comparison : PatientComparison
        Comparison with this reference.
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
    """Return the probability that a new value is at least as large."""
    logs = np.log(np.maximum(controls, 1e-12))
    spread = max(float(logs.std(ddof=1)), 1e-9) * np.sqrt(1.0 + 1.0 / len(logs))
    return float(stats.t.sf((np.log(max(value, 1e-12)) - logs.mean()) / spread, len(logs) - 1))


def _held(controls: FloatArray) -> int:
    everyone = np.arange(len(controls))
    return sum(
        _exceedance_probability(float(controls[index]), controls[everyone != index]) > _LEVEL
        for index in everyone.tolist()
    )
