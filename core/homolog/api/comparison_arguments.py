"""Arguments of comparisons: checks, and conversion for the analysis."""

from collections.abc import Mapping, Sequence

import numpy as np

from homolog.arrays import Array, BoolArray, FloatArray, IntArray
from homolog.cohort.column_types import CATEGORY
from homolog.errors import InputError
from homolog.statistics.data_notes import PARTNER_MISSING, exclusion_notes, spelling_notes
from homolog.statistics.design import covariate_columns, is_missing, numbers
from homolog.statistics.procrustes import Alignment
from homolog.statistics.studies import pair_members

__all__ = [
    "Covariates",
    "check_options",
    "check_values",
    "columns_of",
    "incomplete",
    "notes_on",
    "pairs_of",
    "table_of",
    "unpaired",
]

Covariates = Mapping[str, Sequence[str | float] | Array]


def check_options(alignments: Sequence[str], permutations: int) -> None:
    """Refuse unknown alignments and a number of permutations below one."""
    known = [item.value for item in Alignment]
    for alignment in alignments:
        if alignment not in known:
            raise InputError(f"alignment={alignment!r}: choose one or several of {', '.join(known)}")
    if not alignments or len(set(alignments)) < len(alignments):
        raise InputError(f"alignment={tuple(alignments)}: give one or more, each once")
    if permutations < 1:
        raise InputError(f"permutations={permutations}: a permutation test needs at least one")


def pairs_of(
    pairs: Sequence[str | None],
    labels: Array,
    order: Sequence[str],
    covariates: Covariates | None,
    names: Sequence[str] | None,
) -> tuple[IntArray, IntArray]:
    """Return the first and the second subject of each pair."""
    if any(isinstance(pair, tuple | list) for pair in pairs):
        raise InputError("pairs: give the name of each subject's pair; `between` chooses the groups")
    _check_length(pairs, labels)
    if len(order) != 2 or covariates:
        raise InputError("pairs: a paired comparison is between two groups and takes no covariates")
    known = [label for label in dict.fromkeys(map(str, labels)) if label]
    for group in order:
        if group not in known:
            raise InputError(f"no subject is in {group!r}; groups are: {', '.join(known)}")
    return pair_members(_texts(pairs), labels.tolist(), (order[0], order[1]), names)


def columns_of(
    covariates: Covariates | None,
    chosen: Sequence[int],
    subjects: int,
    names: Sequence[str] | None,
) -> FloatArray | None:
    """Return the columns (m, c) of the covariates of the compared subjects."""
    if not covariates:
        return None
    for title, values in covariates.items():
        check_values(title, values, subjects)
    table = table_of(covariates, chosen)
    return covariate_columns(table, names, categories=[title for title in table if title.endswith(CATEGORY)])


def table_of(covariates: Covariates | None, chosen: Sequence[int]) -> dict[str, list[str | float]]:
    """Return the values of each covariate for the compared subjects."""
    return {title: [values[index] for index in chosen] for title, values in (covariates or {}).items()}


def incomplete(subjects: int, covariates: Covariates | None, members: BoolArray) -> dict[int, str]:
    """Return the members that lack a covariate's value, with the reason, by index."""
    reasons: dict[int, str] = {}
    for title, values in (covariates or {}).items():
        check_values(title, values, subjects)
        for index in np.flatnonzero(members).tolist():
            if is_missing(values[index]):
                reasons.setdefault(index, f"no value of {title.removesuffix(CATEGORY)}")
    return reasons


def unpaired(pairs: Sequence[str | None], labels: Array, order: Sequence[str]) -> dict[int, str]:
    """Return the subjects of two groups without a pair or a partner, with the reason, by index."""
    _check_length(pairs, labels)
    reasons: dict[int, str] = {}
    by_pair: dict[str, list[int]] = {}
    for index, (pair, label) in enumerate(zip(_texts(pairs), labels.tolist(), strict=True)):
        if label not in order:
            continue
        if pair:
            by_pair.setdefault(pair, []).append(index)
        else:
            reasons[index] = "no value of pairs"
    return reasons | {members[0]: PARTNER_MISSING for members in by_pair.values() if len(members) == 1}


def notes_on(
    excluded: Mapping[int, str],
    names: Sequence[str] | None,
    covariates: Covariates | None,
    groups: Sequence[str] = (),
) -> tuple[str, ...]:
    """Return notes on excluded subjects, and on values that may be spellings of one value."""
    called = {
        f"subject {index + 1}" if names is None else names[index]: why for index, why in excluded.items()
    }
    notes = exclusion_notes(called) + spelling_notes("groups", groups)
    for title, values in (covariates or {}).items():
        texts = [str(value) for value in values]
        if title.endswith(CATEGORY) or _are_words(texts):
            notes += spelling_notes(repr(title), texts)
    return tuple(notes)


def _are_words(texts: Sequence[str]) -> bool:
    given = [text for text in texts if not is_missing(text)]
    return numbers(given) is None


def _texts(pairs: Sequence[str | None]) -> list[str]:
    return ["" if pair is None or is_missing(pair) else str(pair) for pair in pairs]


def _check_length(pairs: Sequence[str | None], labels: Array) -> None:
    if len(pairs) != len(labels):
        raise InputError(f"pairs: {len(pairs)} given for {len(labels)} subjects; give one for each")


def check_values(title: str, values: Sequence[str | float] | Array, subjects: int) -> None:
    """Refuse anything but one value for each subject."""
    is_sequence = hasattr(values, "__len__") and not isinstance(values, str)
    if not is_sequence or getattr(values, "ndim", 1) != 1 or any(map(np.ndim, values)):
        raise InputError(f"{title!r}: must be a sequence of values, one for each subject")
    if len(values) != subjects:
        raise InputError(f"{title!r}: {len(values)} values for {subjects} subjects; give one for each")
