"""The statistics of all permutation tests: studentized, so that they are valid if dispersions differ.

Groups are compared by Welch's F (1951), extended to several coordinates of equal variance within a group and
expressed as the normal deviate of equal probability (Paulson 1942). Before subjects are exchanged, the groups
are scaled to one dispersion; each group's own dispersion is restored afterwards. The permutation distribution
is then that of groups with these dispersions and equal means. (Chung and Romano 2013 show that studentizing
alone suffices for many subjects; scaling helps with few.)

With covariates and for a continuous variable the sum of squares of the tested effect is divided by its
expectation without an effect, given each subject's own residual (Brown and Forsythe 1974, with the variances
of MacKinnon and White's HC2, 1985). Dispersions of groups are scaled and restored in the same way; along a
variable, the logarithm of the dispersion is a linear function. The residuals of a weighted fit of the
covariates are exchanged (Freedman and Lane 1983).

Wilks' lambda with its F distribution, which assumes equal covariances, is reported in addition; with one
tested column it is Hotelling's T².
"""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from homolog.arrays import FloatArray, IntArray, frozen
from homolog.statistics.design import Design, Exchange
from homolog.statistics.permutation import PermutedDesigns

__all__ = [
    "EqualizedGroups",
    "EqualizedSubjects",
    "WelchStatistic",
    "design_columns",
    "equalize_groups",
    "equalize_subjects",
    "hotelling",
    "null_weights",
    "observed_design",
    "rao_f",
    "restores_mean",
    "studentized_ratio",
    "wilks_p",
]

_MIN_RESIDUAL_FRACTION = 1e-6
"""Lower bound of 1 - leverage, and of variances relative to the largest, as divisors."""
_MIN_SQUARES = 1e-20
"""Lower bound of the sum of squares of standardized coordinates, for constant ones."""


@dataclass(frozen=True, slots=True, eq=False)
class EqualizedGroups:
    """Values scaled to one dispersion in all groups. Arrays are read-only.

    Attributes
    ----------
    values : (M, P) array
        Differences from the weighted mean of the groups, divided by the dispersion of the subject's group.
    dispersions : (K,) array
        Dispersions of the groups, relative to their geometric mean.
    mean_spread : float
        Standard deviation of the mean that centring removed, relative to that of one subject.
    """

    values: FloatArray
    dispersions: FloatArray
    mean_spread: float

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in ("values", "dispersions"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.float64))


def equalize_groups(values: FloatArray, design: Design, *, scaled: bool = True) -> EqualizedGroups | None:
    """Scale groups to one dispersion; None if the design has covariates, a variable or pairs.

    Parameters
    ----------
    values : (M, P) array
        Data with the intercept regressed out.
    design : Design
        Design with the observed labels.
    scaled : bool
        Whether to scale; otherwise dispersions are assumed equal.
    """
    memberships = _memberships(observed_design(design), design)
    if memberships is None:
        return None
    members = memberships[0]
    if not scaled:
        return EqualizedGroups(values, np.ones(len(members)), 0.0)
    counts = members.sum(axis=1)
    means = members @ values / counts[:, None]
    rest = values - members.T @ means
    variances = members @ np.square(rest).sum(axis=1) / np.maximum(counts - 1.0, 1.0)
    variances = np.maximum(variances, _MIN_RESIDUAL_FRACTION * variances.max())
    if not variances.max() > 0.0:
        return EqualizedGroups(values, np.ones(len(members)), 0.0)
    dispersions = np.sqrt(variances / np.exp(np.log(variances).mean()))
    precisions = counts / np.square(dispersions)
    centre = precisions @ means / precisions.sum()
    mean_spread = (counts / dispersions).sum() / counts.sum() / np.sqrt(precisions.sum())
    return EqualizedGroups(
        (values - centre) / (members.T @ dispersions)[:, None], dispersions, float(mean_spread)
    )


