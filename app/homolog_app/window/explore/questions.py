"""Which columns of a cohort's table a question can be about. Knows no Qt."""

from homolog.analysis.covariates import numbers
from homolog.errors import InputError
from homolog_app.window.study import Study

__all__ = ["SIZE", "covariates_of", "numbers_of", "values_of"]

SIZE = "size"
"""The shapes' own size, which is always there."""

_LEAST = 2
_FEWEST_NUMBERS = 3


def values_of(study: Study, column: str) -> list[str]:
    """Return the values of a column that two or more included subjects have, sorted."""
    cells = _cells(study, column)
    return sorted({cell for cell in cells if cell and cells.count(cell) >= _LEAST})


def numbers_of(study: Study) -> dict[str, str]:
    """Return the columns that hold numbers, not all alike, and what speaks against each, or nothing.

    Size is among them; those that can't be used come last.
    """
    found = {SIZE: ""}
    for column in study.columns:
        try:
            values = numbers([cell for cell in _cells(study, column) if cell])
        except InputError as error:
            found[column] = str(error)
            continue
        if values is not None and len(set(values.tolist())) >= _FEWEST_NUMBERS:
            found[column] = _missing(study, column)
    return dict(sorted(found.items(), key=lambda one: (bool(one[1]), one[0] == SIZE)))


def covariates_of(study: Study, column: str) -> dict[str, str]:
    """Return the columns that can be allowed for beside one, and what speaks against each, or nothing."""
    found = {}
    for name in ("group", *study.columns, SIZE):
        if name == column:
            continue
        cells = _cells(study, name)
        if name == SIZE:
            found[name] = ""
        elif any(cells):
            alike = len(set(cells)) == 1
            found[name] = _missing(study, name) or ("The same for all subjects" if alike else "")
    return found


def _missing(study: Study, column: str) -> str:
    """Say which subjects have no value, if any."""
    cells = _cells(study, column)
    gone = [one.name for one, cell in zip(study.included, cells, strict=True) if not cell]
    return f"No value for {', '.join(gone[:3])}{' …' * (len(gone) > 3)}" if gone else ""


def _cells(study: Study, column: str) -> list[str]:
    return [one.group or "" if column == "group" else one.columns.get(column, "") for one in study.included]
