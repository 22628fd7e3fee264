import threading
import time

import pytest

from homolog.errors import Cancelled
from homolog.progress import each_in_threads, part_of, run_in_background, run_in_threads


def test_a_part_of_a_tick_covers_its_span():
    heard = []
    part_of(lambda fraction, message: heard.append((fraction, message)), 0.2, 0.6)(0.5, "half")
    assert heard == [(pytest.approx(0.4), "half")]


def test_patient_work_returns_its_result_and_its_progress_is_passed_on_in_the_callers_thread():
    heard = []

    def work(tick):
        tick(0.5, "half")
        time.sleep(0.12)
        return 42

    def tick(fraction, message):
        heard.append((fraction, message, threading.get_ident()))

    assert run_in_background(work, tick, "begin") == 42
    assert heard[-1] == (0.5, "half", threading.get_ident())
    assert len(heard) >= 2


def test_patient_work_that_never_ticks_is_left_at_once_and_ends_by_itself_at_its_next_tick():
    left, ended = threading.Event(), threading.Event()

    def work(tick):
        left.wait(10)
        try:
            tick(1.0, "late")
        except Cancelled:
            ended.set()
            raise

    def tick(fraction, message):
        raise Cancelled

    with pytest.raises(Cancelled):
        run_in_background(work, tick, "begin")
    left.set()
    assert ended.wait(10)


def test_errors_of_patient_work_are_the_callers():
    def work(tick):
        raise ValueError("broken")

    with pytest.raises(ValueError, match="broken"):
        run_in_background(work, lambda fraction, message: None, "begin")


def test_works_on_several_threads_return_in_order_and_tick_in_the_callers_thread():
    heard, barrier = [], threading.Barrier(2, timeout=10)

    def work(number):
        barrier.wait()  # returns only if two works run at once
        return number

    works = [lambda tick, number=number: work(number) for number in range(4)]
    result = run_in_threads(works, lambda *what: heard.append((*what, threading.get_ident())), "begin", 2)
    assert result == [0, 1, 2, 3]
    assert heard[-1] == (1.0, "begin", threading.get_ident())


def test_a_cancelled_tick_ends_the_works_of_all_threads_and_begins_no_more():
    begun, ended = [], threading.Event()

    def work(tick):
        begun.append(1)
        try:
            while True:
                time.sleep(0.01)
                tick(0.5, "on")
        except Cancelled:
            ended.set()
            raise

    def tick(fraction, message):
        raise Cancelled

    with pytest.raises(Cancelled):
        run_in_threads([work] * 5, tick, "begin", 2)
    assert ended.wait(10)
    assert len(begun) <= 2


def test_an_error_on_one_of_several_threads_is_the_callers():
    def work(tick):
        raise ValueError("broken")

    with pytest.raises(ValueError, match="broken"):
        run_in_threads([work] * 3, lambda fraction, message: None, "begin", 2)


def test_each_result_is_handed_over_before_all_works_have_ended_and_messages_are_passed_on():
    taken, heard = threading.Event(), []

    def first(tick):
        return "first"

    def second(tick):
        tick(0.5, "of the second")
        assert taken.wait(10)  # for the result of the other work
        return "second"

    results = each_in_threads([second, first], lambda *what: heard.append(what), None, 2)
    assert next(results) == (1, "first")
    taken.set()
    assert list(results) == [(0, "second")]
    assert heard[-1] == (1.0, "of the second")
