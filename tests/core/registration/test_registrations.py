"""Registrations that are kept with a project, so that opening it registers nothing."""

import shutil
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from homolog.cohort import read_cohort
from homolog.grooming import groom_cohort
from homolog.registration import align_cohort
from homolog.registration.icp import candidates
from homolog.settings import GroomSettings

SETTINGS = GroomSettings(mesh_edge=2.0)


@pytest.fixture(scope="module")
def cohort(ellipsoids):
    return read_cohort(ellipsoids)


@pytest.fixture(scope="module")
def groomed(cohort):
    with ThreadPoolExecutor(1) as executor:
        return groom_cohort(cohort, SETTINGS, executor=executor)


@pytest.fixture(scope="module")
def kept(cohort, groomed, tmp_path_factory):
    """Return the file that the first call keeps registrations in, and its alignments."""
    path = tmp_path_factory.mktemp("kept") / "registrations.npz"
    return path, align_cohort(cohort, groomed, SETTINGS, cache=path)[1]


@pytest.fixture
def calls(monkeypatch):
    """Return the list of pairs that are registered."""
    pairs = []

    def spy(moving, fixed):
        pairs.append((moving, fixed))
        return candidates(moving, fixed)

    monkeypatch.setattr("homolog.registration.cache.candidates", spy)
    return pairs


def test_nothing_is_registered_twice(cohort, groomed, kept, calls):
    path, alignments = kept
    again = align_cohort(cohort, groomed, SETTINGS, cache=path)[1]
    assert not calls
    assert np.array_equal(again, alignments)


def test_the_same_cohort_is_not_aligned_twice_and_has_the_same_notes(cohort, groomed, kept, monkeypatch):
    path, alignments = kept
    notes = [item.report.notes for item in align_cohort(cohort, groomed, SETTINGS)[0]]
    monkeypatch.setattr("homolog.registration.sides.register", lambda *_, **__: pytest.fail("aligned again"))
    again, places = align_cohort(cohort, groomed, SETTINGS, cache=path)
    assert np.array_equal(places, alignments)
    assert [item.report.notes for item in again] == notes


def test_other_settings_align_a_cohort_again(cohort, groomed, kept, tmp_path):
    path = Path(shutil.copy(kept[0], tmp_path))
    scaled = SETTINGS.model_copy(update={"scaling": True})
    places = align_cohort(cohort, groomed, scaled, cache=path)[1]
    assert np.array_equal(places, align_cohort(cohort, groomed, scaled)[1])
    assert not np.array_equal(places, kept[1])


def test_only_a_subject_that_changed_is_registered_again(cohort, groomed, kept, calls, tmp_path):
    path = Path(shutil.copy(kept[0], tmp_path))
    vertices = groomed[3].coarse_mesh.vertices * [1.0, 1.0, 1.01]
    changed = [
        *groomed[:3],
        replace(groomed[3], coarse_mesh=replace(groomed[3].coarse_mesh, vertices=vertices)),
    ]
    alignments = align_cohort(cohort, changed, SETTINGS, cache=path)[1]
    with np.load(path) as stored:
        assert 0 < len(calls) < len(set(stored["keys"])) / 2
    assert np.array_equal(alignments, align_cohort(cohort, changed, SETTINGS)[1])


@pytest.mark.parametrize("content", [b"", b"no archive"])
def test_a_damaged_file_counts_as_missing(cohort, groomed, kept, tmp_path, content):
    path = tmp_path / "registrations.npz"
    path.write_bytes(content)
    assert np.array_equal(align_cohort(cohort, groomed, SETTINGS, cache=path)[1], kept[1])
    assert path.stat().st_size > 1000


def test_a_folder_that_is_only_read_does_no_harm(cohort, groomed, kept, tmp_path):
    (tmp_path / "file").write_bytes(b"")
    path = tmp_path / "file" / "registrations.npz"
    assert np.array_equal(align_cohort(cohort, groomed, SETTINGS, cache=path)[1], kept[1])
