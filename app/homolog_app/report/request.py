"""The question of a study, stored in the project so that the report can be generated again."""

import re
from collections.abc import Sequence
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from homolog.arrays import FloatArray
from homolog.cohort.column_types import CATEGORY, plain_name
from homolog.errors import InputError
from homolog.geometry import scale_of
from homolog.io.results import Result
from homolog.parameters import parameters
from homolog.statistics.design import is_missing
from homolog.statistics.procrustes import Alignment, rms_radii
from homolog_app.report.study_settings import StudySettings

__all__ = [
    "SHAPE_SIZE", "SIZE", "StudyRequest", "category_of", "column_of", "columns_of", "compared_shapes",
    "levels",
]  # fmt: skip

SIZE = "size"
SHAPE_SIZE = "shape-size"


def levels(values: Sequence[str]) -> list[str]:
    """Return the distinct values in the order of their first occurrence, without missing ones."""
    return [value for value in dict.fromkeys(values) if not is_missing(value)]


def column_of(result: Result, column: str) -> list[str]:
    """Return a column of the cohort's table for each subject, missing values as empty text.

    ``group`` and ``shape-size`` always exist; so does ``size``, unless the table has such a column.

    Raises
    ------
    InputError
        If there is no such column.
    """
    known = columns_of(result)
    if column not in known and f"{column}{CATEGORY}" in known:
        column = f"{column}{CATEGORY}"  # as declared by the table
    if column == "group":
        values = [group or "" for group in result.groups]
    elif column == SHAPE_SIZE or (column == SIZE and SIZE not in known):
        return [repr(float(size)) for size in rms_radii(_at_own_size(result))]
    elif column in known:
        values = [columns.get(column, "") for columns in result.columns]
    else:
        available = ", ".join(["group", SHAPE_SIZE, *sorted(known)])
        raise InputError(f"no column {column!r}; the cohort has: {available}")
    return ["" if is_missing(value) else value for value in values]


def compared_shapes(result: Result, alignment: Alignment) -> FloatArray:
    """Return the compared particles (M, N, 3) [mm] before their alignment.

    For every alignment but "as it lies", shapes have their original sizes, even if the run scaled them.
    """
    return result.world if alignment is Alignment.AS_IT_LIES else _at_own_size(result)


def _at_own_size(result: Result) -> FloatArray:
    scale = scale_of(result.alignments)
    if np.allclose(scale, 1.0, rtol=1e-9):
        return result.world
    centre = result.world.mean(axis=1, keepdims=True)
    return np.asarray(centre + (result.world - centre) / scale[:, None, None], np.float64)


def columns_of(result: Result) -> set[str]:
    """Return the names of the columns of a result's table."""
    return {name for columns in result.columns for name in columns}


_LONGEST = 90
SIZE_TEXTS = {
    Alignment.AS_IT_LIES: "as the shapes lie",
    Alignment.RIGID: "form (size and shape)",
    Alignment.SIMILARITY: "shape (size removed)",
}


class StudyRequest(StudySettings):
    """One question about a project's result.

    Attributes
    ----------
    kind : str
        ``groups`` compares the groups of a column, ``regression`` tests the linear effect of a column,
        ``pairs`` compares the two subjects that share a value of `pairs`.
    column : str
        Column of the groups, or the variable.
    between : tuple of str
        The groups in order: differences are relative to the first; two of them for pairs.
    pairs : str or None
        Column that identifies the pairs.
    covariates : tuple of str
        Columns of the adjustment; in ``COLUMN:c`` numbers are codes of categories, ``shape-size`` is the size
        of the shapes (so is ``size``, if the cohort has no column of that name).
    alignment : Alignment
        Alignment of the shapes before the comparison.
    complete_cases : bool
        Whether subjects without a value in one of these columns are excluded.
    answers : int
        Number of answers to the same question, on form and shape, for which p-values are corrected.
    earlier : bool
        Whether an earlier version stored the question; it did not align shapes rigidly.
    """

    kind: Literal["groups", "regression", "pairs"] = "groups"
    column: str = "group"
    between: tuple[str, ...] = ()
    pairs: Annotated[str | None, Field(json_schema_extra={"if_none": "none"})] = None
    covariates: tuple[str, ...] = ()
    alignment: Alignment = Alignment.RIGID
    complete_cases: bool = False
    answers: Annotated[int, Field(ge=1, le=3)] = 1
    earlier: bool = False

    @model_validator(mode="before")
    @classmethod
    def _read_earlier(cls, values: Any) -> Any:  # noqa: ANN401 - whatever the file holds
        """Read the alignment from `scaling`, which in earlier versions stated whether size was removed."""
        if isinstance(values, dict) and "scaling" in values:
            values = dict(values)
            alignment = Alignment.SIMILARITY if values.pop("scaling") is True else Alignment.RIGID
            values = {"alignment": alignment, "earlier": alignment is Alignment.RIGID} | values
        return values

    @property
    def title(self) -> str:
        """The question in one line."""
        what = {
            "groups": f"{self.column}: {', '.join(self.between)}",
            "regression": f"effect of {self.column}",
            "pairs": f"{self.column}: {' and '.join(self.between)}, paired by {self.pairs}",
        }[self.kind]
        allowed = f", adjusted for {', '.join(self.covariates)}" if self.covariates else ""
        return f"{what}{allowed}; {SIZE_TEXTS[self.alignment]}"

    @property
    def arguments(self) -> list[str]:
        """The equivalent options of ``homolog analyze``."""
        options = ["--regress", self.column] if self.kind == "regression" else ["--group", self.column]
        options += ["--between", *self.between] if self.between else []
        options += ["--pairs", self.pairs] if self.pairs else []
        options += ["--covariates", *self.covariates] if self.covariates else []
        options += ["--complete-cases"] if self.complete_cases else []
        for parameter in parameters(StudySettings):
            value = getattr(self, parameter.name)
            if value != parameter.default:
                options += [f"--{parameter.name.replace('_', '-')}", str(value)]
        return [*options, "--alignment", self.alignment.value]

    @property
    def name(self) -> str:
        """A file name for the question; `study_folder` resolves collisions of truncated names."""
        parts = [self.kind, self.column, *self.between]
        parts += ["paired_by", self.pairs] if self.pairs else []
        parts += ["for", *self.covariates] if self.covariates else []
        tail = ["complete_cases"] if self.complete_cases else []
        tail += [f"{self.modes}_modes"] if self.modes is not None else []
        tail += [f"seed_{self.seed}"] if self.seed else []
        tail += {Alignment.AS_IT_LIES: ["as_it_lies"], Alignment.SIMILARITY: ["without_size"]}.get(
            self.alignment, []
        )
        stem, end = (re.sub(r"[^\w.-]+", "_", "_".join(part)) for part in (parts, tail))
        return "_".join(part for part in (stem[:_LONGEST].strip("._"), end) if part)

    @property
    def question(self) -> str:
        """The identity of a question, regardless of the precision of its answer."""
        return self.model_dump_json(exclude={"permutations", "null_repeats", "answers", "earlier"})


def category_of(column: str, known: "set[str]") -> tuple[str, bool]:
    """Return a covariate's column, and whether its numbers are declared codes of categories.

    They are declared by the question (``site:c``), or by the name of the table's column.
    """
    if column not in known and f"{column}{CATEGORY}" in known:
        return f"{column}{CATEGORY}", True
    if column not in known and column.endswith(CATEGORY):
        return plain_name(column), True
    return column, column.endswith(CATEGORY)
