"""Which columns of a cohort's table a question can be about. Knows no Qt."""

from collections import Counter

from homolog.analysis.design import is_missing, numbers
from homolog.cohort.column_types import CATEGORY
from homolog.errors import InputError
from homolog_app.report.study import SHAPE_SIZE
from homolog_app.window.study import Study

__all__ = ["SIZE", "covariates_of", "numbers_of", "size_name", "values_of"]

SIZE = "size"
_LEAST = 2
_FEWEST_NUMBERS = 3
_MOST_CATEGORIES = 12


def size_name(study: Study) -> str:
    """Return what the shapes' own size is called: ``size``, unless the table has a column of that name."""
    return SHAPE_SIZE if SIZE in study.columns else SIZE


def values_of(study: Study, column: str) -> list[str]:
    """Return the values of a column that two or more included subjects have, sorted."""
    counts = Counter(_cells(study, column))
    return sorted(cell for cell, count in counts.items() if cell and count >= _LEAST)


def numbers_of(study: Study, *, complete: bool = False) -> dict[str, str]:
    """Return the columns that hold numbers, not all alike, and what speaks against each, or nothing.

    Size is among them; those that can't be used come last. With `complete`, missing values are no fault.
    """
    own = size_name(study)
    problems = {own: ""}
    for column in study.columns:
        if column.endswith(CATEGORY):
            continue
        try:
            values = numbers([cell for cell in _cells(study, column) if cell])
        except InputError as error:
            problems[column] = str(error)
            continue
        if values is not None and len(set(values.tolist())) >= _FEWEST_NUMBERS:
            problems[column] = "" if complete else _missing(study, column)
    return dict(sorted(problems.items(), key=lambda item: (bool(item[1]), item[0] == own)))


def covariates_of(study: Study, column: str, *, complete: bool = False) -> dict[str, str]:
    """Return the columns that can be adjusted for beside one, and what speaks against each, or nothing.

    Numbers with few values are offered as codes of categories too (``site:c``).
    """
    problems = {}
    own = size_name(study)
    for name in ("group", *study.columns, own):
        if name == column:
            continue
        cells = _cells(study, name)
        if name == own:
            problems[name] = ""
        elif any(cells):
            alike = len({cell for cell in cells if cell}) == 1
            missing = "" if complete else _missing(study, name)
            problems[name] = missing or ("The same for all subjects" if alike else "")
            if _are_codes(cells) and not name.endswith(CATEGORY):
                problems[f"{name}{CATEGORY}"] = problems[name]
    return problems


def _are_codes(cells: list[str]) -> bool:
    try:
        values = numbers([cell for cell in cells if cell])
    except InputError:
        return False
    return values is not None and 2 < len(set(values.tolist())) <= min(_MOST_CATEGORIES, len(cells) // 2)


def _missing(study: Study, column: str) -> str:
    """Say which subjects have no value, if any."""
    cells = _cells(study, column)
    gone = [subject.name for subject, cell in zip(study.included, cells, strict=True) if not cell]
    return f"No value for {', '.join(gone[:3])}{' …' * (len(gone) > 3)}" if gone else ""


def _cells(study: Study, column: str) -> list[str]:
    """Return a column of the included subjects, missing values as empty text."""
    cells = [
        subject.group or "" if column == "group" else subject.columns.get(column, "")
        for subject in study.included
    ]
    return ["" if is_missing(cell) else cell for cell in cells]
