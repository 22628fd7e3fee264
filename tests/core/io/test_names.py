import re

from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from homolog.io.names import checked_stem, file_stems


def test_plain_names_stay_as_they_are():
    assert file_stems(["acdc004", "Müller-2", "verse.010_L1"]) == ["acdc004", "Müller-2", "verse.010_L1"]


def test_names_that_differ_in_case_only_get_numbers():
    assert file_stems(["a", "A", "a_2", "á"]) == ["a", "A_2", "a_2_2", "á"]


def test_long_names_keep_their_files_apart_also_one_by_one():
    names = [f"{'hospital_' * 20}{number}" for number in range(3)]
    stems = file_stems(names)
    assert len(set(stems)) == 3
    assert stems == [file_stems([name])[0] for name in names]
    assert all(len(stem) == 100 for stem in stems)


def test_paths_and_device_names_lose_their_meaning():
    assert file_stems(["../../etc/passwd", "/root", "C:\\x", "con", "NUL.txt", "..", ".hidden"]) == [
        "_.._etc_passwd",
        "_root",
        "C__x",
        "_con",
        "_NUL.txt",
        "_",
        "hidden",
    ]


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])  # of a busy machine
@given(st.lists(st.text(), max_size=8))
def test_any_names_give_distinct_stems_that_stay_in_their_folder(names):
    stems = file_stems(names)
    assert len({stem.casefold() for stem in stems}) == len(names)
    assert all(re.fullmatch(r"[\w-][\w.-]*", stem) and not stem.endswith(".") for stem in stems)


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])  # of a busy machine
@given(st.lists(st.text(min_size=1, max_size=150), max_size=5))
@example(["-1", "a²", "½", "-", "con", "x" * 150, "x" * 149])
def test_records_take_every_stem(names):
    for stem in file_stems(names):
        assert checked_stem(stem) == stem
