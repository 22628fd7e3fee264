"""Comparison of groups, and regression on a number, in one call."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from os import PathLike
from typing import TYPE_CHECKING, Any, Literal, Self, TypeAlias, overload

from homolog.api.inputs import column_of, columns_of
from homolog.api.project import Project
from homolog.arrays import Array, ArrayLike
from homolog.cohort.column_types import plain_name
from homolog.comparison.ask import ask
from homolog.comparison.formula import FormulaAnswer, ask_formula, design_of
from homolog.comparison.question import questions
from homolog.comparison.sample import Sample, at_own_size, levels, matched_rows
from homolog.errors import InputError, path_of
from homolog.inspection.verdict import Word
from homolog.progress import part_of, tick_of
from homolog.statistics.comparison import Comparison

if TYPE_CHECKING:
    from homolog.api.correspond import Correspondence

    _Shapes: TypeAlias = Correspondence | Project | str | PathLike[str] | ArrayLike

__all__ = ["compare", "compare_groups", "regress"]

_Alignment = Literal["form", "shape", "as-it-lies"]
_BOTH: tuple[_Alignment, ...] = ("form", "shape")
Covariates = Mapping[str, Sequence[str | float] | Array]


@overload
def compare_groups(
    particles: _Shapes,
    groups: Sequence[str | None] | str | None = None,
    between: Sequence[str] | None = None,
    *,
    pairs: Sequence[str | None] | str | None = None,
    covariates: Covariates | Sequence[str] | None = None,
    complete_cases: bool = False,
    alignment: _Alignment,
    modes: int | None = None,
    permutations: int = 10_000,
    random_state: int = 0,
    names: Sequence[str] | None = None,
    callback: Callable[[float, str], object] | None = None,
) -> Comparison: ...


@overload
def compare_groups(
    particles: _Shapes,
    groups: Sequence[str | None] | str | None = None,
    between: Sequence[str] | None = None,
    *,
    pairs: Sequence[str | None] | str | None = None,
    covariates: Covariates | Sequence[str] | None = None,
    complete_cases: bool = False,
    alignment: tuple[_Alignment, ...] | list[_Alignment] = _BOTH,
    modes: int | None = None,
    permutations: int = 10_000,
    random_state: int = 0,
    names: Sequence[str] | None = None,
    callback: Callable[[float, str], object] | None = None,
) -> tuple[Comparison, ...]: ...


def compare_groups(
    particles: _Shapes,
    groups: Sequence[str | None] | str | None = None,
    between: Sequence[str] | None = None,
    *,
    pairs: Sequence[str | None] | str | None = None,
    covariates: Covariates | Sequence[str] | None = None,
    complete_cases: bool = False,
    alignment: _Alignment | Sequence[_Alignment] = _BOTH,
    modes: int | None = None,
    permutations: int = 10_000,
    random_state: int = 0,
    names: Sequence[str] | None = None,
    callback: Callable[[float, str], object] | None = None,
) -> Comparison | tuple[Comparison, ...]:
    """Test whether the shapes of two or more groups differ, how, and where.

    Parameters
    ----------
    particles : Correspondence, Project, path of a project, or (M, N, 3) array_like
        Corresponding points of the M subjects [mm].
    groups : sequence of str or None, or pandas.Series, or str, optional
        Group of each of the M subjects, or the column of a result that has them; by default its groups.
    between : sequence of str, optional
        Two or more groups to compare; differences are relative to the first. By default all, in order of
        appearance. Subjects of other groups, or of none, are excluded.
    pairs : sequence of str or None, optional
        For two groups, the pair of each of the M subjects, such as the patient of a left and a right bone:
        tests the differences within pairs, as ``homolog analyze --pairs``; or the column of a result that has
        it. Unpaired subjects are excluded.
    covariates : pandas.DataFrame or mapping of str to sequence, or names of a result's columns, optional
        Covariates to adjust for, with M numbers or texts each, such as ``{"age": ages}``. If a name ends in
        ``:c``, such as ``site:c``, its numbers are codes of categories.
    complete_cases : bool
        Whether subjects with missing covariates, or without a pair or partner, are excluded and counted in
        the result's `notes`, instead of refused.
    alignment : {"form", "shape", "as-it-lies"}, or several of them
        What is compared: form (size and shape, aligned rigidly), shape alone (aligned and scaled to one
        size), or the shapes as they lie. Several give several answers, by default form and shape; their
        p-values are not corrected for each other: choose the one that counts before you see results.
    modes : int, optional
        Number of modes in which the whole shape is tested; chosen by parallel analysis if not given.
    permutations : int
        Number of permutations of each test; p-values are at least 1 / (permutations + 1).
    random_state : int
        Random seed of the permutations; the same seed gives the same result.
    names : sequence of str, optional
        Subject names, for messages; rows of pandas with texts as their index are matched with them.
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
    if isinstance(pairs, tuple | list) and any(isinstance(pair, tuple | list) for pair in pairs):
        raise InputError("pairs: give the name of each subject's pair; `between` chooses the groups")
    if isinstance(between, str) or not (between is None or isinstance(between, Iterable)):
        raise InputError(f"between={between!r}: give two or more groups")
    subjects = _Subjects.of(particles, names)
    given = subjects.covariates(covariates)
    groups = "group" if groups is None and subjects.columns else groups
    values, pairing = subjects.column(groups, "groups"), _unused("pairs", given)
    column = groups if isinstance(groups, str) else _unused("groups", given)
    columns = {column: [None if group is None or group == "" else str(group) for group in values], **given}
    if pairs is not None:
        columns[pairing] = subjects.column(pairs, "pairs")
    sample = subjects.sample(columns)
    order = tuple(between) if between is not None else tuple(levels(sample.column(column)))
    question = {
        "kind": "groups" if pairs is None else "pairs",
        "column": column,
        "between": order,
        "pairs": None if pairs is None else pairing,
        "covariates": tuple(given),
        "complete_cases": complete_cases,
        "modes": modes,
        "permutations": permutations,
        "seed": random_state,
    }
    subjects.refuse_unusable("give its aligned particles (aligned)")
    return _comparisons(sample, alignment, callback, question)


