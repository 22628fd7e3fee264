"""Questions about a cohort's shapes: columns, groups, covariates, alignment, and how they are tested."""

import re
from collections.abc import Sequence
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError, model_validator

from homolog.comparison.precision import Precision
from homolog.errors import InputError
from homolog.parameters import fault_text, parameters
from homolog.statistics.comparison import Options
from homolog.statistics.design import Squares, parsed
from homolog.statistics.procrustes import Alignment

__all__ = ["ALIGNED", "NOUNS", "Question", "alignment_of", "questions"]

_FORMER = ("answers", "null_repeats")
_TYPES = {"I": Squares.SEQUENTIAL, "II": Squares.MARGINAL, "III": Squares.PARTIAL}
_LONGEST = 90
ALIGNED = {
    Alignment.AS_IT_LIES: "as the shapes lie",
    Alignment.FORM: "form (size and shape)",
    Alignment.SHAPE: "shape (size removed)",
}
NOUNS = {Alignment.AS_IT_LIES: "form or pose", Alignment.FORM: "form", Alignment.SHAPE: "shape"}
"""The compared property, by the alignment."""


class Question(Precision):
    """One question about a cohort's shapes.

    Attributes
    ----------
    kind : str
        ``groups`` compares the groups of a column, ``regression`` tests the linear effect of a column,
        ``pairs`` compares the two subjects that share a value of `pairs`, ``formula`` tests each term of a
        formula.
    column : str
        Column of the groups, or the variable; empty for a formula.
    between : tuple of str
        The groups in order: differences are relative to the first; two of them for pairs.
    pairs : str or None
        Column that identifies the pairs.
    covariates : tuple of str
        Columns of the adjustment; in ``COLUMN:c`` numbers are codes of categories, ``shape-size`` is the size
        of the shapes (so is ``size``, if the cohort has no column of that name).
    formula : str
        Such as ``"~ group * age + sex"``; see `homolog.statistics.design.make_design`.
    subject, strata : str or None
        For a formula, columns of the subject of repeated measures, and of strata such as sites.
    squares : Squares
        For a formula, the type of the sums of squares, also as ``I``, ``II`` or ``III``.
    alignment : Alignment
        Alignment of the shapes before the comparison: by similarities (shape alone, the default), rigid
        (form: size and shape), or none. Size is always tested beside it.
    complete_cases : bool
        Whether subjects without a value in one of these columns are excluded.
    pose : str
        The structure whose pose against the others is compared, in place of shapes; see `PoseSample`.
    earlier : bool
        Whether an earlier version stored the question; it did not align shapes rigidly.
    """

    kind: Literal["groups", "regression", "pairs", "formula"] = "groups"
    column: str = "group"
    between: tuple[str, ...] = ()
    pairs: Annotated[str | None, Field(json_schema_extra={"if_none": "none"})] = None
    covariates: tuple[str, ...] = ()
    formula: str = ""
    subject: Annotated[str | None, Field(json_schema_extra={"if_none": "none"})] = None
    strata: Annotated[str | None, Field(json_schema_extra={"if_none": "none"})] = None
    squares: Squares = Squares.MARGINAL
    alignment: Alignment = Alignment.SHAPE
    complete_cases: bool = False
    pose: str = ""
    earlier: bool = False

    @model_validator(mode="before")
    @classmethod
    def _read_earlier(cls, values: Any) -> Any:  # noqa: ANN401 - whatever the file holds
        """Read what earlier versions stored: `scaling`, `answers` and `null_repeats`."""
        if not isinstance(values, dict):
            return values
        values = {name: value for name, value in values.items() if name not in _FORMER}
        values |= {"squares": _TYPES.get(values["squares"], values["squares"])} if "squares" in values else {}
        if "scaling" in values:
            alignment = Alignment.SHAPE if values.pop("scaling") is True else Alignment.FORM
            values = {"alignment": alignment, "earlier": alignment is Alignment.FORM} | values
        return values

    @property
    def topic(self) -> str:
        """What is asked, without alignment and covariates."""
        return {
            "groups": f"{self.column}: {', '.join(self.between)}",
            "regression": f"effect of {self.column}",
            "pairs": f"{self.column}: {' and '.join(self.between)}, paired by {self.pairs}",
            "formula": self.formula
            + (f", rows of one {self.subject} together" if self.subject else "")
            + (f", within {self.strata}" if self.strata else ""),
        }[self.kind]

    @property
    def title(self) -> str:
        """The question in one line."""
        allowed = f", adjusted for {', '.join(self.covariates)}" if self.covariates else ""
        return f"{self.topic}{allowed}; {f'pose of {self.pose}' if self.pose else ALIGNED[self.alignment]}"

    @property
    def arguments(self) -> list[str]:
        """The equivalent options of ``homolog analyze``."""
        options = {"regression": ["--regress", self.column], "formula": ["--formula", self.formula]}.get(
            self.kind, ["--group", self.column]
        )
        options += ["--subject", self.subject] if self.subject else []
        options += ["--strata", self.strata] if self.strata else []
        options += ["--squares", self.type_of_squares] if self.squares is not Squares.MARGINAL else []
        options += ["--between", *self.between] if self.between else []
        options += ["--pairs", self.pairs] if self.pairs else []
        options += ["--covariates", *self.covariates] if self.covariates else []
        options += ["--complete-cases"] if self.complete_cases else []
        for parameter in parameters(Precision):
            value = getattr(self, parameter.name)
            if value != parameter.default:
                options += [f"--{parameter.name.replace('_', '-')}", str(value)]
        return [*options, *(["--pose", self.pose] if self.pose else ["--alignment", self.alignment.value])]

    @property
    def named_columns(self) -> tuple[str, ...]:
        """Covariates, or the columns of the formula."""
        if self.kind != "formula":
            return self.covariates
        return tuple(dict.fromkeys(name for term in parsed(self.formula) for name in term))

    @property
    def type_of_squares(self) -> str:
        """Type of the sums of squares as it is written."""
        return next(text for text, kind in _TYPES.items() if kind is self.squares)

    @property
    def name(self) -> str:
        """A file name for the question; `homolog.comparison.stored.folder_of` resolves collisions."""
        parts = [*(["pose", self.pose] if self.pose else []), self.kind]
        parts += [self.formula.strip("~ ") or self.column, *self.between]
        parts += ["subject", self.subject] if self.subject else []
        parts += ["within", self.strata] if self.strata else []
        parts += ["type", self.type_of_squares] if self.squares is not Squares.MARGINAL else []
        parts += ["paired_by", self.pairs] if self.pairs else []
        parts += ["for", *self.covariates] if self.covariates else []
        tail = ["complete_cases"] if self.complete_cases else []
        tail += [f"{self.modes}_modes"] if self.modes is not None else []
        tail += [f"seed_{self.seed}"] if self.seed else []
        if not self.pose:
            ways = {Alignment.AS_IT_LIES: ["as_it_lies"], Alignment.SHAPE: ["without_size"]}
            tail += ways.get(self.alignment, [])
        stem, end = (re.sub(r"[^\w.-]+", "_", "_".join(part)) for part in (parts, tail))
        return "_".join(part for part in (stem[:_LONGEST].strip("._"), end) if part)

    @property
    def identity(self) -> str:
        """What makes it the same question, regardless of the precision of its answer."""
        return self.model_dump_json(exclude={"permutations", "earlier"})

    @property
    def options(self) -> Options:
        """The options of its tests."""
        return Options(
            alignment=self.alignment,
            modes=self.modes,
            permutations=self.permutations,
            seed=self.seed,
        )