@dataclass(frozen=True, slots=True, eq=False)
class EqualizedSubjects:
    """Values scaled to one dispersion, adjusted for covariates or along a variable. Arrays are read-only.

    Attributes
    ----------
    values : (M, P) array
        Differences from the weighted fit of the nuisance columns, divided by the dispersion of the subject.
    exponents : (q + d,) array
        Coefficients of nuisance and tested basis in the logarithm of the dispersion.
    mean_spread : float
        See `EqualizedGroups`; 0 along a variable.
    """

    values: FloatArray
    exponents: FloatArray
    mean_spread: float

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in ("values", "exponents"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.float64))

    def dispersions(self, columns: FloatArray) -> FloatArray:
        """Return the dispersions of the subjects (c, M) for permuted columns (c, M, q + d)."""
        dispersions: FloatArray = np.exp(columns @ self.exponents)
        return dispersions

    def random_mean(self, values: FloatArray, permuted: PermutedDesigns) -> FloatArray:
        """Return random means (c, k) to add to values (M, k) in place of those that the fit removed."""
        if permuted.signs is None or not self.mean_spread:
            return np.zeros((len(permuted.tested), values.shape[1]))
        return _random_mean(self.mean_spread, permuted.signs, values)

    def restored(self, values: FloatArray, permuted: PermutedDesigns) -> FloatArray:
        """Return equalized values (M, k) with permuted dispersions, nuisance regressed out, (c, M, k)."""
        columns = design_columns(permuted)
        nuisance = columns[:, :, : columns.shape[2] - permuted.tested.shape[2]]
        whole = values + self.random_mean(values, permuted)[:, None, :]
        whole = whole * self.dispersions(columns)[:, :, None]
        whole -= nuisance @ (nuisance.swapaxes(1, 2) @ whole)
        return whole


def equalize_subjects(
    values: FloatArray, design: Design, *, variables: bool = False
) -> EqualizedSubjects | None:
    """Scale subjects to one dispersion; None for pairs, and for a variable unless requested.

    Groups have the dispersion of their residuals. Along a variable its logarithm is a linear function.

    Parameters
    ----------
    values : (M, P) array
        Data with the nuisance columns regressed out.
    design : Design
        Design with the observed labels or values.
    variables : bool
        Whether to scale along a variable. Whole shapes need this; for a single number the statistic alone
        controls its level.
    """
    kinds, of_kind = np.unique(design.given, axis=0, return_inverse=True)
    of_groups = len(kinds) == design.given.shape[1] + 1
    if design.exchange is Exchange.SIGNS or not (of_groups or variables):
        return None
    columns = design_columns(observed_design(design))[0]
    rest = values - columns @ (columns.T @ values)
    left = np.maximum(1.0 - np.square(columns).sum(axis=1), _MIN_RESIDUAL_FRACTION)
    squares = np.square(rest).sum(axis=1) / left
    if not squares.max() > 0.0:
        return None
    floor = _MIN_RESIDUAL_FRACTION * squares.max()
    if of_groups:
        members = np.eye(len(kinds))[:, of_kind.reshape(-1)]
        variances = members.T @ (members @ squares / members.sum(axis=1))
        logarithms = 0.5 * np.log(np.maximum(variances, floor))
    else:
        along = np.column_stack([np.ones(len(values)), design.given])
        half = 0.5 * np.log(np.maximum(squares, floor))
        logarithms = along @ np.linalg.lstsq(along, half, rcond=None)[0]
    logarithms -= logarithms.mean()
    scale = np.exp(logarithms)[:, None]
    fitted = np.linalg.qr(design.nuisance / scale)[0]
    equal = values / scale
    equal -= fitted @ (fitted.T @ equal)
    # Along a variable the error of the fitted dispersions already widens the null distribution.
    spread = float(np.linalg.norm(fitted.sum(axis=0))) / len(values) if of_groups else 0.0
    return EqualizedSubjects(equal, columns.T @ logarithms, spread)


