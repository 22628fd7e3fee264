"""What a study asks: kept in the project, so that a report can be made again from it."""

import re
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from homolog.errors import InputError
from homolog.files.atomic import write_text
from homolog.files.project import Project

__all__ = ["StudyRequest", "read_requests", "study_folder", "write_request"]

_RECORD = "study.json"


class StudyRequest(BaseModel):
    """One question to a project's result.

    Attributes
    ----------
    kind : str
        ``groups`` compares the groups of a column, ``regression`` asks for a linear effect of a column,
        ``pairs`` compares the two subjects that share a value of `pairs`.
    column : str
        The groups, or the variable.
    between : tuple of str
        The groups in order: differences are from the first; two of them for pairs.
    pairs : str or None
        The column that names the pairs.
    covariates : tuple of str
        Columns allowed for; ``size`` is the size of the shapes.
    scaling : bool
        Whether size is taken out of the shapes.
    modes : int or None
        Number of modes; by parallel analysis if not given.
    permutations, null_repeats, seed : int
        See `homolog.analysis.comparison.Options`.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    kind: Literal["groups", "regression", "pairs"] = "groups"
    column: str = "group"
    between: tuple[str, ...] = ()
    pairs: str | None = None
    covariates: tuple[str, ...] = ()
    scaling: bool = False
    modes: Annotated[int, Field(ge=1)] | None = None
    permutations: Annotated[int, Field(ge=99, le=1_000_000)] = 10_000
    null_repeats: Annotated[int, Field(ge=0, le=100_000)] = 1000
    seed: Annotated[int, Field(ge=0, le=2**31 - 1)] = 0

    @property
    def title(self) -> str:
        """The question in a line."""
        what = {
            "groups": f"{self.column}: {', '.join(self.between)}",
            "regression": f"effect of {self.column}",
            "pairs": f"{self.column}: {' and '.join(self.between)}, paired by {self.pairs}",
        }[self.kind]
        allowed = f", allowing for {', '.join(self.covariates)}" if self.covariates else ""
        return what + allowed + (", size removed" if self.scaling else "")

    @property
    def words(self) -> list[str]:
        """The options of ``homolog analyze`` that ask it."""
        words = ["--regress", self.column] if self.kind == "regression" else ["--group", self.column]
        words += ["--between", *self.between] if self.between else []
        words += ["--pairs", self.pairs] if self.pairs else []
        words += ["--covariates", *self.covariates] if self.covariates else []
        return [*words, "--size", "without" if self.scaling else "with"]

    @property
    def name(self) -> str:
        """A file name for the question."""
        words = [
            self.kind,
            self.column,
            *self.between,
            *(["for", *self.covariates] if self.covariates else []),
        ]
        if self.modes is not None:
            words.append(f"{self.modes}_modes")
        if self.scaling:
            words.append("without_size")
        return re.sub(r"[^\w.-]+", "_", "_".join(words))[:120].strip(".")


def study_folder(project: Project, request: StudyRequest) -> Path:
    """Return the folder of a study's tables."""
    return project.folder / "analysis" / request.name


def write_request(project: Project, request: StudyRequest) -> None:
    """Keep a question; raises InputError if the project can't be written to."""
    write_text(study_folder(project, request) / _RECORD, request.model_dump_json(indent=2) + "\n")


def read_requests(project: Project) -> list[StudyRequest]:
    """Return the questions kept in a project, by name.

    Raises
    ------
    InputError
        If one of them is damaged.
    """
    requests = []
    for path in sorted((project.folder / "analysis").glob(f"*/{_RECORD}")):
        try:
            requests.append(StudyRequest.model_validate_json(path.read_bytes()))
        except (OSError, ValidationError) as error:
            raise InputError(f"{path}: is damaged; delete its folder and analyze again") from error
    return requests
