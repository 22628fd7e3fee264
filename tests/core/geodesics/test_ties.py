"""What a triangle makes of amendments must not jump where rounding decides which way is taken."""

import numpy as np
import pytest
import warp as wp

from homolog.geodesics.bearing_kernels import RIVAL, Turns, tie_corner
from homolog.geodesics.kernels import FAR, Corner

LONGEST = 20.0


@wp.kernel
def tie_all(
    corner: Corner,
    da: wp.array(dtype=float),
    db: wp.array(dtype=float),
    u: wp.array(dtype=float),
    gain: wp.array(dtype=float),
    share: wp.array(dtype=float),
):
    """Find the tie of one triangle for many distances of its ends; bearings are not trusted."""
    k = wp.tid()
    tie = tie_corner(corner, Turns(), da[k], db[k], 0.0, 0.0, 0.0, 0.0, u[k], 1.0)
    gain[k] = tie.gain
    share[k] = tie.share


def ties(a, b, c, sources, longer=0.0):
    """Return gains and shares of a flat triangle, seen from its corner c, for sources in its plane.

    The distance at c is the way through the triangle, less how much longer that is.
    """
    a, b, c = (np.asarray(one, dtype=float) for one in (a, b, c))
    side = b - a
    length = np.linalg.norm(side)
    corner = Corner()
    corner.length, corner.half = length, 0.5 / length
    corner.x = (c - a) @ side / length
    corner.y = abs(side[0] * (c - a)[1] - side[1] * (c - a)[0]) / length
    corner.ac, corner.bc = np.linalg.norm(c - a), np.linalg.norm(c - b)
    da, db, dc = (np.linalg.norm(sources - one, axis=1) for one in (a, b, c))
    given = [wp.array(one, dtype=float, device="cpu") for one in (da, db, dc - longer)]
    made = [wp.zeros(len(da), dtype=float, device="cpu") for _ in range(2)]
    wp.launch(tie_all, len(da), inputs=[corner, *given, *made], device="cpu")
    return [one.numpy() for one in made]


@pytest.mark.parametrize("tilt", [0.003, 0.01, 0.03])
def test_the_share_of_a_way_that_grazes_a_side_does_not_jump(tilt):
    heights = np.linspace(-60.0, 0.0, 6001) * tilt
    sources = np.column_stack([np.full(6001, -LONGEST), heights])
    _, share = ties((0.0, 0.0), (1.0, -tilt), (1.5, 0.3 * tilt), sources)
    assert share.max() > 0.3
    assert np.abs(np.diff(share)).max() < 0.02


def test_a_way_that_is_just_short_enough_to_be_a_rival_gains_far_more_than_it_is_longer():
    rival = float(RIVAL)
    longer = np.linspace(0.0, 1.2 * rival, 1201)
    sources = np.tile([0.4, -LONGEST], (1201, 1))
    gain, _ = ties((0.0, 0.0), (1.0, 0.0), (0.5, 0.8), sources, longer)
    near = longer < 0.49 * rival
    np.testing.assert_allclose(gain[near], longer[near], atol=1e-4)
    inside = gain < 0.5 * float(FAR)
    assert longer[inside].max() == pytest.approx(rival, rel=2e-3)
    assert gain[inside].max() > 2.9 * rival
    assert np.diff(gain[inside]).min() > -1e-5
