import numpy as np
import pytest
from scipy import ndimage

from homolog.grooming.clean import cleaned
from homolog.io.images import Segmentation
from homolog.settings import Pieces
from homolog.surfaces.topology import without_cavities


def segmentation(mask, spacing=(1.0, 1.0, 1.0)):
    return Segmentation(mask, np.eye(3), np.array(spacing), np.array([10.0, 20.0, 30.0]))


def test_the_largest_piece_stays_at_its_place():
    mask = np.zeros((12, 12, 12), bool)
    mask[1:3, 1:3, 1:3] = True
    mask[5:10, 6:10, 7:10] = True
    result = cleaned(segmentation(mask, (1.0, 2.0, 3.0)))
    assert result.components_dropped == 1
    assert result.segmentation.mask.shape == (5, 4, 3)
    assert np.allclose(result.segmentation.origin, [10 + 5, 20 + 12, 30 + 21])


def test_pieces_that_touch_at_a_corner_are_one():
    mask = np.zeros((6, 6, 6), bool)
    mask[1:3, 1:3, 1:3] = mask[3:5, 3:5, 3:5] = True
    assert cleaned(segmentation(mask)).components_dropped == 0


def test_enclosed_cavities_are_filled_and_counted():
    mask = np.zeros((9, 9, 9), bool)
    mask[1:8, 1:8, 1:8] = True
    mask[3, 3, 3] = mask[5, 5, 5] = False
    result = cleaned(segmentation(mask))
    assert result.holes_filled == 2
    assert result.segmentation.mask.all()


def test_a_tunnel_is_not_a_cavity():
    mask = np.zeros((9, 9, 9), bool)
    mask[1:8, 1:8, 1:8] = True
    mask[4, 4] = False
    result = cleaned(segmentation(mask))
    assert result.holes_filled == 0
    assert not result.segmentation.mask.all()


def test_touching_the_border_is_noticed_unless_a_dropped_piece_does():
    mask = np.zeros((8, 8, 8), bool)
    mask[2:6, 2:6, 2:6] = True
    mask[0, 0, 0] = True
    assert not cleaned(segmentation(mask)).borders
    mask[2:8, 2:6, 2:6] = True
    assert cleaned(segmentation(mask)).borders


@pytest.mark.parametrize("shape", [(3, 4, 5), (20, 21, 22), (40, 30), (1, 5, 5)])
@pytest.mark.parametrize("share", [0.0, 0.4, 0.7, 0.95, 1.0])
def test_cavities_are_filled_as_scipy_fills_them(shape, share):
    solid = np.random.default_rng(0).random(shape) < share
    assert np.array_equal(without_cavities(solid), ndimage.binary_fill_holes(solid))


def ring(across, inner, size=20):
    away = np.linalg.norm(np.indices((size, size)) - (size - 1) / 2.0, axis=0)
    return (away <= across) & (away >= inner)


def test_a_cap_below_the_opening_of_a_ring_is_one_piece_with_it_in_a_stack():
    mask = np.zeros((20, 20, 6), bool)
    mask[..., 1:5] = ring(8.0, 5.0)[..., None]
    mask[..., 5] = ring(3.0, 0.0)
    stack = cleaned(segmentation(mask, (1.0, 1.0, 5.0)))
    assert stack.components_dropped == 0
    assert stack.segmentation.mask.sum() == mask.sum()
    assert cleaned(segmentation(mask)).components_dropped == 1  # nothing interpolates between cubes


def test_an_island_in_the_hole_of_its_own_slices_stays_a_piece_of_its_own():
    mask = np.zeros((20, 20, 6), bool)
    mask[..., 1:5] = ring(8.0, 5.0)[..., None]
    mask[..., 2:4] |= ring(1.5, 0.0)[..., None]
    assert cleaned(segmentation(mask, (1.0, 1.0, 5.0))).components_dropped == 1


@pytest.mark.parametrize("spacing", [(1.0, 1.0, 1.0), (1.0, 1.0, 4.0)])
def test_all_pieces_are_joined_by_the_shortest_bridges(spacing):
    mask = np.zeros((40, 12, 12), bool)
    for start in (1, 14, 30):
        mask[start : start + 8, 2:10, 2:10] = True
    result = cleaned(segmentation(mask, spacing), Pieces.ALL)
    assert result.components_dropped == 0
    assert sorted(result.bridges) == [6.0, 9.0]
    assert ndimage.label(result.segmentation.mask)[1] == 1
    assert (result.segmentation.mask & ~mask[1:38, 2:10, 2:10]).any(axis=(1, 2)).sum() == 5 + 8
