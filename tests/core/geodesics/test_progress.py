import threading
import time

import pytest

from homolog.errors import Cancelled
from homolog.geodesics import plan_tables, solve_tables
from homolog.geodesics.cuda.solver import solve_on_cuda


def test_progress_rises_and_names_the_subjects(sphere):
    seen = []
    solve_tables([sphere(500), sphere(600)], 10.0, names=["ann", "bob"], tick=lambda *what: seen.append(what))
    fractions = [fraction for fraction, _ in seen]
    assert fractions == sorted(fractions)
    assert fractions[-1] == pytest.approx(1.0)
    texts = [text for _, text in seen]
    assert texts[:2] == ["mesh of ann checked", "mesh of bob checked"]
    assert set(texts[2:]) <= {"geodesic distances of ann", "geodesic distances of bob"}


@pytest.mark.parametrize("at", [0.0, 0.4])
def test_cancelling_ends_the_work_and_its_threads(sphere, at):
    def tick(fraction, _):
        if fraction >= at:
            raise Cancelled

    def working():
        return {thread for thread in threading.enumerate() if not thread.name.startswith("launches")}  # kept

    before = working()
    with pytest.raises(Cancelled):
        solve_tables([sphere(900)] * 3, 20.0, tick=tick, threads=2)
    end = time.monotonic() + 20.0
    while working() - before and time.monotonic() < end:
        time.sleep(0.01)
    assert not working() - before


def test_cancelling_stops_the_cuda_solver(sphere):
    calls = []

    def tick(fraction, _):
        calls.append(fraction)
        if len(calls) == 2:
            raise Cancelled

    with pytest.raises(Cancelled):
        solve_on_cuda(plan_tables([sphere(600)], 20.0), "cpu", 3_000_000, tick)
    assert len(calls) == 2
