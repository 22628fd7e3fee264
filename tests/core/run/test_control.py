import threading
import time

import pytest

from homolog.errors import Cancelled
from homolog.run.control import Control
from homolog.run.events import FinishReason, Phase


@pytest.fixture
def control():
    made = Control()
    made.heard = []
    made.observer = made.heard.append
    return made


def until(condition):
    deadline = time.monotonic() + 10.0
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.002)


def test_the_fraction_never_falls_and_ends_at_one(control):
    for phase in Phase:
        control.enter(phase, "begin")
        for step in (0.5, 0.2, 1.0, 7.0):
            control.tick(step, "work")
    control.finish(FinishReason.COMPLETED, "done")
    fractions = [item.fraction for item in control.heard]
    assert fractions == sorted(fractions)
    assert fractions[0] == 0.0
    assert fractions[-2] == pytest.approx(1.0)
    assert fractions[-1] == 1.0
    assert list(dict.fromkeys(item.phase for item in control.heard)) == list(Phase)


def test_the_cluster_is_told_until_the_end_of_the_work(control):
    control.enter(Phase.GROOMING, "grooming")
    control.work_on("tcp://here:1, dashboard http://here:2")
    control.tick(0.5, "grooming a")
    assert control.heard[-1].cluster == "tcp://here:1, dashboard http://here:2"


def test_phases_ticked_as_one_share_their_part(control):
    control.enter(Phase.GEODESICS, "begin", until=Phase.OPTIMIZING)
    first = control.status.fraction
    control.tick(1.0, "half way")
    last = control.status.fraction
    control.move_to(Phase.OPTIMIZING)
    control.tick(1.0, "end")
    assert control.status.phase is Phase.OPTIMIZING
    assert control.status.fraction == last
    control.enter(Phase.MODELING, "next")
    assert first < last == pytest.approx(control.status.fraction)


def test_ticks_that_follow_closely_are_not_all_told(control):
    control.enter(Phase.READING, "begin")
    for step in range(1000):
        control.tick(step / 2000, "work")
    assert len(control.heard) < 20


def test_only_the_last_status_has_a_reason(control):
    control.enter(Phase.READING, "begin")
    control.tick(1.0, "work")
    control.finish(FinishReason.FAILED, "broken")
    assert [item.reason for item in control.heard] == [None] * (len(control.heard) - 1) + [
        FinishReason.FAILED
    ]
    assert control.status.message == "broken"


def test_a_cancelled_run_ends_at_its_next_tick(control):
    control.enter(Phase.READING, "begin")
    control.cancel_token.cancel()
    control.cancel_token.cancel()
    with pytest.raises(Cancelled):
        control.tick(0.5, "work")


def test_a_paused_run_waits_and_goes_on(control):
    control.enter(Phase.READING, "begin")
    control.cancel_token.set_paused(True)
    worker = threading.Thread(target=lambda: control.tick(1.0, "work"))
    worker.start()
    until(lambda: control.status.paused)
    assert worker.is_alive()
    control.cancel_token.set_paused(False)
    worker.join(10.0)
    assert not worker.is_alive()
    assert not control.status.paused
    assert [item.paused for item in control.heard] == [False, True, False]


def test_a_paused_run_can_be_cancelled(control):
    control.enter(Phase.READING, "begin")
    control.cancel_token.set_paused(True)
    ended = []

    def work():
        try:
            control.tick(0.5, "work")
        except Cancelled:
            ended.append(True)

    worker = threading.Thread(target=work)
    worker.start()
    until(lambda: control.status.paused)
    control.cancel_token.cancel()
    worker.join(10.0)
    assert ended == [True]


def test_waiting_while_paused_is_not_counted_as_work(control):
    began = time.monotonic()
    control.enter(Phase.READING, "begin")
    control.cancel_token.set_paused(True)
    threading.Timer(0.3, control.cancel_token.set_paused, [False]).start()
    control.tick(0.5, "work")
    control.finish(FinishReason.COMPLETED, "done")
    assert control.seconds[Phase.READING] < time.monotonic() - began - 0.25


def test_a_second_optimization_has_its_share_in_the_time_left(control, monkeypatch):
    now = 100.0
    monkeypatch.setattr("homolog.run.control.time.monotonic", lambda: now)
    control.expect_another_seed(0.5)
    control.enter(Phase.GEODESICS, "begin", until=Phase.OPTIMIZING)
    control.move_to(Phase.OPTIMIZING)
    begun = control.status.fraction
    for now in (130.0, 140.0, 150.0):
        control.tick((now - 100.0) / 100.0, "work")
    assert control.status.eta_s is not None
    control.tick(1.0, "end")
    first = control.status.fraction - begun
    control.enter(Phase.MODELING, "another seed")
    for now in (160.0, 170.0, 180.0):
        control.tick((now - 150.0) / 40.0, "work")
    assert control.status.eta_s is None
    control.tick(1.0, "end")
    assert control.status.fraction - begun - first > 0.5 * first


def test_the_pace_of_one_phase_predicts_no_other(control, monkeypatch):
    now = 100.0
    monkeypatch.setattr("homolog.run.control.time.monotonic", lambda: now)
    control.enter(Phase.GEODESICS, "begin", until=Phase.OPTIMIZING)
    for now in (103.0, 104.0, 105.0, 106.0):
        control.tick((now - 100.0) / 20.0, "quick")
    assert control.status.eta_s is not None
    control.move_to(Phase.OPTIMIZING)
    now += 1.0
    control.tick(0.35, "slow")
    assert control.status.eta_s is None


def test_the_time_left_follows_from_the_pace_if_an_earlier_estimate_agrees(control, monkeypatch):
    now = 100.0
    monkeypatch.setattr("homolog.run.control.time.monotonic", lambda: now)
    control.enter(Phase.GEODESICS, "begin", until=Phase.OPTIMIZING)
    start = control.status.fraction

    def after(seconds, share):
        nonlocal now
        now = 100.0 + seconds
        control.tick(share, "work")
        return control.status.eta_s

    assert after(5.0, 0.25) is None  # nothing confirms it
    half = after(10.0, 0.5)
    whole = control.status.fraction
    assert half == pytest.approx(10.0 * (1.0 - whole) / (whole - start))
    assert after(20.0, 0.6) is None  # the end was predicted much earlier
