"""Questions to projects and their reports from Python: what ``homolog analyze`` and ``homolog report`` do.

::

    from homolog_app.api import analyze, report

    form, shape = analyze("PROJECT", between=["NOR", "HCM"], covariates=["age"], seeds=5)
    report("PROJECT", structure="left ventricle", axes="patient")
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Literal

from pydantic import ValidationError

from homolog import Comparison, Project
from homolog.errors import InputError
from homolog.io.project import ProjectFolder
from homolog.io.report_details import read_details
from homolog.io.results import Result, read_result
from homolog.parameters import fault_text
from homolog.progress import Tick, no_tick, part_of, tick_of
from homolog.statistics.design import reference_first
from homolog_app.report.findings import Finding, cautions, findings
from homolog_app.report.request import StudyRequest, column_of
from homolog_app.report.seeds import SeedAnswer, answer_by_seed, spread_text, stored_seeds, write_spread
from homolog_app.report.stored_studies import name_primary
from homolog_app.report.study import run_study
from homolog_app.report.surface_maps import SurfaceCarrier, directions_of
from homolog_app.report.tables import save_study
from homolog_app.report.write import write_report

__all__ = ["Answer", "analyze", "answer_requests", "primary_of", "report", "requests_of"]

_Alignment = Literal["rigid", "similarity", "as-it-lies"]
_BOTH: tuple[_Alignment, ...] = ("rigid", "similarity")


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """An answer to a question, on form or on shape.

    Attributes
    ----------
    title : str
        The question and the alignment.
    comparison : Comparison
        Comparison of all groups, or of the only pair.
    pairwise : tuple of Comparison
        Comparisons of pairs of three or more groups.
    findings : tuple of Finding
        Findings of each comparison, in sentences.
    cautions : tuple of str
        Cautions as sentences.
    folder : Path
        Folder of the tables.
    seeds : tuple of SeedAnswer
        The answers of each seed of the correspondence, if there are several.
    """

    title: str
    comparison: Comparison
    pairwise: tuple[Comparison, ...]
    findings: tuple[Finding, ...]
    cautions: tuple[str, ...]
    folder: Path
    seeds: tuple[SeedAnswer, ...] = ()

    @property
    def text(self) -> str:
        """The output of ``homolog analyze``."""
        lines = [self.title]
        for finding in self.findings:
            lines += [f"  {finding.verdict}", *(f"    - {sentence}" for sentence in finding.sentences)]
        lines += [f"  Caution: {caution}" for caution in self.cautions]
        lines += [f"  {line}" for line in spread_text(self.seeds)]
        return "\n".join([*lines, f"  tables: {self.folder}"])


def analyze(
    project: str | PathLike[str],
    *,
    group: str = "group",
    regress: str | None = None,
    between: Sequence[str] = (),
    pairs: str | None = None,
    covariates: Sequence[str] = (),
    complete_cases: bool = False,
    alignment: _Alignment | Sequence[_Alignment] = _BOTH,
    modes: int | None = None,
    permutations: int = 10_000,
    null_repeats: int = 1000,
    seed: int = 0,
    seeds: int | None = None,
    primary: str | None = None,
    structure: str | None = None,
    cohort: str | None = None,
    axes: str | None = None,
    places: str | None = None,
    callback: Callable[[float, str], object] | None = None,
) -> tuple[Answer, ...]:
    """Answer a question about a project, write its tables, and add it to the project's report.

    Parameters have the names and meanings of the options of ``homolog analyze``.

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
    complete_cases : bool
        Whether subjects with missing values in the columns used are excluded, instead of refused.
    alignment : {"rigid", "similarity", "as-it-lies"}, or several of them
        Alignments before the comparison; by default form and shape.
    modes : int, optional
        Number of modes to test; chosen by parallel analysis if not given.
    permutations, null_repeats, seed : int
        Permutations of each test, repeats of the null simulation, random seed.
    seeds : int, optional
        Number of seeds of the correspondence with which run and tests are repeated; by default the stored
        ones.
    primary : str, optional
        Alignment of the primary study: reports begin with it and call all others secondary. ``""`` means the
        first alignment, ``"none"`` removes the choice.
    structure, cohort, axes, places : str, optional
        Details for reports, see `homolog.Project.describe`.
    callback : callable, optional
        ``callback(fraction, message)``; raise `Cancelled`, or any other error, in it to stop.

    Returns
    -------
    tuple of Answer
        An answer for each alignment.

    Raises
    ------
    InputError
        If there is no result, a column or group is missing, or an argument is invalid.
    """
    alignments = (alignment,) if isinstance(alignment, str) else tuple(dict.fromkeys(alignment))
    folder = ProjectFolder(Path(project))
    with folder.locked(new=False):
        result = read_result(folder)
        requests = requests_of(
            result, alignments,
            group=group, regress=regress, between=between, pairs=pairs, covariates=covariates,
            complete_cases=complete_cases, modes=modes, permutations=permutations, null_repeats=null_repeats,
            seed=seed,
        )  # fmt: skip
        chosen = primary_of(requests, primary)
        Project(project).describe(structure=structure, cohort=cohort, axes=axes, places=places)
        answers = answer_requests(folder, result, requests, seeds, tick_of(callback))
        if primary is not None:
            name_primary(folder, chosen)
        return answers


def primary_of(requests: Sequence[StudyRequest], alignment: str | None) -> StudyRequest | None:
    """Return the request that is primary: that of an alignment, or the first; None for none.

    Raises
    ------
    InputError
        If no request has the alignment.
    """
    if alignment is None or alignment == "none":
        return None
    own = [request for request in requests if alignment in ("", request.alignment.value)]
    if not own:
        raise InputError(
            f"primary study: {alignment} is not among the compared alignments; add it, or choose one of them"
        )
    return own[0]


def requests_of(
    result: Result,
    alignments: Sequence[str],
    *,
    group: str,
    regress: str | None,
    between: Sequence[str],
    pairs: str | None,
    covariates: Sequence[str],
    complete_cases: bool,
    modes: int | None,
    permutations: int,
    null_repeats: int,
    seed: int,
) -> list[StudyRequest]:
    """Return the questions of `analyze`, one for each alignment; raises InputError if they are invalid."""
    if pairs and regress:
        raise InputError("--pairs compares two groups and can't be combined with --regress; give one of them")
    if regress and between:
        raise InputError("--between names groups and can't be combined with --regress")
    column = regress or group
    if not (regress or between):
        between = reference_first(column_of(result, column))
    try:
        return [
            StudyRequest.model_validate(
                {
                    "kind": "pairs" if pairs else "regression" if regress else "groups",
                    "column": column,
                    "between": tuple(between),
                    "pairs": pairs,
                    "covariates": tuple(covariates),
                    "alignment": alignment,
                    "complete_cases": complete_cases,
                    "answers": len(alignments),
                    "modes": modes,
                    "permutations": permutations,
                    "null_repeats": null_repeats,
                    "seed": seed,
                }
            )
            for alignment in alignments
        ]
    except ValidationError as error:
        first = error.errors()[0]
        raise InputError(f"--{first['loc'][0]} {first['input']}: {fault_text(first)}") from error


def answer_requests(
    project: ProjectFolder,
    result: Result,
    requests: Sequence[StudyRequest],
    seeds: int | None = None,
    tick: Tick = no_tick,
) -> tuple[Answer, ...]:
    """Answer questions about a locked project's result, and write their tables.

    Without a number of seeds the tests are repeated for all stored correspondences.
    """
    seeds = stored_seeds(project) if seeds is None else seeds
    if seeds < 1:
        raise InputError(f"--seeds {seeds}: must be 1 or more")
    carrier = SurfaceCarrier.of(result, directions_of(read_details(project), project.read().result))
    answers = []
    for index, request in enumerate(requests):
        own = part_of(tick, 0.0, 1.0 / seeds)
        study = run_study(result, request, part_of(own, index / len(requests), (index + 1) / len(requests)))
        folder = save_study(project, study, result, carrier)
        answers.append(
            Answer(
                request.title, study.overall, study.pairwise, tuple(findings(study)), tuple(cautions(study)),
                folder,
            )
        )  # fmt: skip
    if seeds == 1:
        return tuple(answers)
    by_seed = answer_by_seed(project, result, requests, seeds, part_of(tick, 1.0 / seeds, 1.0))
    for answer, spread in zip(answers, by_seed, strict=True):
        write_spread(answer.folder, spread)
    return tuple(
        replace(answer, seeds=tuple(spread)) for answer, spread in zip(answers, by_seed, strict=True)
    )


def report(
    project: str | PathLike[str],
    *,
    structure: str | None = None,
    cohort: str | None = None,
    axes: str | None = None,
    places: str | None = None,
    callback: Callable[[float, str], object] | None = None,
) -> Path:
    """Write the report of a project's model and studies, as HTML and PDF, as ``homolog report`` does.

    Parameters
    ----------
    project : path
        A project with a result; the report contains the studies stored by `analyze`, the command line or the
        window.
    structure, cohort, axes, places : str, optional
        Details for the report, see `homolog.Project.describe`.
    callback : callable, optional
        ``callback(fraction, message)``; raise `Cancelled`, or any other error, in it to stop.

    Returns
    -------
    Path
        The page ``report/report.html``, next to ``report.pdf`` and the figures.

    Raises
    ------
    InputError
        If there is no result, a stored study is no longer possible, or the folder can't be written to.
    """
    folder = ProjectFolder(Path(project))
    with folder.locked(new=False):
        Project(project).describe(structure=structure, cohort=cohort, axes=axes, places=places)
        return write_report(folder, tick_of(callback))
