"""Groups compared in one call."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from homolog.analysis.checks import checked_particles
from homolog.analysis.comparison import Comparison, Options
from homolog.analysis.covariates import covariate_columns, is_missing
from homolog.analysis.procrustes import Alignment
from homolog.analysis.studies import compare_groups as compare_several
from homolog.analysis.studies import compare_two_groups
from homolog.arrays import Array, ArrayLike, FloatArray
from homolog.errors import InputError
from homolog.progress import Tick, no_tick

__all__ = ["compare_groups"]


def compare_groups(
    particles: ArrayLike,
    groups: Sequence[str | None],
    between: Sequence[str] | None = None,
    *,
    covariates: Mapping[str, Sequence[str | float] | Array] | None = None,
    alignment: Literal["rigid", "similarity", "as-it-lies"] = "rigid",
    modes: int | None = None,
    permutations: int = 10_000,
    null_repeats: int = 0,
    seed: int = 0,
    names: Sequence[str] | None = None,
    callback: Callable[[float, str], object] | None = None,
) -> Comparison:
    """Test whether the shapes of two or more groups differ, how, and where.

    Parameters
    ----------
    particles : (M, N, 3) array_like
        Corresponding points [mm], such as `Correspondence.aligned`.
    groups : sequence of str or None
        Group of each of the M subjects.
    between : sequence of str, optional
        The groups that are compared, two or more; differences are those from the first. By default all, in
        the order in which they appear. Subjects of other groups, or of none, are left out.
    covariates : mapping of str to sequence, optional
        What is adjusted for: M numbers or words for each covariate, such as ``{"age": ages}``.
    alignment : {"rigid", "similarity", "as-it-lies"}
        How shapes are aligned before they are compared: rigidly (size and shape are compared: form), by
        similarities (shape alone), or not at all.
    modes : int, optional
        Modes in which the whole shape is tested; by parallel analysis if not given.
    permutations : int
        Of each test; p values are no smaller than 1 / (permutations + 1).
    null_repeats : int
        How often the tests are tried on permuted groups, which tells their type I error here; 0 for never.
    seed : int
        Of the permutations; same seed, same result.
    names : sequence of str, optional
        Subject names, for messages.
    callback : callable, optional
        ``callback(fraction, message)``; raise `Cancelled`, or any other error, in it to stop.

    Returns
    -------
    Comparison
        Of two groups; of more, the test for any difference between them, with each two of them in its
        `pairs`.

    Raises
    ------
    InputError
        If a group is too small, a value is missing, subjects are there twice, or covariates can't be told
        from the group.

    Notes
    -----
    ``homolog analyze`` and the window ask this question twice, of form and of shape, and correct p values for
    both (Bonferroni). Here each call is a question of its own.

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
    >>> comparison = hl.compare_groups(shapes, 6 * ["plain"] + 6 * ["bump"], permutations=999)
    >>> comparison.title, int(np.argmin(comparison.p_fwe))
    ('bump - plain', 7)
    """
    labels = np.array(["" if group is None or is_missing(group) else str(group) for group in groups])
    shapes = checked_particles(particles, names)
    if len(labels) != len(shapes):
        raise InputError(f"groups: {len(labels)} given for {len(shapes)} subjects; give one for each")
    order = tuple(between) if between is not None else tuple(dict.fromkeys(labels[labels != ""].tolist()))
    chosen = np.flatnonzero(np.isin(labels, order))
    called = None if names is None else [names[index] for index in chosen.tolist()]
    options = Options(
        alignment=Alignment(alignment),
        modes=modes,
        permutations=permutations,
        null_repeats=null_repeats,
        seed=seed,
    )
    columns = _columns(covariates, chosen.tolist(), len(shapes), called)
    own, here, tick = labels[chosen].tolist(), shapes[chosen], _tick(callback)
    pairs: tuple[Comparison, ...] = ()
    if len(order) == 2:
        two = (order[0], order[1])
        overall = compare_two_groups(
            here, own, two, covariates=columns, options=options, names=called, tick=tick
        )
    else:
        overall, pairs = compare_several(
            here, own, order, covariates=columns, options=options, names=called, tick=tick
        )

    def of_all(comparison: Comparison) -> Comparison:
        return replace(comparison, subjects=chosen[comparison.subjects])

    return replace(of_all(overall), pairs=tuple(map(of_all, pairs)))


def _columns(
    covariates: Mapping[str, Sequence[str | float] | Array] | None,
    chosen: Sequence[int],
    subjects: int,
    names: Sequence[str] | None,
) -> FloatArray | None:
    """Return the columns (m, c) of the covariates of those who are compared."""
    if not covariates:
        return None
    for title, values in covariates.items():
        if len(values) != subjects:
            raise InputError(
                f"covariate {title!r}: {len(values)} values for {subjects} subjects; give one for each"
            )
    return covariate_columns(
        {title: [values[index] for index in chosen] for title, values in covariates.items()}, names
    )


def _tick(callback: Callable[[float, str], object] | None) -> Tick:
    if callback is None:
        return no_tick

    def tick(fraction: float, message: str) -> None:
        callback(fraction, message)

    return tick
