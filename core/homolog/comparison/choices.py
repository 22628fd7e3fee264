"""Possible questions about a cohort: columns that may be groups, numbers, covariates, pairs or strata."""

from collections import Counter

from homolog.cohort import Cohort
from homolog.cohort.column_types import CATEGORY
from homolog.comparison.sample import SHAPE_SIZE, SIZE
from homolog.errors import InputError
from homolog.statistics.design import is_missing, numbers

__all__ = [
    "covariates_of",
    "has_missing",
    "numbers_of",
    "pairings_of",
    "size_name",
    "strata_of",
    "subjects_of",
    "values_of",
]


_LEAST = 2
_FEWEST_NUMBERS = 3
_MOST_CATEGORIES = 12


def size_name(cohort: Cohort) -> str:
    """Return the name of the shapes' size: ``size``, unless the table has a column of that name."""
    return SHAPE_SIZE if SIZE in cohort.columns else SIZE


def values_of(cohort: Cohort, column: str) -> list[str]:
    """Return the values of a column that two or more subjects have, sorted."""
    counts = Counter(_cells(cohort, column))
    return sorted(cell for cell, count in counts.items() if cell and count >= _LEAST)


def numbers_of(cohort: Cohort, *, complete: bool = False) -> dict[str, str]:
    """Return the numeric columns, each with the reason why it can't be used, or an empty text.

    Size is included; unusable columns come last. With `complete`, missing values are allowed.
    """
    own = size_name(cohort)
    problems = {own: ""}
    for column in cohort.columns:
        if column.endswith(CATEGORY):
            continue
        try:
            values = numbers([cell for cell in _cells(cohort, column) if cell])
        except InputError as error:
            problems[column] = str(error)
            continue
        if values is not None and len(set(values.tolist())) >= _FEWEST_NUMBERS:
            problems[column] = "" if complete else _missing(cohort, column)
    return dict(sorted(problems.items(), key=lambda item: (bool(item[1]), item[0] == own)))


def has_missing(cohort: Cohort) -> bool:
    """Return whether a subject lacks a value of a column."""
    return any(_missing(cohort, column) for column in cohort.columns)


def covariates_of(cohort: Cohort, column: str, *, complete: bool = False) -> dict[str, str]:
    """Return the possible covariates for a column, each with a reason why it can't be used, or an empty text.

    Numbers with few values are also offered as codes of categories (``site:c``).
    """
    problems = {}
    own = size_name(cohort)
    for name in ("group", *cohort.columns, own):
        if name == column:
            continue
        cells = _cells(cohort, name)
        if name == own:
            problems[name] = ""
        elif any(cells):
            missing = "" if complete else _missing(cohort, name)
            problems[name] = missing or _unusable([cell for cell in cells if cell])
            if _are_codes(cells) and not name.endswith(CATEGORY):
                problems[f"{name}{CATEGORY}"] = problems[name]
    return problems


def _unusable(cells: list[str]) -> str:
    """Return why values can't be adjusted for: all equal, or too many categories."""
    several = len(set(cells))
    if several == 1:
        return "The same for all subjects"
    try:
        categorical = numbers(cells) is None
    except InputError as error:
        return str(error)
    return (
        f"{several} different values, too many for categories"
        if categorical and several > len(cells) / 2
        else ""
    )


def pairings_of(cohort: Cohort, column: str, between: tuple[str, str]) -> list[str]:
    """Return the columns that uniquely pair at least half of the subjects with two values of a column."""
    labels = _cells(cohort, column)
    offered = []
    for name in ("group", *cohort.columns):
        places = [
            (cell, label)
            for cell, label in zip(_cells(cohort, name), labels, strict=True)
            if cell and label in between
        ]
        pairs = list(Counter(cell for cell, _ in places).values()).count(2)
        alone = len(set(places)) == len(places)
        if name != column and alone and pairs >= max(_LEAST, sum(label in between for label in labels) / 4):
            offered.append(name)
    return offered


def subjects_of(cohort: Cohort) -> list[str]:
    """Return the columns that may name subjects of repeated measures: more values than rows of one value."""
    counts = {name: Counter(_cells(cohort, name)) for name in cohort.columns}
    return [
        name for name, own in counts.items() if "" not in own and 1 < max(own.values(), default=0) < len(own)
    ]


def strata_of(cohort: Cohort) -> list[str]:
    """Return the columns that may be strata: each value stands in two rows or more."""
    counts = {name: Counter(_cells(cohort, name)) for name in cohort.columns}
    return [
        name for name, own in counts.items() if "" not in own and len(own) > 1 and min(own.values()) >= _LEAST
    ]


def _are_codes(cells: list[str]) -> bool:
    try:
        values = numbers([cell for cell in cells if cell])
    except InputError:
        return False
    return values is not None and 2 < len(set(values.tolist())) <= min(_MOST_CATEGORIES, len(cells) // 2)


def _missing(cohort: Cohort, column: str) -> str:
    """Name the subjects without a value, if any."""
    cells = _cells(cohort, column)
    names = [subject.name for subject, cell in zip(cohort.subjects, cells, strict=True) if not cell]
    return f"No value for {', '.join(names[:3])}{' …' * (len(names) > 3)}" if names else ""


def _cells(cohort: Cohort, column: str) -> list[str]:
    """Return a column, missing values as empty text."""
    cells = [
        subject.group or "" if column == "group" else subject.columns.get(column, "")
        for subject in cohort.subjects
    ]
    return ["" if is_missing(cell) else cell for cell in cells]
