"""Questions to a project in one call."""

from collections.abc import Callable, Sequence
from os import PathLike
from typing import Literal

from homolog.comparison.project import StudyAnswer, analyze_result, primary_of, questions_of
from homolog.comparison.stored import name_primary
from homolog.errors import path_of
from homolog.inspection.verdict import refuse_unusable
from homolog.io.project import ProjectFolder
from homolog.io.results import read_result
from homolog.progress import tick_of

__all__ = ["analyze"]

_Alignment = Literal["form", "shape", "as-it-lies"]


def analyze(
    project: str | PathLike[str],
    *,
    group: str = "group",
    regress: str | None = None,
    between: Sequence[str] = (),
    pairs: str | None = None,
    covariates: Sequence[str] = (),
    formula: str | None = None,
    subject: str | None = None,
    strata: str | None = None,
    squares: Literal["I", "II", "III"] = "II",
    complete_cases: bool = False,
    alignment: _Alignment | Sequence[_Alignment] = "shape",
    modes: int | None = None,
    permutations: int = 10_000,
    random_state: int = 0,
    seeds: int | None = None,
    primary: str | None = None,
    anyway: bool = False,
    callback: Callable[[float, str], object] | None = None,
) -> tuple[StudyAnswer, ...]:
    """Answer a question about a project, write its tables, and add it to the project's report.

    Parameters have the names and meanings of the options of ``homolog analyze`` (`random_state` is its seed).

    Parameters
    ----------
    project : path
        A project with a result.
    group : str
        Column of groups.
    regress : str, optional
        Column of a continuous variable, whose linear effect is tested instead.
    between : sequence of str
        Groups to compare, the reference first; by default all, controls first.
    pairs : str, optional
        Column that identifies the pairs of two groups.
    covariates : sequence of str
        Columns to adjust for; ``COLUMN:c`` treats numbers as categories.
    formula : str, optional
        Terms to test in place of groups, such as ``"~ group * age + sex"``; see `compare`.
    subject : str, optional
        For a formula, column of the subject of repeated measures.
    strata : str, optional
        For a formula, column of strata, such as sites.
    squares : {"II", "I", "III"}
        For a formula, type of the sums of squares.
    complete_cases : bool
        Whether subjects with missing values in the columns used are excluded, instead of refused.
    alignment : {"shape", "form", "as-it-lies"}, or several of them
        What is compared: shape with size beside it (the default), form, or the shapes as they lie.
    modes : int, optional
        Number of modes to test; chosen by parallel analysis if not given.
    permutations : int
        Permutations of each test.
    random_state : int
        Random seed.
    seeds : int, optional
        Number of seeds of the correspondence with which run and tests are repeated; by default the stored
        ones.
    primary : str, optional
        Alignment of the primary study: reports begin with it, and the others follow in a fixed sequence.
        ``""`` means the first alignment, ``"none"`` removes the choice.
    anyway : bool
        Whether to use a model even if its verdict is *not usable*.
    callback : callable, optional
        ``callback(fraction, message)``; raise `Cancelled`, or any other error, in it to stop.

    Returns
    -------
    tuple of StudyAnswer
        An answer for each alignment.

    Raises
    ------
    InputError
        If there is no result or it is not usable, a column or group is missing, or an argument is invalid.

    See Also
    --------
    Project.describe : details for the report, such as the name of the structure.
    """
    alignments = (alignment,) if isinstance(alignment, str) else tuple(dict.fromkeys(alignment))
    folder = ProjectFolder(path_of(project, "project"))
    with folder.locked(new=False):
        result = read_result(folder)
        if not anyway:
            refuse_unusable(folder, result.world)
        requested = questions_of(
            result,
            alignments,
            group=group,
            regress=regress,
            between=between,
            pairs=pairs,
            covariates=tuple(covariates),
            formula=formula,
            subject=subject,
            strata=strata,
            squares=squares,
            complete_cases=complete_cases,
            modes=modes,
            permutations=permutations,
            seed=random_state,
        )
        chosen = primary_of(requested, primary)
        answers = analyze_result(folder, result, requested, seeds, tick_of(callback))
        if primary is not None:
            name_primary(folder, chosen)
        return answers
