"""Distances between two surfaces."""

import numpy as np
import pytest
import trimesh

from homolog.surfaces.comparison import SurfaceDistances, distances_both_ways, surface_distances
from homolog.surfaces.mesh import TriangleMesh


@pytest.fixture(scope="module")
def balls():
    sphere = trimesh.creation.icosphere(subdivisions=3, radius=10.0)
    inner = TriangleMesh(np.array(sphere.vertices), np.array(sphere.faces))
    return inner, TriangleMesh(1.2 * inner.vertices, inner.faces)


def test_concentric_balls_are_everywhere_as_far_apart_as_their_radii(balls):
    inner, outer = balls
    there, back = surface_distances(outer, inner), surface_distances(inner, outer)
    assert there.signed == pytest.approx(2.0, abs=0.03)
    assert back.signed == pytest.approx(-2.0, abs=0.03)
    for item in (there, back):
        assert item.mean == pytest.approx(2.0, abs=0.03)
        assert item.rms == pytest.approx(2.0, abs=0.03)
        assert item.percentile(95.0) == pytest.approx(2.0, abs=0.03)
        assert item.maximum == pytest.approx(2.0, abs=0.03)
    assert (there.bias, back.bias) == pytest.approx((there.mean, -back.mean))
    both = distances_both_ways(outer, inner)  # the larger surface counts more
    assert both.bias == pytest.approx(both.mean * (1.44 - 1.0) / (1.44 + 1.0), abs=0.03)


def test_a_surface_is_at_no_distance_from_itself(balls):
    assert surface_distances(balls[0], balls[0]).maximum < 1e-4


def test_statistics_weigh_each_vertex_by_its_area():
    apart = SurfaceDistances(np.array([1.0, -3.0, 8.0]), np.array([6.0, 3.0, 1.0]))
    assert apart.mean == pytest.approx(2.3)
    assert apart.bias == pytest.approx(0.5)
    assert apart.rms == pytest.approx(np.sqrt(9.7))
    assert (apart.percentile(50.0), apart.percentile(90.0), apart.percentile(95.0)) == (1.0, 3.0, 8.0)
    assert apart.maximum == 8.0
