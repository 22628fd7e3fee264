"""The statistics of all permutation tests: studentized, so that they hold when dispersions differ.

Groups are compared by Welch's F (1951), extended to several coordinates of one variance within a group and
expressed as the normal deviate that is as unlikely (Paulson 1942). Before subjects are exchanged, the groups
are scaled to one dispersion; each group's own dispersion is restored afterwards. The permutation
distribution then is that of groups with these dispersions and equal means (Chung and Romano 2013 show that
studentizing alone suffices for many subjects; scaling serves few).

With covariates and for a continuous variable the sum of squares of the tested effect is divided by what it
would be on average without an effect, given each subject's own residual (Brown and Forsythe 1974, with the
variances of MacKinnon and White's HC2, 1985).
"""

from dataclasses import dataclass

import numpy as np

from homolog.analysis.design import Design, Exchange
from homolog.analysis.permutation import Relabelling
from homolog.arrays import FloatArray, frozen

__all__ = ["EqualizedGroups", "WelchStatistic", "equalized", "identity", "null_weights", "studentized_ratio"]

_LEAST_ROOM = 1e-6
"""A residual is divided by no less than this: with a leverage of one it is zero."""
_FLAT = 1e-20
"""Sum of squares where nothing varies, of standardized coordinates."""


@dataclass(frozen=True, slots=True, eq=False)
class EqualizedGroups:
    """Values scaled to one dispersion in all groups. Arrays are read-only.

    Attributes
    ----------
    values : (M, P) array
        Differences from the weighted mean of the groups, divided by the dispersion of the subject's group.
    dispersions : (K,) array
        Of the groups, relative to their geometric mean.
    mean_spread : float
        Standard deviation that centring took from the mean of `values`, relative to that of one subject.
    """

    values: FloatArray
    dispersions: FloatArray
    mean_spread: float

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in ("values", "dispersions"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.float64))


def equalized(values: FloatArray, design: Design, *, scaled: bool = True) -> EqualizedGroups | None:
    """Scale groups to one dispersion; None if the design has covariates, a variable or pairs.

    Parameters
    ----------
    values : (M, P) array
        Data with the intercept regressed out.
    design : Design
        With the real labels.
    scaled : bool
        Whether to scale; the dispersions are taken as equal otherwise, and the permutation test is exact
        for exchangeable subjects.
    """
    memberships = _memberships(identity(design), design)
    if memberships is None:
        return None
    members = memberships[0]
    if not scaled:
        return EqualizedGroups(values, np.ones(len(members)), 0.0)
    counts = members.sum(axis=1)
    means = members @ values / counts[:, None]
    rest = values - members.T @ means
    variances = members @ np.square(rest).sum(axis=1) / np.maximum(counts - 1.0, 1.0)
    variances = np.maximum(variances, _LEAST_ROOM * variances.max())
    if not variances.max() > 0.0:
        return EqualizedGroups(values, np.ones(len(members)), 0.0)
    dispersions = np.sqrt(variances / np.exp(np.log(variances).mean()))
    precisions = counts / np.square(dispersions)
    centre = precisions @ means / precisions.sum()
    mean_spread = (counts / dispersions).sum() / counts.sum() / np.sqrt(precisions.sum())
    return EqualizedGroups(
        (values - centre) / (members.T @ dispersions)[:, None], dispersions, float(mean_spread)
    )