class WelchStatistic:
    """Welch's F of groups at every point of a surface, for any permutation of a design of groups.

    Parameters
    ----------
    coordinates : (v, M, N) array
        Standardized coordinates of the equalized groups, with similar variances within a group.
    varying : (N,) array
        Number of the v coordinates that vary at each point, at least 1.
    groups : EqualizedGroups
        The groups whose dispersions are restored.
    design : Design
        The design whose rows are exchanged.
    """

    def __init__(
        self, coordinates: FloatArray, varying: FloatArray, groups: EqualizedGroups, design: Design
    ) -> None:
        self._coordinates, self._varying, self._design = coordinates, varying, design
        self._squares = np.square(coordinates).sum(axis=0)
        self._dispersions = groups.dispersions[:, None]
        self._mean_spread = groups.mean_spread

    @property
    def restores_mean(self) -> bool:
        """Whether F depends on the mean that is added to permuted values."""
        return self._mean_spread > 0.0 and float(np.ptp(self._dispersions)) > 0.0

    def f(self, permuted: PermutedDesigns) -> tuple[FloatArray, FloatArray]:
        """Return F and the degrees of freedom of its denominator (Welch 1951), (c, N) each."""
        memberships = _memberships(permuted, self._design)
        if memberships is None:
            raise ValueError("the design is not one of groups alone")
        groups = memberships.shape[1]
        counts = memberships.sum(axis=2)[:, :, None]
        free = np.maximum(counts - 1.0, 1.0)
        squares = _group_sums(memberships, self._squares)
        means = np.stack([_group_sums(memberships, axis) for axis in self._coordinates]) / counts
        within = np.maximum(squares - counts * np.square(means).sum(axis=0), _MIN_RESIDUAL_FRACTION * squares)
        within = np.maximum(within * np.square(self._dispersions), _MIN_SQUARES)
        if permuted.signs is not None and self._mean_spread:
            drawn = (_random_mean(self._mean_spread, permuted.signs, axis) for axis in self._coordinates)
            means += np.stack([mean[:, None] for mean in drawn])
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

    def deviate(self, permuted: PermutedDesigns) -> FloatArray:
        """Return the normal deviate of the same probability as F, (c, N)."""
        ratio, dof = self.f(permuted)
        across = self._varying * float(self._design.tested.shape[1])
        of_numerator, of_denominator = 2.0 / (9.0 * across), 2.0 / (9.0 * dof)
        root = np.cbrt(ratio)
        deviate: FloatArray = ((1.0 - of_denominator) * root - (1.0 - of_numerator)) / np.sqrt(
            of_denominator * np.square(root) + of_numerator
        )
        return deviate


def _random_mean(spread: float, signs: FloatArray, values: FloatArray) -> FloatArray:
    """Return random means (c, N) of values (M, N), whose covariance over the surface is that of the data."""
    drawn: FloatArray = spread / np.sqrt(signs.shape[1]) * signs @ values
    return drawn


def _group_sums(memberships: FloatArray, values: FloatArray) -> FloatArray:
    """Return the sums (c, K, N) of values (M, N) over the members (c, K, M) of each group."""
    draws, groups, subjects = memberships.shape
    others = memberships[:, 1:].reshape(draws * (groups - 1), subjects) @ values
    others = others.reshape(draws, groups - 1, -1)
    first = values.sum(axis=0) - others.sum(axis=1)
    return np.concatenate([first[:, None], others], axis=1)


def _memberships(permuted: PermutedDesigns, design: Design) -> FloatArray | None:
    """Return the group indicators (c, K, M) of 0 and 1; None if the design contains more than groups.

    The intercept and the tested columns of K groups span the groups' indicators.
    """
    if design.exchange is Exchange.SIGNS or design.covariates.shape[1]:
        return None
    rows = np.unique(np.round(design.tested, 10), axis=0)
    if len(rows) != design.tested.shape[1] + 1:
        return None
    intercept = len(design.tested) ** -0.5
    solved = np.linalg.inv(np.column_stack([np.full(len(rows), intercept), rows]))
    memberships = np.round(intercept * solved[0] + permuted.tested @ solved[1:])
    return np.ascontiguousarray(memberships.swapaxes(1, 2))


def observed_design(design: Design) -> PermutedDesigns:
    """Return the design itself, as the identity permutation."""
    return PermutedDesigns(design.tested[None], design.covariates[None])


