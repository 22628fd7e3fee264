"""What a run tells those who watch it."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

__all__ = ["FinishReason", "Observer", "Phase", "RunStatus", "ignore"]


class Phase(StrEnum):
    """Where a run is; the phases follow each other in this order."""

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
    """A run at one moment.

    Attributes
    ----------
    phase : Phase
    fraction : float
        Done of the whole run, in [0, 1]; never falls.
    message : str
        What is being done, or how it ended, for people.
    eta_s : float or None
        Seconds left, once that can be told.
    paused : bool
    reason : FinishReason or None
        None while the run is in progress; then how it ended.
    cluster : str
        Addresses of the cluster that works on subjects and of its dashboard, while there is one.
    """

    phase: Phase = Phase.READING
    fraction: float = 0.0
    message: str = ""
    eta_s: float | None = None
    paused: bool = False
    reason: FinishReason | None = None
    cluster: str = ""


Observer = Callable[[RunStatus], None]
"""Called with each change of the status, from the run's thread, at most some ten times a second. The last
call is the only one with a `reason`, and comes however the run ends."""


def ignore(status: RunStatus) -> None:
    """Watch nothing."""
