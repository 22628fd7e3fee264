"""A patient at several times: the change is found, the pose is none, and limits come from repeats only."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from homolog.errors import InputError
from homolog.patient import Reference, compare_groomed, compare_times
from homolog.patient.times import seen_twice
from homolog.surfaces.mesh import TriangleMesh

from .conftest import build, groomed, moved, shape

AGE = {"age": "60"}


def at_time(reference, template, name, *, bump=0.0, noise=0.0, seed=0):
    """Return the same patient in another pose, with a bump [mm] at the top and noise of segmentation [mm]."""
    directions, faces = template
    points = shape(directions, np.random.default_rng(11))
    random = np.random.default_rng(100 + seed)
    normals = TriangleMesh(points, faces).vertex_normals
    centre = points[np.argmax(directions[:, 2])]
    gaussian = np.exp(-0.5 * np.square(points - centre).sum(axis=1) / 36.0)
    wave = np.sin(points @ random.normal(scale=0.4, size=3) + random.uniform(0.0, 6.0))
    points = points + (bump * gaussian + noise * wave)[:, None] * normals
    return compare_groomed(reference, groomed(name, TriangleMesh(moved(points, random), faces)), AGE)


@pytest.fixture(scope="module")
def times(reference, template):
    return [
        at_time(reference, template, "t1"),
        at_time(reference, template, "t2", seed=1),
        at_time(reference, template, "t3", seed=2, bump=4.0),
    ]


@pytest.fixture(scope="module")
def repeats(reference, template):
    return [at_time(reference, template, f"r{n}", seed=10 + n, noise=0.3) for n in range(4)]


def test_a_change_is_found_where_it_is_and_another_pose_is_none(times):
    follow_up = compare_times(times)
    same, grown = follow_up.changes
    assert np.abs(same.distance).max() < 0.3
    assert 3.0 < grown.distance.max() < 4.8
    top = follow_up.surface.vertices[np.argmax(grown.distance)]
    away = np.linalg.norm(follow_up.surface.vertices - top, axis=1) > 20.0
    assert np.abs(grown.distance[away]).max() < 0.5
    assert grown.volume > 1.005
    assert (follow_up.limit, follow_up.error, grown.z, grown.regions) == (None, None, None, ())


def test_repeated_segmentations_give_a_limit_that_only_the_change_exceeds(times, repeats):
    follow_up = compare_times(times, repeats)
    assert follow_up.everywhere
    assert follow_up.repeats == 4
    same, grown = follow_up.changes
    assert same.regions == ()
    assert len(grown.regions) == 1
    assert grown.regions[0].peak > 3.0
    assert 0.02 < follow_up.error.mean() < 0.3


def test_few_repeats_give_a_limit_for_each_place_alone(times, repeats):
    follow_up = compare_times(times, repeats[:1])
    assert not follow_up.everywhere
    assert follow_up.limit == pytest.approx(1.96)


def test_one_time_or_another_reference_is_refused(times):
    with pytest.raises(InputError, match="two times"):
        compare_times(times[:1])
    expected = TriangleMesh(times[1].expected.vertices, times[1].expected.faces[::-1])
    with pytest.raises(InputError, match="one"):
        compare_times([times[0], replace(times[1], expected=expected)])


GROWTH = 1.5  # mm, at the end where x is positive
CASES = {"as controls": (1.0, 0.0), "not at all": (0.0, 0.0), "at the top": (1.0, 4.0)}


def grown(points, faces, share, random):
    """Return a surface that has grown at one end, in another pose."""
    at_end = np.clip(points[:, 0] / 30.0, 0.0, 1.0) ** 2
    normals = TriangleMesh(points, faces).vertex_normals
    return moved(points + (share * GROWTH * at_end)[:, None] * normals, random)


@pytest.fixture(scope="module")
def seen_again(template, provenance):
    """Return a reference whose controls grow at one end until their second time, some more than others."""
    random = np.random.default_rng(5)

    def later(points, faces):
        return TriangleMesh(grown(points, faces, random.normal(1.0, 0.2), random), faces)

    return build(template, provenance, later=later)


@pytest.fixture(scope="module", params=CASES)
def changed(request, seen_again, template):
    """Return a follow-up of a patient who grows as a case says."""
    share, bump = CASES[request.param]
    directions, faces = template
    points, random = shape(directions, np.random.default_rng(11)), np.random.default_rng(7)
    later = points.copy()
    centre = later[np.argmax(directions[:, 2])]
    gaussian = np.exp(-0.5 * np.square(later - centre).sum(axis=1) / 36.0)
    later += bump * gaussian[:, None] * TriangleMesh(points, faces).vertex_normals
    both = TriangleMesh(moved(points, random), faces), TriangleMesh(grown(later, faces, share, random), faces)
    times = [compare_groomed(seen_again, groomed(f"t{n}", mesh), AGE) for n, mesh in enumerate(both)]
    return request.param, compare_times(times, expected=seen_again.change)


def test_a_change_is_judged_by_that_of_controls_seen_twice(changed, seen_again):
    case, follow_up = changed
    (change,) = follow_up.changes
    result = change.expected
    assert seen_again.change.pairs == 24
    assert 0.5 * GROWTH < seen_again.change.local.mean.max() < 1.2 * GROWTH
    if case == "as controls":
        assert not result.regions
        assert result.beyond.value < 0.3
        assert change.distance.max() > 0.5 * GROWTH  # the rigid motion takes a part
    elif case == "not at all":
        assert np.abs(change.distance).max() < 0.3
        assert result.volume.percent < 10.0
        assert result.beyond.percent > 90.0
    else:
        assert result.regions[0].peak == pytest.approx(3.5, abs=1.0)
        top = np.argmax(follow_up.surface.vertices[:, 2])
        assert top in result.regions[0].vertices


def test_the_expected_change_is_kept_in_the_file(seen_again, tmp_path):
    seen_again.save(tmp_path / "ref.npz")
    kept = Reference.load(tmp_path / "ref.npz")
    assert kept.fingerprint == seen_again.fingerprint
    assert kept.change.between == "year apart by 1"
    assert kept.change.limit == seen_again.change.limit


def cohort(cells):
    names = tuple(f"s{number}" for number in range(len(cells)))
    return SimpleNamespace(names=names, columns=tuple({"who": who, "year": year} for who, year in cells))


def test_first_times_are_controls_and_next_ones_their_change():
    cells = [(f"p{number // 3}", str(10 - number % 3)) for number in range(24)] + [("alone", "5")]
    result = seen_twice(cohort(cells), range(25), "who", "year", SimpleNamespace(folder="study"))
    assert result.first == [*range(2, 24, 3), 24]
    assert result.later == {number: 3 * number + 1 for number in range(8)}
    assert result.between == "year apart by 1"


@pytest.mark.parametrize(
    ("cells", "message"),
    [
        ([("p", "1"), ("p", "1.0")], "p has two files of one year"),
        ([("p", "1"), ("", "2")], "s1 has no value in column who"),
        ([("p", "1"), ("p", "2"), ("q", "1")], "1 of 2 controls were scanned twice"),
    ],
)
def test_times_that_do_not_pair_are_refused(cells, message):
    with pytest.raises(InputError, match=message):
        seen_twice(cohort(cells), range(len(cells)), "who", "year", SimpleNamespace(folder="study"))