def design_columns(permuted: PermutedDesigns) -> FloatArray:
    """Return all columns of permuted designs with an intercept, (c, M, q + d), the tested ones last."""
    draws, subjects, _ = permuted.tested.shape
    intercept = np.full((draws, subjects, 1), subjects**-0.5)
    return np.concatenate([intercept, permuted.covariates, permuted.tested], axis=2)


def null_weights(permuted: PermutedDesigns, design: Design) -> FloatArray:
    """Return the weight of each subject's squared residual in the expected sum of squares, shape (c, M).

    This is the leverage of the tested columns divided by 1 minus the leverage of all columns.
    """
    tested = np.square(permuted.tested).sum(axis=2)
    leverage = tested + np.square(permuted.covariates).sum(axis=2)
    if design.nuisance.shape[1]:
        leverage = leverage + 1.0 / len(design.tested)
    weights: FloatArray = tested / np.maximum(1.0 - leverage, _MIN_RESIDUAL_FRACTION)
    return weights


def studentized_ratio(scores: FloatArray, permuted: PermutedDesigns, design: Design) -> FloatArray:
    """Return the ratio of tested to expected sum of squares of each permutation, shape (c,).

    Parameters
    ----------
    scores : (M, k) or (c, M, k) array
        Standardized coordinates with the (permuted) nuisance columns regressed out.
    permuted : PermutedDesigns
        Permutations of c designs.
    design : Design
        The design that was permuted.
    """
    projected = np.swapaxes(permuted.tested, 1, 2) @ scores
    rest = np.square(scores - permuted.tested @ projected).sum(axis=2)
    expected = (null_weights(permuted, design) * rest).sum(axis=1)
    explained = np.square(projected).sum(axis=(1, 2))
    ratio: FloatArray = explained / np.maximum(expected, np.finfo(float).tiny)
    return ratio


def hotelling(wilks: FloatArray | float, error_dof: int) -> FloatArray:
    """Return Hotelling's T² of one tested column from Wilks' lambda (1 - R²)."""
    lamb = np.asarray(wilks, dtype=np.float64)
    square: FloatArray = error_dof * (1.0 - lamb) / lamb
    return square


def rao_f(
    wilks: FloatArray, variables: IntArray | int, columns: int, error_dof: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return F and its two degrees of freedom (Rao 1951); exact for up to two variables or two columns.

    Parameters
    ----------
    wilks : (...) array
        Wilks' lambda.
    variables : int or (...) array
        Number of variables, at least 1.
    columns : int
        Number of tested columns.
    error_dof : int
        Degrees of freedom of the error.
    """
    p, q = np.asarray(variables, dtype=np.float64), float(columns)
    squares = p**2 + q**2 - 5.0
    ratio = (p**2 * q**2 - 4.0) / np.where(squares > 0.0, squares, 1.0)
    root = np.where(np.minimum(p, q) == 1.0, 1.0, np.sqrt(np.maximum(ratio, 0.0)))
    between = p * q
    within = root * (error_dof - (p - q + 1.0) / 2.0) - between / 2.0 + 1.0
    power = np.asarray(wilks) ** (1.0 / root)
    f: FloatArray = (1.0 - power) / np.maximum(power, 1e-290) * within / between
    return f, np.broadcast_to(between, f.shape), np.broadcast_to(within, f.shape)


def wilks_p(
    wilks: FloatArray, variables: IntArray | int, columns: int, error_dof: int, *, log: bool = False
) -> FloatArray:
    """Return the p-value of Wilks' lambda by Rao's F.

    Parameters
    ----------
    wilks, variables, columns, error_dof
        See `rao_f`.
    log : bool
        Whether to return the natural logarithm of p, which does not underflow.

    Returns
    -------
    array
        p-values in the shape of `wilks`.
    """
    f, between, within = rao_f(wilks, variables, columns, error_dof)
    tail = stats.f.logsf if log else stats.f.sf
    return np.asarray(tail(f, between, within), np.float64)


def restores_mean(welch: WelchStatistic | None, equalized: EqualizedSubjects | None) -> bool:
    """Return whether a statistic depends on the mean that is added to permuted values (see `mean_draws`)."""
    if welch is not None:
        return welch.restores_mean
    return equalized is not None and equalized.mean_spread > 0.0