def alignment_of(word: str) -> Alignment:
    """Return an alignment by its name; raises InputError if there is none such."""
    try:
        return Alignment(word)
    except ValueError as error:
        known = ", ".join(Alignment)
        raise InputError(f"alignment {word!r}: choose from {known}") from error


def questions(alignments: Sequence[str], **given: Any) -> tuple[Question, ...]:  # noqa: ANN401 - checked
    """Return a question for each of several alignments.

    Parameters
    ----------
    alignments : sequence of str
        Alignments before the comparison, each once.
    **given
        The other attributes of `Question`.

    Raises
    ------
    InputError
        If a value is invalid.
    """
    alignments = [alignment_of(word) for word in alignments]
    if given.get("squares", "II") not in _TYPES:
        raise InputError(f"squares {given['squares']!r}: choose I, II or III")
    if not alignments or len(set(alignments)) < len(alignments):
        raise InputError(f"alignment {', '.join(alignments) or 'none'}: give one or more, each once")
    try:
        return tuple(Question.model_validate({**given, "alignment": item}) for item in alignments)
    except ValidationError as error:
        first = error.errors()[0]
        name = {"seed": "random_state"}.get(str(first["loc"][0]), first["loc"][0])
        raise InputError(f"{name} {first['input']}: {fault_text(first)}") from error
