"""The test of equal dispersion: whether the subjects of one group scatter more than those of another.

Each subject's distance to its group's centroid in the retained modes is compared between the groups (Anderson
2006, PERMDISP). Without groups, residuals are compared along the variable (Breusch and Pagan's idea).
"""

from dataclasses import dataclass

import numpy as np

from homolog.analysis.design import Design, Exchange
from homolog.analysis.permutation import null_distribution, permutation_p_value
from homolog.analysis.shape_model import leading_scores
from homolog.analysis.studentized import observed_design
from homolog.arrays import BoolArray, FloatArray, frozen
from homolog.threads import on_one_thread

__all__ = ["Dispersion", "dispersion_test"]

_CHUNK = 500


@dataclass(frozen=True, slots=True, eq=False)
class Dispersion:
    """Dispersion of the groups, and whether it differs.

    Attributes
    ----------
    distances : (M,) array
        Distance of each subject to its group's centroid, or to its fitted shape, in the retained modes: root
        mean square over the particles [mm], corrected for fitting the centroid.
    by_group : dict
        Mean distance in each group [mm]; empty without groups.
    f : float
        Ratio of the variances of the distances between and within groups.
    p : float
        Share of the permutations of the distances (covariates taken out) with as large a ratio.
    permutations : int
        Number of permutations.
    """

    distances: FloatArray
    by_group: dict[str, float]
    f: float
    p: float
    permutations: int

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        object.__setattr__(self, "distances", frozen(self.distances, np.float64))

    @property
    def ratio(self) -> float:
        """Largest mean distance of a group divided by the smallest; 1 without groups."""
        means = list(self.by_group.values())
        return max(means) / max(min(means), np.finfo(float).tiny) if means else 1.0


@on_one_thread
def dispersion_test(
    particles: FloatArray,
    design: Design,
    modes: int,
    members: dict[str, BoolArray],
    *,
    permutations: int = 10_000,
    seed: int = 0,
) -> Dispersion | None:
    """Test whether residual distances differ between groups, or along a variable.

    Parameters
    ----------
    particles : (M, N, 3) array
        Aligned positions [mm].
    design : Design
        Of groups or of a continuous variable.
    modes : int
        Number of leading modes.
    members : dict of (M,) bool arrays
        Who is in each group; empty for a continuous variable.
    permutations : int
        Permutations of the distances.
    seed : int
        Same seed, same result.

    Returns
    -------
    Dispersion or None
        None for pairs, whose differences are one group, or without a mode.
    """
    if design.exchange is Exchange.SIGNS or modes == 0:
        return None
    rows = design.residuals(particles.reshape(len(particles), -1))
    scores, _ = leading_scores(rows, modes)
    rest = scores - design.tested @ (design.tested.T @ scores)
    columns = np.hstack([design.nuisance, design.tested])
    leverage_left = np.maximum(1.0 - np.square(columns).sum(axis=1), 1e-6)
    distances = np.sqrt(np.square(rest).sum(axis=1) / leverage_left / particles.shape[1])
    # Permuting what nuisance columns leave holds the level better than permuting residuals of all columns.
    values = design.residuals(distances[:, None])[:, 0]
    observed = _ratio(values, design, observed_design(design).tested)
    null_statistics = null_distribution(
        lambda some: _ratio(values, design, some.tested), design, permutations, chunk=_CHUNK, seed=seed
    )
    by_group = {name: float(distances[own].mean()) for name, own in members.items()}
    p = float(permutation_p_value(observed, null_statistics)[0])
    return Dispersion(distances, by_group, float(observed[0]), p, len(null_statistics))


def _ratio(values: FloatArray, design: Design, tested: FloatArray) -> FloatArray:
    """Return the F ratio (c,) of values (M,), nuisance columns taken out, on tested bases (c, M, d)."""
    explained = np.square(np.swapaxes(tested, 1, 2) @ values).sum(axis=1)
    rest = np.maximum(values @ values - explained, np.finfo(float).tiny)
    ratio: FloatArray = (explained / tested.shape[2]) / (rest / design.error_dof)
    return ratio
