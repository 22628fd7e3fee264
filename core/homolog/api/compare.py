"""Comparison of groups, and regression on a number, in one call."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Literal, overload

import numpy as np

from homolog.analysis.checks import checked_particles
from homolog.analysis.comparison import Comparison, Options
from homolog.analysis.design import covariate_columns, is_missing, numbers
from homolog.analysis.procrustes import Alignment
from homolog.analysis.studies import compare_groups as compare_several
from homolog.analysis.studies import compare_pairs, compare_two_groups, pair_members
from homolog.analysis.studies import regress as regress_shapes
from homolog.arrays import Array, ArrayLike, FloatArray, IntArray
from homolog.errors import InputError
from homolog.progress import Tick, part_of, tick_of

__all__ = ["compare_groups", "regress"]

_Alignment = Literal["rigid", "similarity", "as-it-lies"]
_Covariates = Mapping[str, Sequence[str | float] | Array]
_BOTH: tuple[_Alignment, ...] = ("rigid", "similarity")
"""Form and shape, as on the command line and in the window."""


@overload
def compare_groups(
    particles: ArrayLike,
    groups: Sequence[str | None],
    between: Sequence[str] | None = None,
    *,
    pairs: Sequence[str | None] | None = None,
    comparisons: Sequence[tuple[str, str]] | None = None,
    covariates: _Covariates | None = None,
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
    comparisons: Sequence[tuple[str, str]] | None = None,
    covariates: _Covariates | None = None,
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
    comparisons: Sequence[tuple[str, str]] | None = None,
    covariates: _Covariates | None = None,
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
    comparisons : sequence of (str, str), optional
        For three or more groups, the pairs of groups to compare, such as each with the controls;
        differences are the second minus the first. By default all pairs.
    covariates : mapping of str to sequence, optional
        Covariates to adjust for, with M numbers or texts each, such as ``{"age": ages}``. If a name ends in
        ``:c``, such as ``site:c``, its numbers are codes of categories.
    alignment : {"rigid", "similarity", "as-it-lies"}, or several of them
        Alignment before the comparison: rigid (form: size and shape), by similarities (shape alone), or
        none. Several alignments give several answers, with p values corrected for their number
        (Bonferroni). By default form and shape, as in the window and in ``homolog analyze``. A single one,
        such as ``"rigid"``, is not corrected: choose it before you see results.
    modes : int, optional
        Modes in which the whole shape is tested; by parallel analysis if not given.
    permutations : int
        Number of permutations of each test; p values are at least 1 / (permutations + 1).
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
        One for each alignment, form and shape by default; a single Comparison if `alignment` is one name.
        With three or more groups it is the test for any difference, and its `pairwise` has the comparisons
        of two groups, corrected for their number (Holm).

    Raises
    ------
    InputError
        If a group is too small, a value is missing, subjects are duplicate, covariates are confounded with
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
    _check((alignment,) if isinstance(alignment, str) else alignment, permutations)
    labels = np.array(["" if group is None or is_missing(group) else str(group) for group in groups])
    shapes = checked_particles(particles, names)
    if len(labels) != len(shapes):
        raise InputError(f"groups: {len(labels)} given for {len(shapes)} subjects; give one for each")
    order = tuple(between) if between is not None else tuple(dict.fromkeys(labels[labels != ""].tolist()))
    chosen = np.flatnonzero(np.isin(labels, order))
    called = None if names is None else [names[index] for index in chosen.tolist()]
    if comparisons is not None:
        _check_comparisons(comparisons, order)
    both = None if pairs is None else _members_of(pairs, labels, order, covariates, names)
    columns = _columns(covariates, chosen.tolist(), len(shapes), called)
    own, here = labels[chosen].tolist(), shapes[chosen]

    def ask(options: Options, tick: Tick) -> Comparison:
        if both is not None:
            return compare_pairs(
                shapes, *both, " - ".join(order[::-1]), options=options, names=names, tick=tick
            )
        each: tuple[Comparison, ...] = ()
        if len(order) == 2:
            overall = compare_two_groups(
                here, own, (order[0], order[1]), covariates=columns, options=options, names=called, tick=tick
            )
        else:
            overall, each = compare_several(
                here,
                own,
                order,
                comparisons=comparisons,
                covariates=columns,
                options=options,
                names=called,
                tick=tick,
            )
        return replace(overall.renumbered(chosen), pairwise=tuple(pair.renumbered(chosen) for pair in each))

    options = Options(modes=modes, permutations=permutations, null_repeats=null_repeats, seed=seed)
    return _answers(ask, alignment, options, callback)


@overload
def regress(
    particles: ArrayLike,
    values: Sequence[float] | Array,
    name: str = "variable",
    *,
    covariates: _Covariates | None = None,
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
    covariates: _Covariates | None = None,
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
    covariates: _Covariates | None = None,
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
        Value of each subject, such as its age, without missing values.
    name : str
        Name of the variable, for titles and messages.
    covariates : mapping of str to sequence, optional
        Covariates to adjust for, as in `compare_groups`.
    alignment : {"rigid", "similarity", "as-it-lies"}, or several of them
        Alignment before the test, as in `compare_groups`; by default form and shape.
    modes : int, optional
        Modes in which the whole shape is tested; by parallel analysis if not given.
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
        One for each alignment, form and shape by default; a single Comparison if `alignment` is one name.
        Effects are changes per unit of the variable.

    Raises
    ------
    InputError
        If a value is missing or not a number, subjects are duplicate, the variable is confounded with the
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
    _check((alignment,) if isinstance(alignment, str) else alignment, permutations)
    shapes = checked_particles(particles, names)
    everyone = list(range(len(shapes)))
    _columns({name: values}, everyone, len(shapes), names)  # says which value is missing
    given = numbers(list(values))
    if given is None:
        raise InputError(f"{name!r} contains words; compare its groups instead of a regression")
    columns = _columns(covariates, everyone, len(shapes), names)

    def ask(options: Options, tick: Tick) -> Comparison:
        return regress_shapes(
            shapes, given, name, covariates=columns, options=options, names=names, tick=tick
        )

    options = Options(modes=modes, permutations=permutations, null_repeats=null_repeats, seed=seed)
    return _answers(ask, alignment, options, callback)


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


def _check(alignments: Sequence[str], permutations: int) -> None:
    known = [item.value for item in Alignment]
    for alignment in alignments:
        if alignment not in known:
            raise InputError(f"alignment={alignment!r}: choose one or several of {', '.join(known)}")
    if not alignments or len(set(alignments)) < len(alignments):
        raise InputError(f"alignment={tuple(alignments)}: give one or more, each once")
    if permutations < 1:
        raise InputError(f"permutations={permutations}: a permutation test needs at least one")


def _check_comparisons(comparisons: Sequence[tuple[str, str]], order: Sequence[str]) -> None:
    if len(order) < 3:
        raise InputError("comparisons need three or more groups; for two groups use `between`")
    if not comparisons or len({frozenset(pair) for pair in comparisons}) < len(comparisons):
        raise InputError("comparisons: give one or more, each once")
    for pair in comparisons:
        if len(set(pair)) != 2 or not set(pair) <= set(order):
            raise InputError(f"comparisons: {tuple(pair)} are not two of the groups {', '.join(order)}")


def _members_of(
    pairs: Sequence[str | None],
    labels: Array,
    order: Sequence[str],
    covariates: _Covariates | None,
    names: Sequence[str] | None,
) -> tuple[IntArray, IntArray]:
    """Return the first and the second of each pair of subjects."""
    if any(isinstance(pair, tuple | list) for pair in pairs):
        raise InputError(
            "pairs: names the pair of each subject; which of several groups are compared is said by "
            f"comparisons={list(pairs)!r}"
        )
    if len(pairs) != len(labels):
        raise InputError(f"pairs: {len(pairs)} given for {len(labels)} subjects; give one for each")
    if len(order) != 2 or covariates:
        raise InputError("pairs: a paired comparison is between two groups and takes no covariates")
    called = ["" if pair is None or is_missing(pair) else str(pair) for pair in pairs]
    return pair_members(called, labels.tolist(), (order[0], order[1]), names)


def _columns(
    covariates: Mapping[str, Sequence[str | float] | Array] | None,
    chosen: Sequence[int],
    subjects: int,
    names: Sequence[str] | None,
) -> FloatArray | None:
    """Return the columns (m, c) of the covariates of the compared subjects."""
    if not covariates:
        return None
    for title, values in covariates.items():
        if len(values) != subjects:
            raise InputError(
                f"covariate {title!r}: {len(values)} values for {subjects} subjects; give one for each"
            )
    table = {title: [values[index] for index in chosen] for title, values in covariates.items()}
    return covariate_columns(table, names, categories=[title for title in table if title.endswith(":c")])
