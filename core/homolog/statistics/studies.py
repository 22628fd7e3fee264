"""The kinds of studies: two groups, several groups, a continuous variable, paired subjects."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from homolog.arrays import BoolArray, FloatArray, IntArray
from homolog.errors import InputError
from homolog.progress import Tick, no_tick, part_of
from homolog.statistics.anova import holm
from homolog.statistics.checks import checked_particles, refuse_duplicates
from homolog.statistics.comparison import DEFAULT, Comparison, Options, prepare_shapes, run_comparison
from homolog.statistics.design import group_design, paired_design, regression_design
from homolog.statistics.discriminant import discriminant
from homolog.statistics.procrustes import rms_radii

__all__ = ["compare_groups", "compare_pairs", "compare_two_groups", "pair_members", "regress"]


def compare_two_groups(
    particles: FloatArray,
    groups: Sequence[str],
    between: tuple[str, str],
    *,
    covariates: FloatArray | None = None,
    options: Options = DEFAULT,
    names: Sequence[str] | None = None,
    tick: Tick = no_tick,
) -> Comparison:
    """Compare two groups; differences are the second minus the first.

    Parameters
    ----------
    particles : (M, N, 3) array_like
        Aligned positions [mm]; subjects of other groups are excluded.
    groups : sequence of str
        Group of each subject.
    between : (str, str)
        The two groups.
    covariates : (M, c) array, optional
        Columns to adjust for, from `homolog.statistics.design.covariate_columns`.
    options : Options
        Options of the computation.
    names : sequence of str, optional
        Subject names, for messages.
    tick : Tick
        Progress and cancellation.

    Returns
    -------
    Comparison

    Raises
    ------
    InputError
        If a group is too small, subjects are duplicated, or covariates are confounded with the group.
    """
    shapes = checked_particles(particles, names)
    labels = np.asarray(groups)
    subjects = np.flatnonzero(np.isin(labels, between))
    _refuse_duplicates_among(shapes, subjects, names)
    own = None if covariates is None else covariates[subjects]
    design = group_design(list(labels[subjects]), between, own)
    title = f"{between[1]} - {between[0]}"
    counts = {item: int(np.count_nonzero(labels == item)) for item in between}
    members = {item: labels[subjects] == item for item in between}
    done = run_comparison(
        shapes, subjects, design, title, counts, options, part_of(tick, 0.0, 0.6), members=members
    )
    second, rest = labels == between[1], done.without_outliers
    if rest is not None:
        rest = _separated(rest, shapes, second, covariates, options, part_of(tick, 0.8, 1.0))
    done = _separated(done, shapes, second, covariates, options, part_of(tick, 0.6, 0.8))
    return replace(done, without_outliers=rest)


def _separated(
    done: Comparison,
    shapes: FloatArray,
    second: BoolArray,
    covariates: FloatArray | None,
    options: Options,
    tick: Tick,
) -> Comparison:
    """Return a comparison of two groups with its discriminant, if a mode is retained."""
    if done.test.modes == 0:
        return done
    separation = discriminant(
        prepare_shapes(shapes[done.subjects], options),
        second[done.subjects],
        done.test.modes,
        covariates=None if covariates is None else covariates[done.subjects],
        bootstraps=options.bootstraps,
        permutations=min(options.classifications, options.permutations),
        seed=options.seed,
        tick=tick,
    )
    accuracy, auc = (
        None if p is None else min(options.answers * p, 1.0)
        for p in (separation.accuracy.p, separation.auc.p)
    )
    return replace(done, discriminant=separation, accuracy_p_adjusted=accuracy, auc_p_adjusted=auc)


def compare_groups(
    particles: FloatArray,
    groups: Sequence[str],
    order: Sequence[str],
    *,
    covariates: FloatArray | None = None,
    options: Options = DEFAULT,
    names: Sequence[str] | None = None,
    tick: Tick = no_tick,
) -> tuple[Comparison, tuple[Comparison, ...]]:
    """Test for any difference between three or more groups, then compare pairs of them.

    Parameters
    ----------
    particles, groups, covariates, options, names, tick
        As in `compare_two_groups`.
    order : sequence of str
        The groups in order.

    Returns
    -------
    Comparison
        The multivariate analysis of variance in the modes; effects are differences from the first group.
    tuple of Comparison
        The pairs; their adjusted p-values and `p_fwe` are corrected over these (Holm).
    """
    shapes = checked_particles(particles, names)
    labels = np.asarray(groups)
    subjects = np.flatnonzero(np.isin(labels, list(order)))
    _refuse_duplicates_among(shapes, subjects, names)
    own = None if covariates is None else covariates[subjects]
    design = group_design(list(labels[subjects]), order, own)
    counts = {item: int(np.count_nonzero(labels == item)) for item in order}
    pairs = list(combinations(order, 2))
    share = 1.0 / (len(pairs) + 1)
    title = ", ".join(order)
    members = {item: labels[subjects] == item for item in order}
    overall = run_comparison(
        shapes, subjects, design, title, counts, options, part_of(tick, 0.0, share), members=members
    )
    each = []
    for index, pair in enumerate(pairs):
        tick_of_pair = part_of(tick, (index + 1) * share, (index + 2) * share)
        columns = _independent(covariates, np.isin(labels, pair))
        each.append(
            compare_two_groups(
                shapes, groups, pair, covariates=columns, options=options, names=names, tick=tick_of_pair
            )
        )
    rests = _corrected([pair.without_outliers or pair for pair in each])
    return overall, tuple(
        replace(pair, without_outliers=None if pair.without_outliers is None else rest)
        for pair, rest in zip(_corrected(each), rests, strict=True)
    )


def _independent(covariates: FloatArray | None, members: BoolArray) -> FloatArray | None:
    """Omit columns that are constant among the members, or combinations of preceding columns."""
    if covariates is None:
        return None
    kept, base = [], np.ones((np.count_nonzero(members), 1))
    for index, column in enumerate(covariates[members].T):
        wider = np.column_stack([base, column])
        if np.linalg.matrix_rank(wider) > len(base.T):
            kept.append(index)
            base = wider
    return covariates[:, kept] if kept else None


def _corrected(pairs: Sequence[Comparison]) -> tuple[Comparison, ...]:
    """Correct all p-values of the pairs for their number (Holm 1979)."""
    whole = holm(np.array([pair.p_adjusted for pair in pairs]))
    surface = _holm_of_surfaces([pair.p_fwe for pair in pairs])
    size = _holm_of_known([pair.size_p_adjusted for pair in pairs])
    accuracy = _holm_of_known([pair.accuracy_p_adjusted for pair in pairs])
    auc = _holm_of_known([pair.auc_p_adjusted for pair in pairs])
    return tuple(
        replace(
            pair,
            p_adjusted=float(whole[index]),
            p_fwe=surface[index],
            size_p_adjusted=size[index],
            accuracy_p_adjusted=accuracy[index],
            auc_p_adjusted=auc[index],
        )
        for index, pair in enumerate(pairs)
    )


def _holm_of_known(values: Sequence[float | None]) -> list[float | None]:
    """Correct p-values for their number; pairs without a p-value count as tests, too."""
    adjusted = holm(np.array([1.0 if value is None else value for value in values])).tolist()
    return [None if value is None else p for value, p in zip(values, adjusted, strict=True)]


def _holm_of_surfaces(surfaces: Sequence[FloatArray]) -> list[FloatArray]:
    """Correct p-values that hold over each of several surfaces for the number of surfaces.

    Holm's (1979) procedure is applied to surfaces in the order of their smallest p.
    """
    adjusted: list[FloatArray] = [np.zeros(0)] * len(surfaces)
    least = 0.0
    for rank, index in enumerate(np.argsort([item.min() for item in surfaces], kind="stable")):
        family = np.minimum(surfaces[index] * (len(surfaces) - rank), 1.0)
        adjusted[index] = np.maximum(family, least)
        least = float(adjusted[index].min())
    return adjusted


def regress(
    particles: FloatArray,
    values: FloatArray,
    title: str,
    *,
    covariates: FloatArray | None = None,
    options: Options = DEFAULT,
    names: Sequence[str] | None = None,
    tick: Tick = no_tick,
) -> Comparison:
    """Test for a linear effect of a continuous variable; effects are per unit of it.

    Parameters are those of `compare_two_groups`, with the variable's values (M,) and name.
    """
    shapes = checked_particles(particles, names)
    subjects = np.arange(len(shapes))
    _refuse_duplicates_among(shapes, subjects, names)
    design = regression_design(values, covariates)
    return run_comparison(shapes, subjects, design, title, {"all": len(shapes)}, options, tick)


def compare_pairs(
    particles: FloatArray,
    first: IntArray,
    second: IntArray,
    title: str,
    *,
    options: Options = DEFAULT,
    names: Sequence[str] | None = None,
    tick: Tick = no_tick,
) -> Comparison:
    """Test whether the second of each pair differs from its first, such as after from before.

    Parameters
    ----------
    particles : (M, N, 3) array_like
        Aligned positions [mm].
    first, second : (P,) int arrays
        Indices of the two members of each pair.
    title : str
        Title, such as ``"after - before"``.
    options, names, tick
        As in `compare_two_groups`.

    Returns
    -------
    Comparison

    Raises
    ------
    InputError
        If a subject is in more than one pair, or both members of a pair have the same shape.
    """
    shapes = checked_particles(particles, names)
    members = np.concatenate([first, second])
    if len(first) != len(second) or len(set(members.tolist())) < len(members):
        raise InputError("pairs: each subject may be in one pair only; check the column that names the pairs")
    _refuse_duplicates_among(shapes, members, names)
    design = paired_design(len(first))
    both = prepare_shapes(shapes[members], options)
    return run_comparison(
        shapes,
        first,
        design,
        title,
        {"pairs": len(first)},
        options,
        tick,
        mean=both[: len(first)].mean(axis=0),
        data=both[len(first) :] - both[: len(first)],
        size=rms_radii(shapes[second]) - rms_radii(shapes[first]),
    )


def pair_members(
    pairs: Sequence[str],
    labels: Sequence[str],
    between: tuple[str, str],
    names: Sequence[str] | None = None,
    *,
    column: str = "",
) -> tuple[IntArray, IntArray]:
    """Return the indices of the first and the second member of each pair, (P,) each.

    Parameters
    ----------
    pairs : sequence of str
        The pair of each of the M subjects; empty for none.
    labels : sequence of str
        The group of each.
    between : (str, str)
        The groups of the first and the second member of each pair.
    names : sequence of str, optional
        Subject names, for messages.
    column : str
        Column that identifies the pairs, for messages.

    Raises
    ------
    InputError
        If a pair has two subjects of one group or only one subject, or there is only one pair.
    """
    by_pair: dict[str, dict[str, int]] = {}
    for index, (pair, label) in enumerate(zip(pairs, labels, strict=True)):
        if label in between and pair:
            if label in by_pair.setdefault(pair, {}):
                who = f"subject {index + 1}" if names is None else names[index]
                raise InputError(f"{who}: pair {pair!r} has two subjects that are {label!r}")
            by_pair[pair][label] = index
    alone = [pair for pair, both in by_pair.items() if len(both) < 2]
    if alone:
        raise InputError(
            f"pair {alone[0]!r} has only one subject; add the other one, or exclude such pairs "
            "(complete cases)"
        )
    if len(by_pair) < 2:
        where = f"column {column!r} names" if column else "there is"
        raise InputError(f"a paired comparison needs at least two pairs; {where} {len(by_pair)}")
    first, second = (np.array([both[label] for both in by_pair.values()], np.int64) for label in between)
    return first, second


def _refuse_duplicates_among(shapes: FloatArray, subjects: IntArray, names: Sequence[str] | None) -> None:
    refuse_duplicates(shapes[subjects], None if names is None else [names[subject] for subject in subjects])
