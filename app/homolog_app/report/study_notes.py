"""What a reader should know of the data that a question was asked of, in sentences."""

from collections.abc import Mapping, Sequence

from homolog.analysis.design import lookalikes, numbers
from homolog.files.results import Result
from homolog_app.report.columns import SHAPE_SIZE, SIZE, column_of, columns_of
from homolog_app.report.request import StudyRequest, category_of

__all__ = ["PARTNER_MISSING", "exclusion_notes", "study_notes"]

PARTNER_MISSING = "the other one of the pair is missing"


def exclusion_notes(left_out: Mapping[str, str]) -> list[str]:
    """Return how many subjects complete cases excluded and why, and the first of them."""
    alone = [name for name, why in left_out.items() if why == PARTNER_MISSING]
    incomplete = [name for name in left_out if name not in alone]
    reasons = ((incomplete, "for missing values"), (alone, "because the other one of their pair is missing"))
    return [
        f"{_counted(names)} excluded {reason} (complete cases): {_some(names)}."
        for names, reason in reasons
        if names
    ]


def _counted(names: Sequence[str]) -> str:
    return "1 subject was" if len(names) == 1 else f"{len(names)} subjects were"


def _some(names: Sequence[str]) -> str:
    return ", ".join(names[:5]) + (", …" if len(names) > 5 else "")


def study_notes(result: Result, request: StudyRequest) -> tuple[str, ...]:
    """Return what is told of columns and of questions of earlier versions."""
    known = columns_of(result)
    covariates = dict(category_of(covariate, known) for covariate in request.covariates)
    columns = list(covariates)
    notes = []
    for column in dict.fromkeys([*([] if request.kind == "regression" else [request.column]), *columns]):
        for alike in lookalikes(column_of(result, column)):
            if not covariates.get(column, True) and numbers(column_of(result, column)) is not None:
                continue
            spelled = " and ".join(repr(item) for item in alike)
            notes.append(f"Column {column!r} contains {spelled}, which were treated as different values.")
    if SIZE in known and SIZE in (request.column, *columns):
        notes.append(f"'size' is the column of the cohort's table; the size of the shapes is {SHAPE_SIZE!r}.")
    if request.earlier:
        notes.append(
            "An earlier version stored this question and compared shapes as they lie. They are now aligned "
            "rigidly first; alignment as-it-lies gives the earlier answer."
        )
    return tuple(notes)
