"""Status of a run for its observers."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

__all__ = ["FinishReason", "Observer", "Phase", "RunStatus", "ignore"]


class Phase(StrEnum):
    """Phases of a run, in order."""

    READING = "reading"
    GROOMING = "grooming"
    ALIGNING = "aligning"
    GEODESICS = "geodesics"
    SPLITTING = "splitting"
    OPTIMIZING = "optimizing"
    FITTING = "fitting"
    MODELING = "modeling"
    WRITING = "writing"


class FinishReason(StrEnum):
    """How a run ended."""

    COMPLETED = "completed"
    CANCELLED = "cancelled"
    FAILED = "failed"


@dataclass(frozen=True, slots=True)
class RunStatus:
    """The status of a run.

    Attributes
    ----------
    phase : Phase
    fraction : float
        Fraction done of the whole run, in [0, 1]; never decreases.
    message : str
        The current step, or how the run ended.
    eta_s : float or None
        Estimated seconds left; None while unknown.
    paused : bool
    reason : FinishReason or None
        How the run ended; None while it is in progress.
    cluster : str
        Addresses of the cluster that processes subjects, and of its dashboard; empty without a cluster.
    """

    phase: Phase = Phase.READING
    fraction: float = 0.0
    message: str = ""
    eta_s: float | None = None
    paused: bool = False
    reason: FinishReason | None = None
    cluster: str = ""


Observer = Callable[[RunStatus], None]
"""Called at each change of the status, in the run's thread, about ten times a second at most. The last call
is the only one with a `reason`; it follows however the run ends."""


def ignore(status: RunStatus) -> None:
    """Ignore the status."""
