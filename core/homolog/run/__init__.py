"""The pipeline as a state machine, used by the command line and the window."""

from homolog.run.events import FinishReason, Observer, Phase, RunStatus
from homolog.run.prior_result import adds_particles, new_subjects
from homolog.run.reuse import is_result_of
from homolog.run.run import Run

__all__ = [
    "FinishReason",
    "Observer",
    "Phase",
    "Run",
    "RunStatus",
    "adds_particles",
    "is_result_of",
    "new_subjects",
]
