"""How questions are tested: settings common to command line, window and Python. Loads nothing heavy."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

__all__ = ["AnalysisSettings", "Precision"]


class Precision(BaseModel):
    """How a question is tested."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    modes: Annotated[
        int | None, Field(ge=1, description="Number of modes to test. Default: by parallel analysis.")
    ] = None
    permutations: Annotated[
        int,
        # With fewer than 19, no p could be 0.05.
        Field(ge=19, le=1_000_000, description="Permutations of each test."),
    ] = 10_000
    seed: Annotated[
        int,
        Field(ge=0, le=2**31 - 1, description="Random seed of permutations, folds and bootstrap."),
    ] = 0


class AnalysisSettings(Precision):
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