class WelchStatistic:
    """Welch's F of groups at every place of a surface, for any relabelling of a design of groups.

    Parameters
    ----------
    coordinates : (v, M, N) array
        Of the equalized groups, standardized: of about one variance within a group.
    varying : (N,) array
        How many of the v coordinates vary at each place, at least 1.
    groups : EqualizedGroups
        The dispersions that are restored.
    design : Design
        Whose rows are exchanged.
    """

    def __init__(
        self, coordinates: FloatArray, varying: FloatArray, groups: EqualizedGroups, design: Design
    ) -> None:
        self._coordinates, self._varying, self._design = coordinates, varying, design
        self._squares = np.square(coordinates).sum(axis=0)
        self._dispersions = groups.dispersions[:, None]
        self._mean_spread = groups.mean_spread

    def f(self, relabelling: Relabelling) -> tuple[FloatArray, FloatArray]:
        """Return F and the degrees of freedom of its denominator (Welch 1951), (c, N) each."""
        memberships = _memberships(relabelling, self._design)
        if memberships is None:
            raise ValueError("the design is not one of groups alone")
        draws, groups, subjects = memberships.shape
        flat = memberships.reshape(draws * groups, subjects)
        counts = memberships.sum(axis=2)[:, :, None]
        free = np.maximum(counts - 1.0, 1.0)
        squares = (flat @ self._squares).reshape(draws, groups, -1)
        means = np.stack([(flat @ axis).reshape(draws, groups, -1) for axis in self._coordinates]) / counts
        within = np.maximum(squares - counts * np.square(means).sum(axis=0), _LEAST_ROOM * squares)
        within = np.maximum(within * np.square(self._dispersions), _FLAT)
        if relabelling.signs is not None and self._mean_spread:
            means += np.stack([self._random_mean(relabelling.signs, axis) for axis in self._coordinates])
        means *= self._dispersions
        weights = counts * self._varying * free / within
        total = weights.sum(axis=1)
        grand = (weights * means).sum(axis=2) / total
        between = (weights * np.square(means - grand[:, :, None]).sum(axis=0)).sum(axis=1)
        spread = (np.square(1.0 - weights / total[:, None]) / free).sum(axis=1) / self._varying
        spread = np.maximum(spread, np.finfo(float).tiny)
        ratio = between / (self._varying * (groups - 1.0))
        ratio /= 1.0 + 2.0 * (groups - 2.0) / (groups**2 - 1.0) * spread
        return ratio, (groups**2 - 1.0) / (3.0 * spread)

    def deviate(self, relabelling: Relabelling) -> FloatArray:
        """Return the normal deviate that is as unlikely as F, (c, N)."""
        ratio, dof = self.f(relabelling)
        across = self._varying * float(self._design.tested.shape[1])
        of_numerator, of_denominator = 2.0 / (9.0 * across), 2.0 / (9.0 * dof)
        root = np.cbrt(ratio)
        deviate: FloatArray = ((1.0 - of_denominator) * root - (1.0 - of_numerator)) / np.sqrt(
            of_denominator * np.square(root) + of_numerator
        )
        return deviate

    def _random_mean(self, signs: FloatArray, axis: FloatArray) -> FloatArray:
        """Return random means, (c, 1, N), whose covariance over the surface is that of the data."""
        drawn: FloatArray = (self._mean_spread / np.sqrt(signs.shape[1]) * signs @ axis)[:, None]
        return drawn


def _memberships(relabelling: Relabelling, design: Design) -> FloatArray | None:
    """Return who is in which group, (c, K, M) of 0 and 1; None if anything else than groups is in the design.

    The intercept and the tested columns of K groups span the groups' indicators.
    """
    if design.exchange is Exchange.SIGNS or design.covariates.shape[1]:
        return None
    rows = np.unique(np.round(design.tested, 10), axis=0)
    if len(rows) != design.tested.shape[1] + 1:
        return None
    intercept = len(design.tested) ** -0.5
    solved = np.linalg.inv(np.column_stack([np.full(len(rows), intercept), rows]))
    memberships = np.round(intercept * solved[0] + relabelling.tested @ solved[1:])
    return np.ascontiguousarray(memberships.swapaxes(1, 2))


def identity(design: Design) -> Relabelling:
    """Return the real labels as a relabelling."""
    return Relabelling(design.tested[None], design.covariates[None])


def null_weights(relabelling: Relabelling, design: Design) -> FloatArray:
    """Return what each subject's squared residual adds to the expected sum of squares, shape (c, M).

    This is the leverage of the tested columns divided by what all columns leave of the subject's variance.
    """
    tested = np.square(relabelling.tested).sum(axis=2)
    taken = tested + np.square(relabelling.covariates).sum(axis=2)
    if design.nuisance.shape[1]:
        taken = taken + 1.0 / len(design.tested)
    weights: FloatArray = tested / np.maximum(1.0 - taken, _LEAST_ROOM)
    return weights


def studentized_ratio(scores: FloatArray, relabelling: Relabelling, design: Design) -> FloatArray:
    """Return the ratio of tested to expected sum of squares of each relabelling, shape (c,).

    Parameters
    ----------
    scores : (M, k) or (c, M, k) array
        Standardized coordinates with the (relabelled) nuisance columns regressed out.
    relabelling : Relabelling
        Of c designs.
    design : Design
        The design that was relabelled.
    """
    projected = np.swapaxes(relabelling.tested, 1, 2) @ scores
    rest = np.square(scores - relabelling.tested @ projected).sum(axis=2)
    expected = (null_weights(relabelling, design) * rest).sum(axis=1)
    explained = np.square(projected).sum(axis=(1, 2))
    ratio: FloatArray = explained / np.maximum(expected, np.finfo(float).tiny)
    return ratio
