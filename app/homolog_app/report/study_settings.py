"""Settings of the tests of a question, common to the command line, the window and Python."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

__all__ = ["AnalysisSettings", "StudySettings"]


class StudySettings(BaseModel):
    """Tests of a question."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    modes: Annotated[
        int | None, Field(ge=1, description="Number of modes to test. Default: by parallel analysis.")
    ] = None
    permutations: Annotated[int, Field(ge=99, le=1_000_000, description="Permutations of each test.")] = (
        10_000
    )
    null_repeats: Annotated[
        int, Field(ge=0, le=100_000, description="Repeats of the null simulation; 0 omits it.")
    ] = 1000
    seed: Annotated[
        int,
        Field(ge=0, le=2**31 - 1, description="Random seed of permutations, folds and bootstrap."),
    ] = 0


class AnalysisSettings(StudySettings):
    """Tests."""

    seeds: Annotated[
        int | None,
        Field(
            ge=1,
            description="Repeat correspondence and tests with this total number of seeds, and report how "
            "the answers vary. The runs are stored in PROJECT/seeds, and later questions are repeated with "
            "them. Default: those stored.",
        ),
    ] = None
