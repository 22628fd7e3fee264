"""Controls with several times in a project's table."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from homolog.errors import InputError
from homolog.io.project import ProjectFolder
from homolog.io.results import Result

__all__ = ["FEWEST_PAIRS", "SeenTwice", "seen_twice"]

FEWEST_PAIRS = 8
"""Least number of controls with two times."""


@dataclass(frozen=True, slots=True)
class SeenTwice:
    """First and next times of persons.

    Attributes
    ----------
    first : list of int
        Indices of each person's first time in the result.
    later : mapping of int to int
        Index of the next time in the result, by position in `first`, for persons with several times.
    between : str
        Interval between both times, as text.
    """

    first: list[int]
    later: Mapping[int, int]
    between: str


def seen_twice(
    result: Result, chosen: Sequence[int], person: str, time: str, project: ProjectFolder
) -> SeenTwice:
    """Find the times of each person.

    Parameters
    ----------
    result : Result
    chosen : sequence of int
        Indices of the controls in the result.
    person, time : str
        Columns of the cohort's table. Times are ordered as numbers if all are numbers, else as text.
    project : ProjectFolder
        The project, for messages.

    Raises
    ------
    InputError
        If a value is missing, a person has two files of one time, or too few persons have two times.
    """
    persons, times = (
        [_cell(result, index, column, project) for index in chosen] for column in (person, time)
    )
    keys: Sequence[float | str] = _ordered(times)
    seen: dict[str, list[tuple[float | str, int]]] = defaultdict(list)
    for who, key, index in zip(persons, keys, chosen, strict=True):
        seen[who].append((key, index))
    first: list[int] = []
    later: dict[int, int] = {}
    spans: list[tuple[float | str, float | str]] = []
    for who, times_of in seen.items():
        times_of.sort()  # all of one type, see _ordered
        if len({key for key, _ in times_of}) < len(times_of):
            raise InputError(f"{project.folder}: {who} has two files of one {time}; correct column {time}")
        if len(times_of) > 1:
            later[len(first)] = times_of[1][1]
            spans.append((times_of[0][0], times_of[1][0]))
        first.append(times_of[0][1])
    if len(later) < FEWEST_PAIRS:
        raise InputError(
            f"{project.folder}: {len(later)} of {len(first)} controls were scanned twice (columns {person} "
            f"and {time}); {FEWEST_PAIRS} are needed for the expected change"
        )
    return SeenTwice(first, later, _between(spans, time))


def _cell(result: Result, index: int, column: str, project: ProjectFolder) -> str:
    value = result.columns[index].get(column, "").strip()
    if not value:
        raise InputError(
            f"{project.folder}: {result.names[index]} has no value in column {column}; add it (homolog table)"
        )
    return value


def _ordered(times: Sequence[str]) -> list[float] | list[str]:
    try:
        return [float(item) for item in times]
    except ValueError:
        return list(times)


def _between(spans: Sequence[tuple[float | str, float | str]], time: str) -> str:
    gaps = [end - begin for begin, end in spans if isinstance(begin, float) and isinstance(end, float)]
    if gaps:
        least, most = min(gaps), max(gaps)
        return f"{time} apart by {least:g}" + (f" to {most:g}" if most > least else "")
    return f"{time} {spans[0][0]} to {spans[0][1]}" if len(set(spans)) == 1 else f"differing {time}"
