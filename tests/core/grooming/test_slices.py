import numpy as np
import pytest

from homolog.grooming.slices import interpolated

HEIGHT = 8.0  # pixels between slices


def disc(radius, centre=(0.0, 0.0)):
    y, x = np.mgrid[-30:31, -30:31]
    return np.hypot(x - centre[0], y - centre[1]) < radius


def stacked(*slices):
    return np.stack(slices, axis=-1)


def structure(stack):
    level = np.maximum(stack.outline, stack.ends)
    return level if stack.hole is None else np.maximum(level, -stack.hole)


def heights(mask, step=0.125):
    return np.arange(-1.0, mask.shape[2] + step, step)


def test_between_two_discs_the_radius_changes_evenly():
    mask = stacked(disc(20.0), disc(20.0), disc(12.0), disc(12.0))
    stack = interpolated(mask, HEIGHT, np.array([1.5]), 1.0)
    row = stack.outline[30, 30:, 0]
    assert np.interp(0.0, row, np.arange(len(row))) == pytest.approx(16.0, abs=0.7)


def test_a_solid_stack_holds_what_its_slices_hold():
    mask = stacked(disc(10.0), disc(16.0), disc(18.0), disc(16.0), disc(10.0))
    at = heights(mask)
    inside = (structure(interpolated(mask, HEIGHT, at, 1.0)) < 0.0).sum() * 0.125
    assert inside == pytest.approx(mask.sum(), rel=0.05)


def test_solid_ends_become_domes():
    mask = stacked(disc(15.0), disc(15.0), disc(15.0))
    level = structure(interpolated(mask, HEIGHT, np.array([2.0, 2.4, 2.7, 2.8]), 1.0))
    areas = (level < 0.0).sum(axis=(0, 1))
    assert areas[0] > areas[1] > areas[2] > 0 == areas[3]


def test_a_cup_of_rings_is_open_at_its_wide_end_and_closed_at_its_narrow_one():
    rings = [disc(r) & ~disc(r - 5.0) for r in (22.0, 22.0, 18.0, 12.0)]
    for mask in (stacked(*rings), stacked(*rings[::-1])):
        at = heights(mask)
        stack = interpolated(mask, HEIGHT, at, 1.0)
        middle = structure(stack)[30, 30]
        wide = at < 0.0 if mask[30, 10, 0] else at > 3.0
        assert stack.closed
        assert (middle[wide] > 0.0).all()
        assert (middle[~wide] < 0.0).any()


def test_a_tube_stays_open_at_both_ends():
    ring = disc(20.0) & ~disc(14.0)
    mask = stacked(ring, ring, ring)
    stack = interpolated(mask, HEIGHT, heights(mask), 1.0)
    assert not stack.closed
    assert (structure(stack)[30, 30] > 0.0).all()


def test_open_ends_are_cut_half_a_slice_beyond_the_last():
    ring = disc(20.0) & ~disc(14.0)
    level = structure(interpolated(stacked(ring, ring), HEIGHT, np.array([-0.55, -0.45, 1.45, 1.55]), 1.0))
    assert (level < 0.0).any(axis=(0, 1)).tolist() == [False, True, True, False]


def test_a_wall_that_moves_by_more_than_its_thickness_stays_whole():
    rings = [disc(r) & ~disc(r - 4.0) for r in (24.0, 24.0, 14.0, 14.0)]
    level = structure(interpolated(stacked(*rings), HEIGHT, np.array([1.5]), 1.0))[..., 0]
    crossed = (level[30, 30:] < 0.0).sum()
    assert crossed >= 3
    assert (level[:30, 30] < 0.0).sum() >= 3


def test_a_hole_of_the_inner_slices_only_ends_between_slices():
    solid, ring = disc(20.0), disc(20.0) & ~disc(10.0)
    mask = stacked(solid, ring, ring, solid)
    middle = structure(interpolated(mask, HEIGHT, np.array([0.0, 1.0, 2.0, 3.0]), 1.0))[30, 30]
    assert (middle < 0.0).tolist() == [True, False, False, True]


def test_a_single_slice_makes_a_solid():
    mask = disc(15.0)[..., None]
    at = np.array([-0.8, -0.3, 0.0, 0.3, 0.8])
    inside = (structure(interpolated(mask, HEIGHT, at, 1.0)) < 0.0).any(axis=(0, 1))
    assert inside.tolist() == [False, True, True, True, False]


def test_slices_beside_their_neighbours_are_evened_out():
    centres = [0.0, 0.0, 0.0, 4.0, 0.0, 0.0, 0.0]
    mask = stacked(*(disc(15.0, (x, 0.0)) for x in centres))
    row = interpolated(mask, HEIGHT, np.array([3.0]), 1.0).outline[30, 30:, 0]
    assert 15.5 < np.interp(0.0, row, np.arange(len(row))) < 18.0
