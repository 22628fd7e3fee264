"""Questions to a project: answered, written as tables, repeated with other seeds."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from homolog.comparison.answer import Answer
from homolog.comparison.ask import ask
from homolog.comparison.findings import Finding, answer_text, cautions, findings
from homolog.comparison.places import SurfaceCarrier, directions_of
from homolog.comparison.question import Question, alignment_of, questions
from homolog.comparison.sample import Sample, levels
from homolog.comparison.seeds import SeedAnswer, answer_by_seed, spread_text, stored_seeds, write_spread
from homolog.comparison.tables import store
from homolog.errors import InputError
from homolog.io.project import ProjectFolder
from homolog.io.report_details import read_details
from homolog.io.results import Result
from homolog.progress import Tick, no_tick, part_of
from homolog.statistics.comparison import Comparison
from homolog.statistics.design import reference_first
from homolog.statistics.procrustes import Alignment

__all__ = ["StudyAnswer", "analyze_result", "primary_of", "questions_of", "repeat_answers"]


@dataclass(frozen=True, slots=True, eq=False)
class StudyAnswer:
    """An answer that was written into a project.

    Attributes
    ----------
    answer : Answer
        The question and all tests.
    findings : tuple of Finding
        Findings of each comparison, in sentences.
    cautions : tuple of str
        Cautions as sentences.
    folder : Path
        Folder of the tables.
    seeds : tuple of SeedAnswer
        The answers of each seed of the correspondence, if there are several.
    """

    answer: Answer
    findings: tuple[Finding, ...]
    cautions: tuple[str, ...]
    folder: Path
    seeds: tuple[SeedAnswer, ...] = ()

    @property
    def title(self) -> str:
        """The question and the alignment."""
        return self.answer.question.title

    @property
    def comparison(self) -> Comparison:
        """Comparison of all groups, or of the only pair."""
        return self.answer.overall

    @property
    def pairwise(self) -> tuple[Comparison, ...]:
        """Comparisons of pairs of three or more groups."""
        return self.answer.pairwise

    @property
    def text(self) -> str:
        """The output of ``homolog analyze``."""
        lines = [answer_text(self.answer, self.findings)]
        lines += [f"  {line}" for line in spread_text(self.seeds)]
        return "\n".join([*lines, f"  tables: {self.folder}"])


def questions_of(
    result: Result,
    alignments: Sequence[str],
    *,
    group: str = "group",
    regress: str | None = None,
    between: Sequence[str] = (),
    pairs: str | None = None,
    formula: str | None = None,
    **given: object,
) -> tuple[Question, ...]:
    """Return the questions of ``homolog analyze``, one for each alignment.

    Parameters
    ----------
    result : Result
        Result of the project.
    alignments : sequence of str
        Alignments of the shapes before the comparison.
    group, regress : str
        Column of groups, or of the variable that is tested instead.
    between : sequence of str
        Groups, the reference first; by default all, controls first.
    pairs : str, optional
        Column that identifies pairs.
    formula : str, optional
        Terms to test, in place of groups.
    **given
        Covariates and precision: further attributes of `Question`.

    Raises
    ------
    InputError
        If they are invalid.
    """
    if formula is not None:
        return questions(alignments, kind="formula", column="", formula=formula, **given)
    if pairs and regress:
        raise InputError("pairs compare two groups and can't be combined with a regression; give one of them")
    if regress and between:
        raise InputError("groups to be compared can't be combined with a regression")
    column = regress or group
    if not (regress or between):
        between = reference_first(levels(Sample.of(result).column(column)))
    return questions(
        alignments,
        kind="pairs" if pairs else "regression" if regress else "groups",
        column=column,
        between=tuple(between),
        pairs=pairs,
        **given,
    )


def primary_of(requested: Sequence[Question], alignment: str | None) -> Question | None:
    """Return the question that is primary: that of an alignment, or the first; None for none.

    Raises
    ------
    InputError
        If no question has the alignment.
    """
    if alignment is None or alignment == "none":
        return None
    wanted = [alignment_of(alignment)] if alignment else list(Alignment)
    own = [question for question in requested if question.alignment in wanted]
    if not own:
        raise InputError(
            f"primary study: {alignment} is not among the compared alignments; add it, or choose one of them"
        )
    return own[0]


def analyze_result(
    project: ProjectFolder,
    result: Result,
    requested: Sequence[Question],
    seeds: int | None = None,
    tick: Tick = no_tick,
) -> tuple[StudyAnswer, ...]:
    """Answer questions about a locked project's result, and write their tables.

    Without a number of seeds the tests are repeated for all stored correspondences.
    """
    seeds = stored_seeds(project) if seeds is None else seeds
    if seeds < 1:
        raise InputError(f"--seeds {seeds}: must be 1 or more")
    carrier = SurfaceCarrier.of(result, directions_of(read_details(project)))
    sample, answers, own = Sample.of(result), list[StudyAnswer](), part_of(tick, 0.0, 1.0 / seeds)
    for index, question in enumerate(requested):
        answer = ask(sample, question, part_of(own, index / len(requested), (index + 1) / len(requested)))
        folder = store(project, answer, result, carrier)
        answers.append(StudyAnswer(answer, tuple(findings(answer, carrier)), tuple(cautions(answer)), folder))
    if seeds == 1:
        return tuple(answers)
    by_seed = answer_by_seed(project, result, requested, seeds, part_of(tick, 1.0 / seeds, 1.0))
    for done, spread in zip(answers, by_seed, strict=True):
        write_spread(done.folder, spread)
    return tuple(replace(done, seeds=tuple(spread)) for done, spread in zip(answers, by_seed, strict=True))


def repeat_answers(
    project: ProjectFolder, result: Result, answers: Sequence[Answer], seeds: int, tick: Tick
) -> list[str]:
    """Answer also with other seeds of the correspondence; store all answers, and return sentences."""
    spreads = answer_by_seed(project, result, [answer.question for answer in answers], seeds, tick)
    sentences = []
    for answer, spread in zip(answers, spreads, strict=True):
        write_spread(store(project, answer, result), spread)
        title = f"{answer.question.title}: " if len(answers) > 1 else ""
        sentences += [f"{title}{sentence}" for sentence in spread_text(spread)]
    return sentences