@overload
def regress(
    particles: _Shapes,
    values: Sequence[float] | Array | str,
    name: str = "variable",
    *,
    covariates: Covariates | Sequence[str] | None = None,
    complete_cases: bool = False,
    alignment: _Alignment,
    modes: int | None = None,
    permutations: int = 10_000,
    random_state: int = 0,
    names: Sequence[str] | None = None,
    callback: Callable[[float, str], object] | None = None,
) -> Comparison: ...


@overload
def regress(
    particles: _Shapes,
    values: Sequence[float] | Array | str,
    name: str = "variable",
    *,
    covariates: Covariates | Sequence[str] | None = None,
    complete_cases: bool = False,
    alignment: tuple[_Alignment, ...] | list[_Alignment] = _BOTH,
    modes: int | None = None,
    permutations: int = 10_000,
    random_state: int = 0,
    names: Sequence[str] | None = None,
    callback: Callable[[float, str], object] | None = None,
) -> tuple[Comparison, ...]: ...


def regress(
    particles: _Shapes,
    values: Sequence[float] | Array | str,
    name: str = "variable",
    *,
    covariates: Covariates | Sequence[str] | None = None,
    complete_cases: bool = False,
    alignment: _Alignment | Sequence[_Alignment] = _BOTH,
    modes: int | None = None,
    permutations: int = 10_000,
    random_state: int = 0,
    names: Sequence[str] | None = None,
    callback: Callable[[float, str], object] | None = None,
) -> Comparison | tuple[Comparison, ...]:
    """Test for a linear effect of a continuous variable on shape, as ``homolog analyze --regress`` does.

    Parameters
    ----------
    particles : Correspondence, Project, path of a project, or (M, N, 3) array_like
        Corresponding points of the M subjects [mm].
    values : (M,) sequence of float, or str
        Value of each subject, such as its age, or the column of a result that has them.
    name : str
        Name of the variable, for titles and messages; a column of a result has its own.
    covariates : pandas.DataFrame or mapping of str to sequence, or names of a result's columns, optional
        Covariates to adjust for, as in `compare_groups`.
    complete_cases : bool
        Whether subjects with missing values are excluded and counted in the result's `notes`, instead of
        refused.
    alignment : {"form", "shape", "as-it-lies"}, or several of them
        Alignment before the test, as in `compare_groups`.
    modes : int, optional
        Number of modes in which the whole shape is tested; chosen by parallel analysis if not given.
    permutations : int
        Number of permutations of each test.
    random_state : int
        Random seed of the permutations.
    names : sequence of str, optional
        Subject names, for messages; rows of pandas with texts as their index are matched with them.
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
    subjects = _Subjects.of(particles, names)
    name = values if isinstance(values, str) and subjects.columns else name
    given = subjects.covariates(covariates)
    sample = subjects.sample({name: subjects.column(values, repr(name)), **given})
    question = {
        "kind": "regression",
        "column": name,
        "covariates": tuple(given),
        "complete_cases": complete_cases,
        "modes": modes,
        "permutations": permutations,
        "seed": random_state,
    }
    subjects.refuse_unusable("give its aligned particles (aligned)")
    return _comparisons(sample, alignment, callback, question)


def compare(
    result: _Shapes,
    formula: str,
    data: Mapping[str, Sequence[str | float | None] | Array] | None = None,
    *,
    subject: str | None = None,
    strata: str | None = None,
    squares: Literal["I", "II", "III"] = "II",
    complete_cases: bool = False,
    alignment: _Alignment = "shape",
    modes: int | None = None,
    permutations: int = 10_000,
    random_state: int = 0,
    out: str | PathLike[str] | None = None,
    anyway: bool = False,
    callback: Callable[[float, str], object] | None = None,
) -> FormulaAnswer:
    """Test the terms of a formula, and what differs, as ``homolog analyze --formula`` does.

    Parameters
    ----------
    result : Correspondence, Project, path of a project, or (M, N, 3) array_like
        Corresponding points of the M subjects.
    formula : str
        Such as ``"~ group * age + sex"``: columns, ``+``, ``:`` (interaction), ``*`` (both and their
        interaction), ``^`` and parentheses. ``size`` is the size of the shapes, ``log_size`` its logarithm.
    data : pandas.DataFrame or mapping of str to sequence, optional
        The columns. Rows are matched to the subjects of a result by a column ``name`` or ``subject``, or by
        the index, in any order; rows of an array's shapes have its order. By default the groups and
        covariates of the result.
    subject : str, optional
        Column of the subject of each row, for repeated measures.
    strata : str, optional
        Column of strata, such as sites; effects are those within strata.
    squares : {"II", "I", "III"}
        Type of the sums of squares: each term adjusted for all that do not contain it, for those before it,
        or for all others.
    complete_cases : bool
        Whether rows with missing values in the columns used are excluded and named, instead of refused.
    alignment : {"shape", "form", "as-it-lies"}
        Alignment before the test, as in `compare_groups`.
    modes : int, optional
        Number of modes that are tested beside the coordinates; by parallel analysis if not given.
    permutations : int
        Number of randomizations of each test.
    random_state : int
        Random seed.
    out : path, optional
        Folder for ``anova.csv``, ``differences.csv``, ``allometry.csv`` and ``columns.csv``.
    anyway : bool
        Whether to use a model even if its verdict is *not usable*.
    callback : callable, optional
        ``callback(fraction, message)``; raise `Cancelled`, or any other error, in it to stop.

    Returns
    -------
    FormulaAnswer

    Raises
    ------
    InputError
        Before anything is computed, if the design can't be estimated (terms that can't be told apart, an
        interaction without subjects in a cell, too few rows), rows of one subject are not declared, rows of
        data can't be matched to the subjects, or a column or argument is wrong; or if the model is not
        usable.

    Examples
    --------
    Spheres of two groups, of which one grows upward with age:

    >>> import numpy as np
    >>> import homolog as hl
    >>> random = np.random.default_rng(1)
    >>> directions = random.normal(size=(40, 3))
    >>> directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    >>> shapes = 10.0 * directions + random.normal(scale=0.05, size=(24, 40, 3))
    >>> data = {"group": 12 * ["a", "b"], "age": list(range(50, 74))}
    >>> shapes[1::2, 7] *= 1.0 + 0.02 * np.arange(1, 25, 2)[:, None]
    >>> answer = hl.compare(shapes, "~ group * age", data, permutations=999)
    >>> [row.term for row in answer.coordinates if row.p is not None and row.p < 0.05]
    ['group', 'age', 'group:age']
    """
    (question,) = questions(
        (alignment,),
        kind="formula",
        column="",
        formula=formula,
        subject=subject,
        strata=strata,
        squares=squares,
        modes=modes,
        complete_cases=complete_cases,
        permutations=permutations,
        seed=random_state,
    )
    columns = None if data is None else columns_of(data, what="data")
    subjects = _Subjects.of(result)
    given = dict(subjects.columns)
    if columns is not None:
        given = dict(columns)
        if subjects.names is not None:
            rows = matched_rows(subjects.names, columns, getattr(data, "index", None))
            given = {name: [values[row] for row in rows] for name, values in columns.items()}
    elif not given:
        raise InputError("data: give the columns of the formula, one value for each shape")
    sample = subjects.sample(given)
    design_of(sample, question)  # refuses before anything is computed
    if not anyway:
        subjects.refuse_unusable("add the option anyway")
    answer = ask_formula(sample, question, tick_of(callback))
    if out is not None:
        answer.write(path_of(out, "out"))
    return answer


@dataclass(frozen=True, slots=True, eq=False)
class _Subjects:
    """Shapes that a user gives, with the columns of a result."""

    particles: ArrayLike
    names: Sequence[str] | None
    columns: Mapping[str, Sequence[str]] = field(default_factory=dict)
    model: Correspondence | Project | None = None

    @classmethod
    def of(cls, given: _Shapes, names: Sequence[str] | None = None) -> Self:
        """Return the shapes of a result, a project or an array."""
        model: Any = Project(given) if isinstance(given, str | PathLike) else given
        if not hasattr(model, "aligned"):
            return cls(model, names)
        columns = {name: list(values) for name, values in model.covariates.items()}
        return cls(
            model.aligned, model.names, columns | {"group": [item or "" for item in model.groups]}, model
        )

    def column(self, values: object, what: str) -> Sequence[Any]:
        """Return the values that are given, or those of the column of a result that is named."""
        if not (isinstance(values, str) and self.columns):
            return column_of(values, self.names, what)
        if values not in self.columns:
            raise InputError(f"{what}: there is no column {values!r}; columns are {', '.join(self.columns)}")
        return self.columns[values]

    def covariates(self, given: Covariates | Sequence[str] | None) -> dict[str, Sequence[Any]]:
        """Return columns that are given, or those of a result that are named."""
        if self.columns and isinstance(given, str | list | tuple):
            names = [given] if isinstance(given, str) else given
            return {name: self.column(plain_name(name), "covariates") for name in names}
        return columns_of(given, self.names)

    def sample(self, columns: Mapping[str, Sequence[Any] | Array]) -> Sample:
        """Return the shapes with columns."""
        sample = Sample.of_arrays(self.particles, columns, self.names)
        if self.model is None:
            return sample
        return replace(sample, own_size=at_own_size(self.model.aligned, self.model.alignments))

    def refuse_unusable(self, remedy: str) -> None:
        """Refuse a result whose verdict is *not usable*."""
        if self.model is not None and (verdict := self.model.verdict).word is Word.UNUSABLE:
            raise InputError(
                f"the model is not usable. {verdict.cause} {verdict.remedy} To use it all the same, {remedy}"
            )


def _unused(name: str, covariates: Mapping[str, object]) -> str:
    """Return a name that no covariate has."""
    return _unused(f"{name}_", covariates) if name in covariates else name


def _comparisons(
    sample: Sample,
    alignment: _Alignment | Sequence[_Alignment],
    callback: Callable[[float, str], object] | None,
    question: Mapping[str, Any],
) -> Comparison | tuple[Comparison, ...]:
    """Return the comparison for one alignment, or one for each of several."""
    if not isinstance(alignment, str | Iterable):
        raise InputError(f"alignment={alignment!r}: choose form, shape or as-it-lies")
    requested = questions((alignment,) if isinstance(alignment, str) else tuple(alignment), **question)
    tick, done = tick_of(callback), list[Comparison]()
    for index, item in enumerate(requested):
        answer = ask(sample, item, part_of(tick, index / len(requested), (index + 1) / len(requested)))
        done.append(replace(answer.overall, pairwise=answer.pairwise, notes=answer.notes))
    return done[0] if isinstance(alignment, str) else tuple(done)
