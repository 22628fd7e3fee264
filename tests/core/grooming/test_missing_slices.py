"""Slices that were left out of a label map."""

import numpy as np
import pytest

from homolog.grooming.missing_slices import with_missing_slices
from homolog.io.images import Segmentation

AXES = pytest.mark.parametrize("axis", [0, 1, 2])


def cone(axis):
    """Return a cone in an image of 1 x 2 x 3 mm voxels; its radius is 9 at slice 2 and 3 at slice 14."""
    squares = np.square(np.arange(21) - 10.0)
    radii = np.where((np.arange(17) < 2) | (np.arange(17) > 14), 0.0, 10.0 - 0.5 * np.arange(17))
    mask = squares[:, None] + squares < np.square(radii)[:, None, None]
    return Segmentation(
        np.moveaxis(mask, 0, axis), np.eye(3), np.array([1.0, 2.0, 3.0]), np.array([10.0, 20.0, 30.0])
    )


def without(segmentation, axis, slices):
    mask = np.moveaxis(segmentation.mask.copy(), axis, 0)
    mask[slices] = False
    return Segmentation(
        np.moveaxis(mask, 0, axis), segmentation.rotation, segmentation.spacing, segmentation.origin
    )


@AXES
def test_a_forgotten_slice_is_filled_halfway_between_its_neighbours(axis):
    whole = cone(axis)
    result, notes = with_missing_slices(without(whole, axis, [6]))
    assert len(notes) == 1
    areas = np.moveaxis(result.mask, axis, 0).sum(axis=(1, 2))
    assert areas[7] <= areas[6] <= areas[5]
    assert np.array_equal(np.delete(result.mask, 6, axis), np.delete(whole.mask, 6, axis))


@AXES
def test_slices_at_a_regular_distance_become_thick_ones(axis):
    whole = cone(axis)
    result, notes = with_missing_slices(without(whole, axis, np.arange(17) % 3 != 0))
    assert len(notes) == 1
    assert result.spacing[axis] == 3.0 * whole.spacing[axis]
    assert result.volume == pytest.approx(whole.volume, rel=0.1)
    first = result.origin + np.eye(3)[axis] * result.spacing[axis]
    assert first[axis] == whole.origin[axis] + 3 * whole.spacing[axis]
    assert not np.take(result.mask, [0, -1], axis).any()


@pytest.mark.parametrize("slices", [[], [6, 7]], ids=["none", "two"])
def test_other_gaps_stay(slices):
    segmentation = without(cone(2), 2, slices)
    result, notes = with_missing_slices(segmentation)
    assert np.array_equal(result.mask, segmentation.mask)
    assert not notes


def test_pieces_side_by_side_with_an_empty_slice_between_are_not_joined():
    mask = np.zeros((12, 12, 9), bool)
    mask[1:5, 1:5, 1:4] = mask[7:11, 7:11, 5:8] = True
    result, notes = with_missing_slices(Segmentation(mask, np.eye(3), np.ones(3), np.zeros(3)))
    assert np.array_equal(result.mask, mask)
    assert not notes
