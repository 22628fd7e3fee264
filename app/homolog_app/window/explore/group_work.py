"""Asking, keeping and repeating questions about groups or a number, in the computing thread. Knows no Qt."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from homolog.files.project import ProjectFolder
from homolog.files.results import Result
from homolog.progress import Tick, part_of
from homolog_app.report.request import StudyRequest, category_of
from homolog_app.window.explore.current_table import with_present_table
from homolog_app.window.study import Study as Cohort

if TYPE_CHECKING:
    from homolog_app.report.study import Study
    from homolog_app.window.explore.group_answer import GroupAnswer
    from homolog_app.window.explore.model_shape import ModelShape

__all__ = [
    "Answers",
    "Question",
    "answer_question",
    "map_answers",
    "question_of",
    "repeat_by_seed",
    "save_answers",
]


@dataclass(frozen=True, slots=True)
class Question:
    """What is asked at once, and of what.

    Attributes
    ----------
    requests : tuple of StudyRequest
        One, or one for each alignment.
    cells : tuple of (str, ...)
        The columns of the table that are used, a value for each subject of the result.
    """

    requests: tuple[StudyRequest, ...]
    cells: tuple[tuple[str, ...], ...]

    @property
    def titles(self) -> frozenset[str]:
        """What tells the requests from others, however precisely they are answered."""
        return frozenset(request.question for request in self.requests)

    @property
    def arguments(self) -> list[str]:
        """The options of ``homolog analyze`` that ask it."""
        return [*self.requests[0].arguments, *(request.alignment.value for request in self.requests[1:])]


@dataclass(frozen=True, slots=True, eq=False)
class Answers:
    """The answers to a question.

    Attributes
    ----------
    question : Question
    models : tuple of ModelShape
        That it was asked of: the open one's, and one to compare with or none.
    studies : tuple of (Study, ...)
        For each request, that of each model.
    """

    question: Question
    models: "tuple[ModelShape, ...]"
    studies: "tuple[tuple[Study, ...], ...]"

    @property
    def own(self) -> "tuple[Study, ...]":
        """The studies of the open result, one for each request."""
        return tuple(row[0] for row in self.studies)


def question_of(requests: Sequence[StudyRequest], result: Result, cohort: Cohort) -> Question:
    """Return a question with what the table holds of it now, so that a later change can be told."""
    present = with_present_table(result, cohort)
    known = {name for columns in present.columns for name in columns}
    used = [request.column for request in requests]
    used += [category_of(name, known)[0] for request in requests for name in request.covariates]
    cells = tuple(
        tuple(group or "" for group in present.groups)
        if column == "group"
        else tuple(columns.get(column, "") for columns in present.columns)
        for column in dict.fromkeys(used)
    )
    return Question(tuple(requests), cells)


def answer_question(
    models: "Sequence[ModelShape]", cohort: Cohort, requests: Sequence[StudyRequest], tick: Tick
) -> "tuple[Answers, list[GroupAnswer]]":
    """Answer all requests in each model, and carry the first two groups' difference to the surface.

    Raises
    ------
    InputError
        If groups are too small or values missing; says which.
    """
    from homolog_app.report.study import run_study

    count = len(models) * len(requests)
    studies: list[Study] = []
    for index, request in enumerate(requests):
        for number, model in enumerate(models):
            done = index * len(models) + number
            part = part_of(tick, 0.9 * done / count, 0.9 * (done + 1) / count)
            studies.append(run_study(with_present_table(model.result, cohort), request, part))
    rows = tuple(tuple(studies[at : at + len(models)]) for at in range(0, count, len(models)))
    answers = Answers(question_of(requests, models[0].result, cohort), tuple(models), rows)
    return answers, map_answers(answers, models, cohort, (0, 0), part_of(tick, 0.9, 1.0))


def map_answers(
    answers: Answers, models: "Sequence[ModelShape]", cohort: Cohort, which: tuple[int, int], tick: Tick
) -> "list[GroupAnswer]":
    """Carry a difference or slope to the surface of those models that are still shown.

    Parameters
    ----------
    answers : Answers
    models : sequence of ModelShape
        Those that are shown.
    cohort : Study
        With the table as it is now.
    which : (int, int)
        Request, and pair of its groups.
    tick : Tick
        Progress and cancelling.
    """
    from homolog_app.window.explore.group_answer import carried_answer

    return [
        carried_answer(model, with_present_table(model.result, cohort), study, which[1], tick)
        for model, study in zip(answers.models, answers.studies[which[0]], strict=True)
        if model in models
    ]


def save_answers(project: ProjectFolder, answers: Answers, cohort: Cohort, tick: Tick) -> list[Path]:
    """Write the tables of all answers into the project, as ``homolog analyze`` does; return their folders."""
    from homolog_app.report.tables import save_study

    tick(0.0, "keeping the answer")
    result = with_present_table(answers.models[0].result, cohort)
    return [save_study(project, study, result) for study in answers.own]


def repeat_by_seed(
    project: ProjectFolder, answers: Answers, cohort: Cohort, seeds: int, tick: Tick
) -> list[str]:
    """Answer with other seeds of the correspondence too, as ``--seeds`` does; keep what spreads."""
    from homolog_app.report.seeds import answer_by_seed, spread_text, write_spread
    from homolog_app.report.tables import save_study

    result = with_present_table(answers.models[0].result, cohort)
    requests = answers.question.requests
    spreads = answer_by_seed(project, result, requests, seeds, tick)
    sentences = []
    for study, spread in zip(answers.own, spreads, strict=True):
        write_spread(save_study(project, study, result), spread)
        sentences += [
            f"{study.request.title}: " * (len(requests) > 1) + sentence for sentence in spread_text(spread)
        ]
    return sentences
