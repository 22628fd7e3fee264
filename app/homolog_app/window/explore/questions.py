"""Which columns of a cohort's table a question can be about. Knows no Qt."""

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


def numbers_of(study: Study) -> list[str]:
    """Return the columns that hold a number for each included subject, and not all alike; then size."""
    found = []
    for column in study.columns:
        numbers = {_number(cell) for cell in _cells(study, column)}
        if None not in numbers and len(numbers) >= _FEWEST_NUMBERS:
            found.append(column)
    return [*found, SIZE]


def covariates_of(study: Study, column: str) -> dict[str, str]:
    """Return the columns that can be allowed for beside one, and what speaks against each, or nothing."""
    found = {}
    for name in ("group", *study.columns, SIZE):
        if name == column:
            continue
        cells = _cells(study, name)
        gone = [one.name for one, cell in zip(study.included, cells, strict=True) if not cell]
        if name == SIZE:
            found[name] = ""
        elif len(gone) < len(cells):
            alike = len(set(cells)) == 1
            missing = f"No value for {', '.join(gone[:3])}{' …' * (len(gone) > 3)}" if gone else ""
            found[name] = missing or ("The same for all subjects" if alike else "")
    return found


def _cells(study: Study, column: str) -> list[str]:
    return [one.group or "" if column == "group" else one.columns.get(column, "") for one in study.included]


def _number(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None
