"""Procrustes analysis of variance of a design, differences of its means and slopes, and allometry."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations as ordered_pairs

import numpy as np

from homolog.arrays import FloatArray, frozen
from homolog.errors import InputError
from homolog.progress import Tick, no_tick, part_of
from homolog.statistics.cautions import LEVEL, p_text
from homolog.statistics.design import Design, Hypothesis, Squares
from homolog.statistics.effects import Effect, corrected_distance, size_effect
from homolog.statistics.parallel import parallel_analysis
from homolog.statistics.randomization import Randomization, RandomizationTest
from homolog.statistics.shape_model import leading_scores
from homolog.statistics.wilks import hotelling

__all__ = [
    "Allometry",
    "AnovaRow",
    "Difference",
    "allometry",
    "differences",
    "holm",
    "mahalanobis",
    "mode_scores",
    "procrustes_anova",
    "unequal_slopes",
]


@dataclass(frozen=True, slots=True)
class AnovaRow:
    """A row of the analysis of variance.

    Attributes
    ----------
    term : str
        Name of the term; ``"strata"``, ``"residuals"`` and ``"total"`` for the others.
    dof : int
        Degrees of freedom.
    squares, mean_square : float
        Sum of squares, and the same per degree of freedom, in squared units of the data.
    r_squared : float
        Share of the total sum of squares.
    f : float or None
        Mean square over that of the residuals, as published tables have it.
    z, p : float or None
        Effect size and p-value of residual randomization (`homolog.statistics.randomization`), whose
        statistic allows for unequal covariances and for repeated measures.
    """

    term: str
    dof: int
    squares: float
    mean_square: float
    r_squared: float
    f: float | None = None
    z: float | None = None
    p: float | None = None


def procrustes_anova(
    data: FloatArray,
    design: Design,
    *,
    squares: Squares = Squares.MARGINAL,
    tested: Mapping[str, RandomizationTest] | None = None,
    permutations: int = 10_000,
    seed: int = 0,
    tick: Tick = no_tick,
) -> tuple[AnovaRow, ...]:
    """Return the analysis of variance of a design: its terms, residuals and total.

    Parameters
    ----------
    data : (M, N, 3) or (M, P) array
        Aligned shapes [mm], or scores from `mode_scores`.
    design : Design
        Its formula.
    squares : Squares
        Type of the sums of squares.
    tested : mapping of str to RandomizationTest, optional
        Tests of the terms, if they are known.
    permutations, seed : int
        Number of randomizations of each term, and their seed.
    tick : Tick
        Progress and cancellation.
    """
    values = data.reshape(len(data), -1)
    total = float(np.square(values - values.mean(axis=0)).sum())
    columns = design.matrix
    basis = np.linalg.qr(columns)[0]
    rest = float(np.square(values - basis @ (basis.T @ values)).sum())
    dof = len(values) - columns.shape[1]
    left = rest / dof

    def row(term: str, own: int, sum_of_squares: float, *tested: float) -> AnovaRow:
        share = sum_of_squares / total if total > 0.0 else 0.0
        return AnovaRow(term, own, sum_of_squares, sum_of_squares / own, share, *tested)

    rows = []
    if design.strata is not None:
        own = np.eye(int(design.strata.max()) + 1)[design.strata]
        means = own @ np.linalg.lstsq(own, values, rcond=None)[0]
        rows.append(row("strata", own.shape[1] - 1, float(np.square(means - values.mean(axis=0)).sum())))
    for number, term in enumerate(design.terms):
        hypothesis = design.hypothesis(term.name, squares)
        explained = float(np.square(hypothesis.tested.T @ values).sum())
        part = part_of(tick, number / len(design.terms), (number + 1) / len(design.terms))
        test = (tested or {}).get(term.name) or Randomization(
            hypothesis, values, draws=permutations, seed=seed, tick=part
        ).ratio(values)
        f = explained / term.dof / left if left > 0.0 else float("inf")
        rows.append(row(term.name, term.dof, explained, f, test.z, test.p))
    return (*rows, row("residuals", dof, rest), row("total", len(values) - 1, total))


def mode_scores(shapes: FloatArray, design: Design, *, modes: int | None = None, seed: int = 0) -> FloatArray:
    """Return the scores (M, k) of shapes in the retained modes, each with a standard deviation of 1.

    Parameters
    ----------
    shapes : (M, N, 3) array
        Aligned shapes [mm].
    design : Design
        Strata are removed before modes are computed; terms are not, so that modes don't depend on them.
    modes : int, optional
        Number of modes; by parallel analysis if not given.
    seed : int
        Seed of the parallel analysis.

    Raises
    ------
    InputError
        If no mode is retained.
    """
    rows = shapes.reshape(len(shapes), -1)
    base = np.ones((len(rows), 1))
    if design.strata is not None:
        base = np.eye(int(design.strata.max()) + 1)[design.strata]
    nuisance = np.linalg.qr(base)[0]
    rest = rows - nuisance @ (nuisance.T @ rows)
    kept = parallel_analysis(rest, nuisance=nuisance, seed=seed).n_retained if modes is None else modes
    if kept < 1:
        raise InputError("no mode is retained: the shapes can't be told from noise; give the number of modes")
    scores = leading_scores(rest, kept)[0]
    scaled: FloatArray = scores / scores.std(axis=0, ddof=1)
    return scaled


@dataclass(frozen=True, slots=True, eq=False)
class Difference:
    """A difference of adjusted means or slopes. Arrays are read-only.

    Attributes
    ----------
    name : str
        Such as ``"HCM - NOR"``, or ``"age, HCM - NOR"`` for slopes.
    effect : (P,) array
        The difference in each variable: of coordinates in mm, of slopes per unit.
    length : float
        Root mean square of the effect over the particles [mm]; of scores over the modes.
    distance : Effect or None
        Mahalanobis distance in the modes, corrected for bias, with its 90 % interval; None without scores
        or with too few degrees of freedom.
    size : Effect or None
        The same of size, with its 95 % interval and p [mm]; None if size is a column of the design.
    z, p : float
        Effect size and p-value of residual randomization on all variables.
    p_adjusted : float
        p corrected for the number of differences (Holm 1979).
    """

    name: str
    effect: FloatArray
    length: float
    distance: Effect | None
    size: Effect | None
    z: float
    p: float
    p_adjusted: float

    def __post_init__(self) -> None:
        """Freeze the array."""
        object.__setattr__(self, "effect", frozen(self.effect, np.float64))


def differences(
    shapes: FloatArray,
    scores: FloatArray | None,
    size: FloatArray,
    hypotheses: Sequence[Hypothesis],
    *,
    permutations: int = 10_000,
    seed: int = 0,
    tick: Tick = no_tick,
) -> tuple[Difference, ...]:
    """Test differences of means or slopes.

    Parameters
    ----------
    shapes : (M, N, 3) array
        Aligned shapes [mm].
    scores : (M, k) array or None
        Their scores in the retained modes, from `mode_scores`; without them no distance is told.
    size : (M,) array
        Their sizes [mm].
    hypotheses : sequence of Hypothesis
        From `Design.differences`, `Design.slopes` or `Design.slope_differences`.
    permutations, seed, tick
        As in `procrustes_anova`.
    """
    rows = shapes.reshape(len(shapes), -1)
    statistic = []
    for number, hypothesis in enumerate(hypotheses):
        part = part_of(tick, number / len(hypotheses), (number + 1) / len(hypotheses))
        test = Randomization(hypothesis, rows, draws=permutations, seed=seed, tick=part).ratio(rows)
        effect = hypothesis.coefficients(rows)[0]
        length = float(np.sqrt(np.square(effect).sum() / shapes.shape[1]))
        distance = None if scores is None else mahalanobis(scores, hypothesis)
        larger = size_effect(size, hypothesis, shapes=rows, permutations=permutations, seed=seed)
        statistic.append((hypothesis.name, effect, length, distance, larger, test.z, test.p))
    adjusted = holm(np.array([item[-1] for item in statistic]))
    return tuple(Difference(*item, float(p)) for item, p in zip(statistic, adjusted, strict=True))


def mahalanobis(scores: FloatArray, hypothesis: Hypothesis) -> Effect | None:
    """Return the length of an effect in standard deviations within groups; see `Difference.distance`."""
    rest = hypothesis.residuals(scores)
    along = hypothesis.tested[:, 0] @ rest
    error = rest - np.outer(hypothesis.tested[:, 0], along)
    if hypothesis.error_dof <= scores.shape[1]:
        return None
    square = float(along @ np.linalg.solve(error.T @ error, along))
    t_squared = float(hotelling(1.0 / (1.0 + square), hypothesis.error_dof))
    scale = float(np.square(hypothesis.columns).sum())
    return corrected_distance(t_squared, scores.shape[1], hypothesis.error_dof, scale)


def holm(p: FloatArray) -> FloatArray:
    """Return p-values adjusted for their number by the method of Holm (1979)."""
    order = np.argsort(p)
    raised = np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1))
    adjusted = np.empty(len(p))
    adjusted[order] = np.minimum(raised, 1.0)
    return adjusted


def unequal_slopes(
    shapes: FloatArray,
    design: Design,
    factors: Sequence[str] | None = None,
    *,
    permutations: int = 10_000,
    seed: int = 0,
    tick: Tick = no_tick,
) -> list[str]:
    """Return a note for each number whose slope differs between levels, although the design has one slope.

    Parameters
    ----------
    shapes : (M, N, 3) array
        Aligned shapes [mm].
    design : Design
        The slope of each of its numbers is compared between the levels of each category that has no
        interaction with it.
    factors : sequence of str, optional
        Some of these categories.
    permutations, seed, tick
        As in `procrustes_anova`.
    """
    rows = shapes.reshape(len(shapes), -1)
    joined = {pair for term in design.terms for pair in ordered_pairs(term.factors, 2)}
    notes = []
    for number, factor in (
        (number, factor) for number in design.numbers for factor in factors or design.levels
    ):
        if (number, factor) in joined:
            continue
        try:
            hypothesis = design.common_slope(number, factor)
        except InputError:
            notes.append(
                f"Whether {number} has one slope in all of {factor} can't be tested: too few subjects."
            )
            continue
        test = Randomization(hypothesis, rows, draws=permutations, seed=seed, tick=tick).ratio(rows)
        if test.p <= LEVEL:
            notes.append(
                f"The slope of {number} differs between levels of {factor} ({p_text(test.p, permutations)}): "
                f"adjusted means differ otherwise elsewhere along {number}; ask the formula with "
                f"{factor}:{number}."
            )
    return notes


@dataclass(frozen=True, slots=True, eq=False)
class Allometry:
    """How shape changes along a number, such as size, for a plot. Arrays are read-only.

    Attributes
    ----------
    slope : (P,) array
        Mean change of shape per unit of the number [mm].
    scores : (M,) array
        Regression score of each row: its shape along the slope (Drake and Klingenberg 2008), as root mean
        square displacement of the particles [mm].
    predicted : (M,) array
        First principal component of the shapes that the design predicts (Adams and Nistri 2010) [mm]; against
        the number, rows of one group lie on a line, parallel if slopes are common.
    """

    slope: FloatArray
    scores: FloatArray
    predicted: FloatArray

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in ("slope", "scores", "predicted"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.float64))


def allometry(shapes: FloatArray, design: Design, number: str) -> Allometry:
    """Return regression scores and predicted shapes along a number of the design.

    Parameters
    ----------
    shapes : (M, N, 3) array
        Aligned shapes [mm].
    design : Design
        With the number, and the interaction with the groups whose slopes may differ.
    number : str
        Such as ``"size"``, the logarithm or the value.
    """
    rows = shapes.reshape(len(shapes), -1)
    rows = rows - rows.mean(axis=0)
    (hypothesis,) = design.slopes(number)
    slope = hypothesis.coefficients(rows)[0]
    basis = np.linalg.qr(design.matrix)[0]
    fitted = basis @ (basis.T @ rows)
    predicted = leading_scores(fitted - fitted.mean(axis=0), 1)[0][:, 0]
    if np.dot(predicted, design.numbers[number] - design.numbers[number].mean()) < 0.0:
        predicted = -predicted
    along = rows @ slope / max(float(np.linalg.norm(slope)), np.finfo(float).tiny)
    return Allometry(slope, along / np.sqrt(shapes.shape[1]), predicted / np.sqrt(shapes.shape[1]))
