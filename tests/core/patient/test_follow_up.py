"""A patient at several times: the change is found, the pose is none, and limits come from repeats only."""

from dataclasses import replace

import numpy as np
import pytest

from homolog.errors import InputError
from homolog.patient import compare_groomed, compare_times
from homolog.surfaces.mesh import TriangleMesh

from .conftest import groomed, moved, shape

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
