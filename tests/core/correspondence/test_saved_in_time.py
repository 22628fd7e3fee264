"""That no more than 30 s of an optimization are lost, on a clock by which an iteration takes a second."""

from types import SimpleNamespace

import pytest

from homolog.correspondence import loop, optimize, recorder
from homolog.settings import OptimizeSettings

LONG = OptimizeSettings(
    particles=32, split_iterations=50, anneal_iterations=100, settle_iterations=50, tolerance=1e-12
)


@pytest.fixture
def clock(monkeypatch):
    """Return a clock, in a list, that the optimizer reads instead of the machine's."""
    now, iterate = [0.0], loop.Engine.iterate

    def slowly(engine, times):
        now[0] += times
        iterate(engine, times)

    monkeypatch.setattr(recorder, "time", SimpleNamespace(monotonic=lambda: now[0]))
    monkeypatch.setattr(loop.Engine, "iterate", slowly)
    return now


def test_a_state_is_saved_before_thirty_seconds_have_passed(ellipsoid_shapes, clock):
    saved = []
    result = optimize(ellipsoid_shapes, LONG, checkpoint=lambda _: saved.append(clock[0]))
    assert clock[0] == result.iterations > 200
    gaps = [after - before for before, after in zip(saved, [*saved[1:], clock[0]], strict=True)]
    assert 20.0 <= max(gaps) <= 30.0
