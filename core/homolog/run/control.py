"""Control of a run from any thread: progress, pause, cancel."""

import time
from dataclasses import replace

from homolog.cancellation import CancelToken
from homolog.run.events import FinishReason, Observer, Phase, RunStatus, ignore

__all__ = ["Control"]

_SHARES = {
    Phase.READING: 0.02,
    Phase.GROOMING: 0.2,
    Phase.ALIGNING: 0.02,
    Phase.GEODESICS: 0.15,
    Phase.SPLITTING: 0.15,
    Phase.OPTIMIZING: 0.395,
    Phase.FITTING: 0.0,  # without a core set
    Phase.MODELING: 0.015,
    Phase.WRITING: 0.05,
}
"""Cumulative shares of the phases in the time of a typical run, for the overall fraction."""

_FITS_SHARE = 0.5
"""Shares for a run that fits most subjects to a core set."""
_REPORT_S = 0.1
_ETA_AFTER_S = 2.0
_EARLIER, _WITHIN = 2.0 / 3.0, 0.2


class Control:
    """The status of a run, and its cancel token.

    The working thread calls `enter`, `tick` and `finish`. Any thread may use the `cancel_token` and read the
    `status`.
    """

    def __init__(self) -> None:
        self.observer: Observer = ignore
        self.seconds: dict[str, float] = {}
        self._status = RunStatus()
        self.cancel_token = CancelToken()
        self._span = (0.0, 0.0)
        self._shares = _SHARES
        self._entered = self._reported = time.monotonic()
        self._eta_origin = (self._entered, 0.0)
        self._estimates: list[tuple[float, float]] = []

    @property
    def status(self) -> RunStatus:
        """The newest status; frozen, so it may be read from any thread."""
        return self._status

    def enter(self, phase: Phase, message: str, until: Phase | None = None) -> None:
        """Start a phase, or several with common progress, up to and including `until`.

        Parameters
        ----------
        phase : Phase
            The first phase.
        message : str
            Progress message.
        until : Phase, optional
            The last phase; by default `phase`.
        """
        phases = list(Phase)
        start = sum(self._shares[item] for item in phases[: phases.index(phase)])
        stop = sum(self._shares[item] for item in phases[: phases.index(until or phase) + 1])
        self._span = (max(start, self._status.fraction), stop)
        self.move_to(phase)
        self._eta_origin = (self._entered, self._span[0])
        self.tick(0.0, message)

    def expect_fits(self) -> None:
        """Include a phase in which subjects are fitted to a core set."""
        self._shares = {phase: (1.0 - _FITS_SHARE) * share for phase, share in _SHARES.items()}
        self._shares[Phase.FITTING] = _FITS_SHARE

    def expect_another_seed(self, cost: float) -> None:
        """Include a second optimization, whose cost is relative to the first one's."""
        first = (Phase.GEODESICS, Phase.SPLITTING, Phase.OPTIMIZING)
        second = cost * sum(self._shares[phase] for phase in first)
        shares = self._shares | {Phase.MODELING: self._shares[Phase.MODELING] + second}
        self._shares = {phase: share / (1.0 + second) for phase, share in shares.items()}

    def work_on(self, cluster: str) -> None:
        """Report the cluster that processes the subjects."""
        self._notify(replace(self._status, cluster=cluster))

    def move_to(self, phase: Phase) -> None:
        """Continue with a phase that has common progress with the previous one."""
        self._close_phase()
        self._status = replace(self._status, phase=phase)
        self._eta_origin = (self._entered, self._status.fraction)
        self._reported = 0.0

    def tick(self, fraction: float, message: str) -> None:
        """Report the progress of the phase; wait while paused, raise `Cancelled` if cancelled."""
        began = time.monotonic()

        def report_pause() -> None:
            self._notify(replace(self._status, message=message, eta_s=None, paused=True))

        if self.cancel_token.wait_while_paused(report_pause):
            self._exclude_idle(time.monotonic() - began)
        now = time.monotonic()
        if now - self._reported < _REPORT_S and fraction < 1.0:
            return
        self._reported = now
        start, stop = self._span
        whole = max(self._status.fraction, start + (stop - start) * min(max(fraction, 0.0), 1.0))
        self._notify(replace(self._status, fraction=whole, message=message, eta_s=self._eta(now, whole)))

    def finish(self, reason: FinishReason, message: str) -> None:
        """Report the end of the run, as the last call of the observer."""
        self._close_phase()
        fraction = 1.0 if reason is FinishReason.COMPLETED else self._status.fraction
        self._notify(RunStatus(self._status.phase, fraction, message, reason=reason))

    def _close_phase(self) -> None:
        now = time.monotonic()
        phase = self._status.phase
        self.seconds[phase] = round(self.seconds.get(phase, 0.0) + now - self._entered, 3)
        self._entered = now

    def _notify(self, status: RunStatus) -> None:
        self._status = status
        self.observer(status)

    def _exclude_idle(self, idle: float) -> None:
        """Exclude waiting time from times and estimates."""
        self._entered += idle
        self._eta_origin = (self._eta_origin[0] + idle, self._eta_origin[1])
        self._estimates = [(then + idle, left) for then, left in self._estimates]
        self._reported = 0.0
        self._status = replace(self._status, paused=False)

    def _eta(self, now: float, whole: float) -> float | None:
        """Return the seconds left at the mean speed of this phase, with the shares of a typical run.

        The speed of another phase predicts nothing: it depends on files, cores and what is cached. None while
        the estimate does not hold: the one at two thirds of the phase so far must have predicted the same
        end, within a fifth of the time that it gave. None after the optimization, too: the little that is
        left is mostly another phase.
        """
        begun, start = self._eta_origin
        is_end = self._status.phase in {Phase.MODELING, Phase.WRITING}
        if is_end or now - begun < _ETA_AFTER_S or whole - start < 0.01:
            return None
        left = (now - begun) * (1.0 - whole) / (whole - start)
        self._estimates = [item for item in self._estimates if item[0] >= begun]
        earlier = [item for item in self._estimates if item[0] - begun <= _EARLIER * (now - begun)]
        self._estimates.append((now, left))
        if not earlier:
            return None
        then, before = earlier[-1]
        return left if abs(now + left - then - before) <= _WITHIN * before else None
