import io
import json

import pytest

from homolog_app.cli.options import Progress


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def clock(monkeypatch):
    class Clock:
        now = 100.0

    monkeypatch.setattr("homolog_app.cli.options.time.monotonic", lambda: Clock.now)
    return Clock


def test_json_lines_can_be_read_one_by_one(clock):
    stream = io.StringIO()
    progress = Progress("json", stream)
    progress.show(0.25, "16 particles", 61.04, "splitting")
    clock.now += 1.0
    progress.show(1.0, "done")
    assert [json.loads(line) for line in stream.getvalue().splitlines()] == [
        {"phase": "splitting", "fraction": 0.25, "message": "16 particles", "eta_s": 61.0},
        {"phase": None, "fraction": 1.0, "message": "done", "eta_s": None},
    ]


def test_a_bar_on_a_terminal_stays_on_one_line_and_is_wiped(clock, monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")
    stream = Terminal()
    progress = Progress("bar", stream)
    for step in range(5):
        clock.now += 1.0
        progress.show(step / 4, "work", 75.0 - step, "optimizing")
    progress.close()
    text = stream.getvalue()
    assert "\n" not in text
    assert "50 % 1:13 left  optimizing: work" in text
    assert text.endswith("\r\x1b[2K")


def test_a_bar_fits_the_terminal_and_does_not_say_the_phase_twice(clock, monkeypatch):
    monkeypatch.setenv("COLUMNS", "60")
    stream = Terminal()
    Progress("bar", stream).show(0.5, "optimizing: " + "particles " * 20, None, "optimizing")
    line = stream.getvalue().removeprefix("\r\x1b[2K")
    assert len(line) == 59
    assert line.count("optimizing") == 1


def test_without_a_terminal_there_is_a_line_for_each_phase_and_every_ten_seconds(clock):
    stream = io.StringIO()
    progress = Progress("bar", stream)
    for second in range(25):
        clock.now += 1.0
        progress.show(second / 100, "work", None, "grooming" if second < 3 else "optimizing")
    progress.close()
    lines = stream.getvalue().splitlines()
    assert [line.split("%")[1].strip() for line in lines] == ["grooming: work", *["optimizing: work"] * 3]


def test_none_is_silent(clock):
    stream = io.StringIO()
    progress = Progress("none", stream)
    progress.show(1.0, "done")
    progress.close()
    assert stream.getvalue() == ""


def test_a_tick_tells_the_time_left_from_its_own_pace(clock):
    stream = io.StringIO()
    progress = Progress("json", stream)
    progress.tick(0.0, "begin")
    clock.now += 30.0
    progress.tick(0.25, "work")
    assert [json.loads(line)["eta_s"] for line in stream.getvalue().splitlines()] == [None, 90.0]
