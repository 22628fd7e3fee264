"""The sample of a study: numbers, sizes, covariates and voxels by group."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from homolog.analysis.design import numbers
from homolog.errors import InputError
from homolog.files.records import ResultRecord
from homolog.files.report_details import ReportDetails
from homolog.files.results import Result
from homolog_app.report.page import Page
from homolog_app.report.request import SHAPE_SIZE, category_of, column_of
from homolog_app.report.study import Study

__all__ = ["VOXEL", "SampleRow", "add_missing", "sample_rows", "voxel_text"]

VOXEL = "voxel"
"""Variable whose categories are edges of voxels [mm], the shortest first."""
_MOST_CATEGORIES = 8
"""Of a column that is not asked for, for it to be in the description of the sample."""


@dataclass(frozen=True, slots=True)
class SampleRow:
    """A number of subjects of a group, or mean, standard deviation and range of a variable in it.

    Attributes
    ----------
    group, variable, category : str
        The category is empty for numbers.
    count : int
        Subjects that are counted, or have a value.
    mean, spread, least, largest : float or None
        None where subjects are counted; the spread also for one subject.
    """

    group: str
    variable: str
    category: str
    count: int
    mean: float | None = None
    spread: float | None = None
    least: float | None = None
    largest: float | None = None


def sample_rows(study: Study, result: Result) -> list[SampleRow]:
    """Describe the sample by group: numbers, size of the shapes, covariates, other columns."""
    request = study.request
    taking = [index for index, name in enumerate(result.names) if name not in study.left_out]
    groups: dict[str, list[int]] = {"all": taking}
    if request.kind != "regression":
        groups = {
            item: [index for index in taking if study.labels[index] == item] for item in request.between
        }
    known = {name for columns in result.columns for name in columns}
    variables = [SHAPE_SIZE, *([request.column] if request.kind == "regression" else [])]
    variables += [
        covariate for covariate in request.covariates if category_of(covariate, known)[0] not in variables
    ]
    named = {category_of(variable, known)[0] for variable in variables} | {request.column, request.pairs}
    for column in sorted(known - named):
        cells = column_of(result, column)
        if _describes({cells[index] for index in taking} - {""}):
            variables.append(column)
    rows: list[SampleRow] = []
    for group, members in groups.items():
        rows.append(SampleRow(group, "subjects", "", len(members)))
        for variable in variables:
            column, is_category = category_of(variable, known)
            cells = column_of(result, column)
            there = {cells[index] for index in taking} - {""}
            if is_category or numbers(sorted(there)) is None:
                for level in sorted(there):
                    count = sum(cells[index] == level for index in members)
                    rows.append(SampleRow(group, column, level, count))
                continue
            own = numbers([cells[index] for index in members if cells[index]])
            if own is not None and len(own):
                spread = float(own.std(ddof=1)) if len(own) > 1 else None
                ends = float(own.min()), float(own.max())
                rows.append(SampleRow(group, column, "", len(own), float(own.mean()), spread, *ends))
        for edges, count in _voxels(result, members, taking):
            rows.append(SampleRow(group, VOXEL, edges, count))
    return rows


def _voxels(result: Result, members: Sequence[int], taking: Sequence[int]) -> list[tuple[str, int]]:
    """Return sizes of voxels with how many members have them; of many sizes, the ranges of their edges."""
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
    except InputError:  # commas that may be between thousands
        return False


def add_missing(
    page: Page, record: ResultRecord, details: ReportDetails, one_seed: bool, *, several: bool
) -> None:
    """Add one list of what a paper needs and only its authors know.

    A study may have but one seed, and there may be several studies.
    """
    points = [] if details.structure else ["the anatomical structure (--structure)"]
    if not details.cohort:
        points.append(
            "the cohort (--cohort): where and when subjects were recruited, criteria of inclusion and "
            "diagnosis, what the groups are"
        )
    if not any(subject.voxel for subject in record.subjects):
        points.append("voxel size")
    points += [
        "scanner, protocol, phase or time of imaging, and the spacing of slices before any resampling",
        "who segmented, how, and how well segmentations of one subject agree",
        "units of columns whose names do not tell them",
        "why there are as many subjects and particles",
        "ethics approval",
    ]
    if several:
        points.append("which study and which tests were chosen as primary before the results were seen")
    if one_seed:
        points.append(
            "for studies of one seed, how answers vary with the seed of the correspondence (homolog analyze "
            "--seeds 5)"
        )
    given = "" if not details.cohort else " where the description of the cohort does not say it"
    page.paragraph(f"The program does not know, and a paper needs{given}: {'; '.join(points)}.")
