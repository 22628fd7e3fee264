"""Every reader, with a few changed files; tests/benchmarks/fuzz.py does it with many."""

import pytest
from harness import attempt, mutated
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from targets import TARGETS

_SLOW = {".swproj": 5, ".xlsx": 5, "folder of .particles": 5}  # a good one is imported, with surfaces
_NAMES = [pytest.param(name, marks=pytest.mark.qt) if name == "preferences.ini" else name for name in TARGETS]


@pytest.mark.parametrize("name", _NAMES)
def test_a_good_file_is_read_and_changed_ones_are_read_or_refused(name, tmp_path):
    target = TARGETS[name]
    target.good(tmp_path)
    target.read(tmp_path)  # unwatched: on a bare machine the first use compiles kernels into a cache
    good = (tmp_path / target.file).read_bytes()
    assert attempt(target, tmp_path, good) == "read"

    @settings(
        max_examples=_SLOW.get(name, 15),
        deadline=None,
        database=None,
        suppress_health_check=[HealthCheck.too_slow],
    )
    @given(st.randoms(use_true_random=False))
    def tried(chance):
        attempt(target, tmp_path, mutated(good, chance))

    tried()


@pytest.mark.parametrize("name", _NAMES)
@pytest.mark.parametrize("content", [b"", b"\x00" * 64, b"[" * 100_000, b"PK\x03\x04", b"\xff\xfe\x00"])
def test_what_is_no_such_file_at_all_is_refused(name, content, tmp_path):
    target = TARGETS[name]
    target.good(tmp_path)
    lenient = name in (
        "preferences.ini",
        "journal.json",
        "study.json",
    )  # what can't be read there is left out
    assert attempt(target, tmp_path, content) == ("read" if lenient else "refused")
