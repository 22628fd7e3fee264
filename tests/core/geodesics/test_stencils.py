"""A corner's update stencil is continuous where rounding decides which path is the shortest."""

import numpy as np
import pytest
import warp as wp

from homolog.geodesics.kernels.local_solver import UNREACHED, Corner
from homolog.geodesics.kernels.second_order import CANDIDATE_TOLERANCE, CornerAngles, corner_stencil

LONGEST = 20.0


@wp.kernel
def find_stencils(
    corner: Corner,
    da: wp.array(dtype=float),
    db: wp.array(dtype=float),
    u: wp.array(dtype=float),
    offset: wp.array(dtype=float),
    weight_b: wp.array(dtype=float),
):
    """Find the stencil of one triangle for many distances of its ends, with no confidence in arrivals."""
    k = wp.tid()
    stencil = corner_stencil(corner, CornerAngles(), da[k], db[k], 0.0, 0.0, 0.0, 0.0, u[k], 1.0)
    offset[k] = stencil.offset
    weight_b[k] = stencil.weight_b


def stencils(a, b, c, sources, excess=0.0):
    """Return offsets and weights of a flat triangle, seen from its corner c, for sources in its plane.

    The distance at c is the path through the triangle, less the excess.
    """
    a, b, c = (np.asarray(item, dtype=float) for item in (a, b, c))
    side = b - a
    length = np.linalg.norm(side)
    corner = Corner()
    corner.length, corner.half = length, 0.5 / length
    corner.x = (c - a) @ side / length
    corner.y = abs(side[0] * (c - a)[1] - side[1] * (c - a)[0]) / length
    corner.ac, corner.bc = np.linalg.norm(c - a), np.linalg.norm(c - b)
    da, db, dc = (np.linalg.norm(sources - item, axis=1) for item in (a, b, c))
    given = [wp.array(item, dtype=float, device="cpu") for item in (da, db, dc - excess)]
    made = [wp.zeros(len(da), dtype=float, device="cpu") for _ in range(2)]
    wp.launch(find_stencils, len(da), inputs=[corner, *given, *made], device="cpu")
    return [item.numpy() for item in made]


@pytest.mark.parametrize("tilt", [0.003, 0.01, 0.03])
def test_the_weights_of_a_path_that_grazes_an_edge_are_continuous(tilt):
    heights = np.linspace(-60.0, 0.0, 6001) * tilt
    sources = np.column_stack([np.full(6001, -LONGEST), heights])
    _, weight_b = stencils((0.0, 0.0), (1.0, -tilt), (1.5, 0.3 * tilt), sources)
    assert weight_b.max() > 0.3
    assert np.abs(np.diff(weight_b)).max() < 0.02


def test_a_candidate_at_the_tolerance_is_penalized_by_far_more_than_its_excess():
    tolerance = float(CANDIDATE_TOLERANCE)
    excess = np.linspace(0.0, 1.2 * tolerance, 1201)
    sources = np.tile([0.4, -LONGEST], (1201, 1))
    offset, _ = stencils((0.0, 0.0), (1.0, 0.0), (0.5, 0.8), sources, excess)
    near = excess < 0.49 * tolerance
    np.testing.assert_allclose(offset[near], excess[near], atol=1e-4)
    inside = offset < 0.5 * float(UNREACHED)
    assert excess[inside].max() == pytest.approx(tolerance, rel=2e-3)
    assert offset[inside].max() > 2.9 * tolerance
    assert np.diff(offset[inside]).min() > -1e-5
