"""The sample of an answer, described by group: numbers, size of the shapes, covariates, other columns."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from homolog.comparison.answer import Answer
from homolog.comparison.sample import SHAPE_SIZE, SIZE, Sample, category_of
from homolog.errors import InputError
from homolog.io.results import Result
from homolog.statistics.design import numbers

__all__ = ["VOXEL", "SampleRow", "sample_rows", "voxel_text"]

VOXEL = "voxel"
"""Variable whose categories are edges of voxels [mm], the shortest first."""
_MOST_CATEGORIES = 8
"""Limit for columns outside the questions to be included in the description of the sample."""


@dataclass(frozen=True, slots=True)
class SampleRow:
    """The number of subjects of a group, or mean, standard deviation and range of a variable in it.

    Attributes
    ----------
    group, variable, category : str
        The category is empty for numeric variables.
    count : int
        Number of subjects in the category, or with a value.
    mean, spread, least, largest : float or None
        None for counts of subjects; the spread also for one subject.
    unit : str
        Unit of the variable; empty if the cohort's table gives none.
    """

    group: str
    variable: str
    category: str
    count: int
    mean: float | None = None
    spread: float | None = None
    least: float | None = None
    largest: float | None = None
    unit: str = ""


def sample_rows(answer: Answer, result: Result) -> list[SampleRow]:
    """Describe the sample by group: numbers, size of the shapes, covariates, other columns."""
    question, sample = answer.question, Sample.of(result)
    taking = [index for index, name in enumerate(result.names) if name not in answer.left_out]
    groups: dict[str, list[int]] = {"all": taking}
    if question.between:
        groups = {
            item: [index for index in taking if answer.labels[index] == item] for item in question.between
        }
    known = sample.columns
    variables = [SHAPE_SIZE, *([question.column] if question.kind == "regression" else [])]
    variables += [
        covariate for covariate in question.named_columns if category_of(covariate, known)[0] not in variables
    ]
    named = {category_of(variable, known)[0] for variable in variables} | {question.column, question.pairs}
    for column in sorted(set(known) - named - {"group"}):
        cells = sample.texts(column)
        if _describes({cells[index] for index in taking} - {""}):
            variables.append(column)
    rows: list[SampleRow] = []
    for group, members in groups.items():
        rows.append(SampleRow(group, "subjects", "", len(members)))
        for variable in variables:
            column, is_category = category_of(variable, known)
            cells = sample.texts(column)
            values = {cells[index] for index in taking} - {""}
            if is_category or numbers(sorted(values)) is None:
                for level in sorted(values):
                    count = sum(cells[index] == level for index in members)
                    rows.append(SampleRow(group, column, level, count))
                continue
            own = numbers([cells[index] for index in members if cells[index]])
            if own is not None and len(own):
                spread = float(own.std(ddof=1)) if len(own) > 1 else None
                ends = float(own.min()), float(own.max())
                unit = "mm" if column in {SHAPE_SIZE, SIZE} - set(known) else ""
                rows.append(SampleRow(group, column, "", len(own), float(own.mean()), spread, *ends, unit))
        for edges, count in _voxels(result, members, taking):
            rows.append(SampleRow(group, VOXEL, edges, count, unit="mm"))
    return rows


def _voxels(result: Result, members: Sequence[int], taking: Sequence[int]) -> list[tuple[str, int]]:
    """Return voxel sizes with the number of members; of many sizes, the ranges of their edges."""
    known = [result.voxels[index] for index in taking if result.voxels and result.voxels[index]]
    sizes = sorted({voxel_text([voxel]) for voxel in known})
    if len(sizes) > _MOST_CATEGORIES:
        sizes = [voxel_text(known)]
        return [(sizes[0], sum(bool(result.voxels[index]) for index in members))]
    own = [voxel_text([result.voxels[index]]) for index in members if sizes and result.voxels[index]]
    return [(size, own.count(size)) for size in sizes]


def voxel_text(voxels: Sequence[Sequence[float]]) -> str:
    """Return the edges of voxels (n, 3), the shortest first, such as ``"0.9 x 0.9 x 1.5 to 3"``."""
    ranges = ((f"{min(edges):.3g}", f"{max(edges):.3g}") for edges in zip(*voxels, strict=True))
    return " x ".join(low if low == high else f"{low} to {high}" for low, high in ranges)


def _describes(values: set[str]) -> bool:
    """Return whether values of a column describe a sample: numbers, or few categories."""
    try:
        as_numbers = numbers(sorted(values))
        several = len(values) > 1
        return several and (
            len(values) <= _MOST_CATEGORIES if as_numbers is None else bool(np.isfinite(as_numbers).all())
        )
    except InputError:  # commas may be thousands separators
        return False
