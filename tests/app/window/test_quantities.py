"""Numbers as people read them."""

import pytest

from homolog_app.rendering.text import millilitres, short, signed, tick_labels


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ([79.75, 79.76, 79.77], ["79.75", "79.76", "79.77"]),
        ([0.0, 2.5, 5.0], ["0.0", "2.5", "5.0"]),
        ([-20.0, 0.0, 20.0], ["−20", "0", "20"]),
        ([], []),
    ],
)
def test_ticks_have_as_many_digits_as_tell_them_apart(values, message):
    assert tick_labels(values) == message


def test_numbers_have_a_true_minus_and_no_exponent_that_people_would_not_write():
    assert signed(-0.5) == "−0.50"
    assert signed(-0.001) == "0.00"
    assert signed(1.234, 1) == "+1.2"
    assert short(-5379.4) == "−5379"
    assert short(0.07061) == "0.0706"


@pytest.mark.parametrize(
    ("volume", "message"),
    [(96.0, "96.0 ml"), (1532.4, "1532 ml"), (2.948, "2.95 ml"), (0.0371, "0.0371 ml"), (0.0, "0 ml")],
)
def test_volumes_have_three_digits_or_all_before_the_point(volume, message):
    assert millilitres(volume) == message
