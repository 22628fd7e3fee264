"""Comparison of groups, and regression on a number, in one call."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Literal, overload

import numpy as np

from homolog.api.comparison_arguments import (
    Covariates,
    check_options,
    check_values,
    columns_of,
    incomplete,
    notes_on,
    pairs_of,
    table_of,
    unpaired,
)
from homolog.arrays import Array, ArrayLike, FloatArray, IntArray
from homolog.cohort.column_types import CATEGORY
from homolog.errors import InputError
from homolog.progress import Tick, part_of, tick_of
from homolog.statistics.checks import checked_particles
from homolog.statistics.comparison import Comparison, Options
from homolog.statistics.covariates import with_covariate_effects, with_unadjusted
from homolog.statistics.design import is_missing, numbers
from homolog.statistics.procrustes import Alignment
from homolog.statistics.studies import compare_groups as compare_several
from homolog.statistics.studies import compare_pairs, compare_two_groups
from homolog.statistics.studies import regress as regress_shapes

__all__ = ["compare_groups", "regress"]

_Alignment = Literal["rigid", "similarity", "as-it-lies"]
_BOTH: tuple[_Alignment, ...] = ("rigid", "similarity")
"""Form and shape, as on the command line and in the window."""


@overload
def compare_groups(
    particles: ArrayLike,
    groups: Sequence[str | None],
    between: Sequence[str] | None = None,
    *,
    pairs: Sequence[str | None] | None = None,
    covariates: Covariates | None = None,
    complete_cases: bool = False,
    alignment: _Alignment,
    modes: int | None = None,
    permutations: int = 10_000,
    null_repeats: int = 0,
    seed: int = 0,
    names: Sequence[str] | None = None,
    callback: Callable[[float, str], object] | None = None,
) -> Comparison: ...


@overload
def compare_groups(
    particles: ArrayLike,
    groups: Sequence[str | None],
    between: Sequence[str] | None = None,
    *,
    pairs: Sequence[str | None] | None = None,
    covariates: Covariates | None = None,
    complete_cases: bool = False,
    alignment: tuple[_Alignment, ...] | list[_Alignment] = _BOTH,
    modes: int | None = None,
    permutations: int = 10_000,
    null_repeats: int = 0,
    seed: int = 0,
    names: Sequence[str] | None = None,
    callback: Callable[[float, str], object] | None = None,
) -> tuple[Comparison, ...]: ...


def compare_groups(
    particles: ArrayLike,
    groups: Sequence[str | None],
    between: Sequence[str] | None = None,
    *,
    pairs: Sequence[str | None] | None = None,
    covariates: Covariates | None = None,
    complete_cases: bool = False,
    alignment: _Alignment | Sequence[_Alignment] = _BOTH,
    modes: int | None = None,
    permutations: int = 10_000,
    null_repeats: int = 0,
    seed: int = 0,
    names: Sequence[str] | None = None,
    callback: Callable[[float, str], object] | None = None,
) -> Comparison | tuple[Comparison, ...]:
    """Test whether the shapes of two or more groups differ, how, and where.

    Parameters
    ----------
    particles : (M, N, 3) array_like
        Corresponding points [mm], such as `Correspondence.aligned`.
    groups : sequence of str or None
        Group of each of the M subjects.
    between : sequence of str, optional
        Two or more groups to compare; differences are relative to the first. By default all, in order of
        appearance. Subjects of other groups, or of none, are excluded.
    pairs : sequence of str or None, optional
        For two groups, the pair of each of the M subjects, such as the patient of a left and a right bone:
        tests the differences within pairs, as ``homolog analyze --pairs``. Unpaired subjects are excluded.
    covariates : mapping of str to sequence, optional
        Covariates to adjust for, with M numbers or texts each, such as ``{"age": ages}``. If a name ends in
        ``:c``, such as ``site:c``, its numbers are codes of categories.
    complete_cases : bool
        Whether subjects with missing covariates, or without a pair or partner, are excluded and counted in
        the result's `notes`, instead of refused.
    alignment : {"rigid", "similarity", "as-it-lies"}, or several of them
        Alignment before the comparison: rigid (form: size and shape), by similarities (shape alone), or
        none. Several alignments give several answers, with p-values corrected for their number
        (Bonferroni). By default form and shape, as in the window and in ``homolog analyze``. A single one,
        such as ``"rigid"``, is not corrected: choose it before you see results.
    modes : int, optional
        Number of modes in which the whole shape is tested; chosen by parallel analysis if not given.
    permutations : int
        Number of permutations of each test; p-values are at least 1 / (permutations + 1).
    null_repeats : int
        Repeats of the null simulation, which estimates type I error rates; 0 omits it.
    seed : int
        Random seed of the permutations; the same seed gives the same result.
    names : sequence of str, optional
        Subject names, for messages.
    callback : callable, optional
        ``callback(fraction, message)``; raise `Cancelled`, or any other error, in it to stop.

    Returns
    -------
    tuple of Comparison, or Comparison
        A comparison for each alignment, by default form and shape; a single Comparison if `alignment` is one
        name. With three or more groups it is the test for any difference, and its `pairwise` has the
        comparisons of two groups, corrected for their number (Holm).

    Raises
    ------
    InputError
        If a group is too small, a value is missing, subjects are duplicated, covariates are confounded with
        the group, or an argument is invalid.

    References
    ----------
    docs/statistics.md names the tests and their sources.

    Examples
    --------
    Spheres, of which the last six have a bump at one of 40 particles:

    >>> import numpy as np
    >>> import homolog as hl
    >>> random = np.random.default_rng(1)
    >>> directions = random.normal(size=(40, 3))
    >>> directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    >>> shapes = 10.0 * directions + random.normal(scale=0.05, size=(12, 40, 3))
    >>> shapes[6:, 7] *= 1.2
    >>> form, shape = hl.compare_groups(shapes, 6 * ["plain"] + 6 * ["bump"], permutations=999)
    >>> form.title, int(np.argmin(form.p_fwe)), int(np.argmin(shape.p_fwe))
    ('bump - plain', 7, 7)
    """
    check_options((alignment,) if isinstance(alignment, str) else alignment, permutations)
    labels = np.array(["" if group is None or is_missing(group) else str(group) for group in groups])
    shapes = checked_particles(particles, names)
    if len(labels) != len(shapes):
        raise InputError(f"groups: {len(labels)} given for {len(shapes)} subjects; give one for each")
    order = tuple(between) if between is not None else tuple(dict.fromkeys(labels[labels != ""].tolist()))
    excluded: dict[int, str] = {}
    if complete_cases:
        excluded = incomplete(len(shapes), covariates, np.isin(labels, order))
        excluded |= {} if pairs is None else unpaired(pairs, labels, order)
        labels[list(excluded)] = ""
    notes = notes_on(excluded, names, covariates, labels.tolist())
    chosen = np.flatnonzero(np.isin(labels, order))
    if not len(chosen):
        raise InputError("groups: no subject is in one of the compared groups; give each subject its group")
    called = None if names is None else [names[index] for index in chosen.tolist()]
    both = None if pairs is None else pairs_of(pairs, labels, order, covariates, names)
    columns = columns_of(covariates, chosen.tolist(), len(shapes), called)
    own, compared = labels[chosen].tolist(), shapes[chosen]

    def ask(options: Options, tick: Tick) -> Comparison:
        tick, later = part_of(tick, 0.0, share := 0.6 if covariates else 1.0), part_of(tick, share, 1.0)
        if both is not None:
            title = " - ".join(order[::-1])
            paired = compare_pairs(shapes, *both, title, options=options, names=names, tick=tick)
            return replace(paired, notes=notes)
        question = partial(_two_or_more, compared, own, order)
        overall, each = question(covariates=columns, options=options, names=called, tick=tick)
        overall = _with_covariates(overall, compared, own, covariates, chosen, options, later)
        each = with_unadjusted(each, table_of(covariates, chosen.tolist()))
        pairwise = tuple(pair.renumbered(chosen) for pair in each)
        return replace(overall.renumbered(chosen), pairwise=pairwise, notes=notes)

    options = Options(modes=modes, permutations=permutations, null_repeats=null_repeats, seed=seed)
    return _answers(ask, alignment, options, callback)


def _two_or_more(
    shapes: FloatArray,
    groups: list[str],
    order: tuple[str, ...],
    **how: Any,  # noqa: ANN401 - passed on
) -> tuple[Comparison, tuple[Comparison, ...]]:
    """Compare all groups; return the overall comparison, and those of pairs if there are three or more."""
    if len(order) == 2:
        return compare_two_groups(shapes, groups, (order[0], order[1]), **how), ()
    return compare_several(shapes, groups, order, **how)


@overload
def regress(
    particles: ArrayLike,
    values: Sequence[float] | Array,
    name: str = "variable",
    *,
    covariates: Covariates | None = None,
    complete_cases: bool = False,
    alignment: _Alignment,
    modes: int | None = None,
    permutations: int = 10_000,
    null_repeats: int = 0,
    seed: int = 0,
    names: Sequence[str] | None = None,
    callback: Callable[[float, str], object] | None = None,
) -> Comparison: ...


@overload
def regress(
    particles: ArrayLike,
    values: Sequence[float] | Array,
    name: str = "variable",
    *,
    covariates: Covariates | None = None,
    complete_cases: bool = False,
    alignment: tuple[_Alignment, ...] | list[_Alignment] = _BOTH,
    modes: int | None = None,
    permutations: int = 10_000,
    null_repeats: int = 0,
    seed: int = 0,
    names: Sequence[str] | None = None,
    callback: Callable[[float, str], object] | None = None,
) -> tuple[Comparison, ...]: ...


def regress(
    particles: ArrayLike,
    values: Sequence[float] | Array,
    name: str = "variable",
    *,
    covariates: Covariates | None = None,
    complete_cases: bool = False,
    alignment: _Alignment | Sequence[_Alignment] = _BOTH,
    modes: int | None = None,
    permutations: int = 10_000,
    null_repeats: int = 0,
    seed: int = 0,
    names: Sequence[str] | None = None,
    callback: Callable[[float, str], object] | None = None,
) -> Comparison | tuple[Comparison, ...]:
    """Test for a linear effect of a continuous variable on shape, as ``homolog analyze --regress`` does.

    Parameters
    ----------
    particles : (M, N, 3) array_like
        Corresponding points [mm], such as `Correspondence.aligned`.
    values : (M,) sequence of float
        Value of each subject, such as its age.
    name : str
        Name of the variable, for titles and messages.
    covariates : mapping of str to sequence, optional
        Covariates to adjust for, as in `compare_groups`.
    complete_cases : bool
        Whether subjects with missing values are excluded and counted in the result's `notes`, instead of
        refused.
    alignment : {"rigid", "similarity", "as-it-lies"}, or several of them
        Alignment before the test, as in `compare_groups`; by default form and shape.
    modes : int, optional
        Number of modes in which the whole shape is tested; chosen by parallel analysis if not given.
    permutations : int
        Number of permutations of each test.
    null_repeats : int
        Repeats of the null simulation; 0 omits it.
    seed : int
        Random seed of the permutations.
    names : sequence of str, optional
        Subject names, for messages.
    callback : callable, optional
        ``callback(fraction, message)``.

    Returns
    -------
    tuple of Comparison, or Comparison
        A comparison for each alignment, by default form and shape; a single Comparison if `alignment` is one
        name. Effects are changes per unit of the variable.

    Raises
    ------
    InputError
        If a value is missing or not a number, subjects are duplicated, the variable is confounded with the
        covariates, or an argument is invalid.

    References
    ----------
    docs/statistics.md names the tests and their sources.

    Examples
    --------
    Spheres, of which one of 40 particles moves outward with age:

    >>> import numpy as np
    >>> import homolog as hl
    >>> random = np.random.default_rng(1)
    >>> directions = random.normal(size=(40, 3))
    >>> directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    >>> shapes = 10.0 * directions + random.normal(scale=0.05, size=(12, 40, 3))
    >>> ages = np.arange(50, 62)
    >>> shapes[:, 7] *= 1.0 + 0.02 * (ages[:, None] - 50)
    >>> form, shape = hl.regress(shapes, ages, "age", permutations=999)
    >>> form.title, int(np.argmin(form.p_fwe))
    ('age', 7)
    """
    check_options((alignment,) if isinstance(alignment, str) else alignment, permutations)
    shapes = checked_particles(particles, names)
    check_values(name, values, len(shapes))
    everyone = np.full(len(shapes), True)
    excluded = (
        incomplete(len(shapes), {name: values, **(covariates or {})}, everyone) if complete_cases else {}
    )
    notes = notes_on(excluded, names, covariates)
    chosen = np.array([index for index in range(len(shapes)) if index not in excluded], np.int64)
    called = None if names is None else [names[index] for index in chosen.tolist()]
    own = [values[index] for index in chosen.tolist()]
    columns_of({name: own}, range(len(own)), len(own), called)  # raises an error that names missing values
    given = numbers(own)
    if given is None:
        raise InputError(f"{name!r} contains text; compare its groups instead")
    columns = columns_of(covariates, chosen.tolist(), len(shapes), called)

    def ask(options: Options, tick: Tick) -> Comparison:
        tick, later = part_of(tick, 0.0, share := 0.6 if covariates else 1.0), part_of(tick, share, 1.0)
        change = regress_shapes(
            shapes[chosen], given, name, covariates=columns, options=options, names=called, tick=tick
        )
        change = _with_covariates(change, shapes[chosen], given, covariates, chosen, options, later)
        return replace(change.renumbered(chosen), notes=notes)

    options = Options(modes=modes, permutations=permutations, null_repeats=null_repeats, seed=seed)
    return _answers(ask, alignment, options, callback)


def _with_covariates(
    comparison: Comparison,
    shapes: FloatArray,
    tested: Sequence[str] | FloatArray,
    covariates: Covariates | None,
    chosen: IntArray,
    options: Options,
    tick: Tick,
) -> Comparison:
    """Return a comparison of the chosen subjects with the effects of its covariates."""
    if not covariates:
        return comparison
    return with_covariate_effects(
        comparison, shapes, tested, table_of(covariates, chosen.tolist()),
        categories=[title for title in covariates if title.endswith(CATEGORY)], options=options, tick=tick,
    )  # fmt: skip


def _answers(
    ask: Callable[[Options, Tick], Comparison],
    alignment: _Alignment | Sequence[_Alignment],
    options: Options,
    callback: Callable[[float, str], object] | None,
) -> Comparison | tuple[Comparison, ...]:
    """Return the answer for one alignment, or one answer for each of several."""
    alignments = (alignment,) if isinstance(alignment, str) else tuple(alignment)
    count, tick = len(alignments), tick_of(callback)
    answers = [
        ask(
            replace(options, alignment=Alignment(name), answers=count),
            part_of(tick, index / count, (index + 1) / count),
        )
        for index, name in enumerate(alignments)
    ]
    return answers[0] if isinstance(alignment, str) else tuple(answers)
