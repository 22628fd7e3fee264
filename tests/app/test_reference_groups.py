"""Groups that are called as controls are come first."""

import pytest

from homolog.statistics.design import reference_first


@pytest.mark.parametrize(
    ("values", "ordered"),
    [
        (["DCM", "NOR", "HCM"], ["NOR", "DCM", "HCM"]),
        (["Arthrose", "gesund"], ["gesund", "Arthrose"]),
        (["malade", "Témoins"], ["Témoins", "malade"]),
        (["b", "a"], ["a", "b"]),
    ],
)
def test_controls_come_first_in_any_of_the_languages_of_tables(values, ordered):
    assert reference_first(values) == ordered
