import numpy as np
import pytest
from scipy import ndimage
from skimage import measure

from homolog.grooming.fields import distance_field
from homolog.grooming.levels import Level, level_of_mesh
from homolog.grooming.tunnels import euler_numbers, fill_tunnels
from homolog.surfaces.mesh import TriangleMesh


def euler_number(solid):
    """Of voxels that are connected at faces."""
    return euler_numbers(solid)[0]


def block(*size):
    solid = np.zeros(np.add(size, 4), dtype=bool)
    solid[tuple(slice(2, -2) for _ in size)] = True
    return solid


def bored(width):
    """A thick plate with a square hole through it."""
    solid = block(20, 20, 6)
    solid[9 : 9 + width, 9 : 9 + width] = False
    return solid


@pytest.mark.parametrize("seed", range(3))
def test_the_euler_number_is_that_of_scikit_image(seed):
    solid = ndimage.gaussian_filter(np.random.default_rng(seed).normal(size=(20, 24, 18)), 1.2) > 0.0
    assert euler_numbers(solid) == tuple(measure.euler_number(np.pad(solid, 1), kind) for kind in (1, 3))


@pytest.mark.parametrize("seed", range(3))
def test_a_filled_solid_has_no_more_tunnels_by_faces_and_corners_together(seed):
    solid = ndimage.gaussian_filter(np.random.default_rng(seed).normal(size=(20, 24, 18)), 0.8) > 0.0
    labels, _ = ndimage.label(solid)
    solid = ndimage.binary_fill_holes(np.pad(labels == 1 + np.argmax(np.bincount(labels.ravel())[1:]), 1))
    filled, _ = fill_tunnels(solid, 3.0)
    before, after = (sum(measure.euler_number(item, kind) for kind in (1, 3)) for item in (solid, filled))
    assert after > before
    assert ndimage.label(filled)[1] == 1


@pytest.mark.parametrize("width", [1, 2])
def test_a_narrow_tunnel_is_filled_and_nothing_else_is_changed(width):
    filled, counts = fill_tunnels(bored(width), 3.0)
    assert counts == (1, 1)
    assert euler_number(filled) == 1
    assert not (filled & ~block(20, 20, 6)).any()
    assert (filled | ~bored(width)).all()


def test_a_hole_whose_rim_touches_at_an_edge_only_is_filled():
    solid = block(8, 8, 1)
    solid[2, 2] = solid[3, 3] = False  # a corner, and the voxel across from it
    filled, counts = fill_tunnels(solid, 3.0)
    assert max(counts) == 1
    assert filled[3, 3, 2]
    assert not filled[2, 2, 2]


def test_a_wide_tunnel_stays():
    solid = bored(8)
    filled, counts = fill_tunnels(solid, 3.0)
    assert counts == (0, 0)
    assert np.array_equal(filled, solid)


def test_a_gap_between_parts_that_makes_no_tunnel_stays():
    solid = block(20, 20, 6)
    solid[9:11, :15] = False  # a slot, open at one end
    filled, counts = fill_tunnels(solid, 3.0)
    assert counts == (0, 0)
    assert np.array_equal(filled, solid)


def test_a_wall_of_one_voxel_with_holes_becomes_whole():
    solid = block(24, 24, 1)
    rng = np.random.default_rng(0)
    holes = tuple(rng.integers(4, 22, size=(2, 12)))
    solid[*holes, 2] = False
    filled, _ = fill_tunnels(solid, 3.0)
    assert euler_number(filled) == 1


def test_noise_of_labels_leaves_few_tunnels_and_one_piece():
    rng = np.random.default_rng(1)
    x, y, z = np.mgrid[-20:21, -20:21, -12:13]
    solid = x**2 / 300 + y**2 / 300 + z**2 / 60 + 0.45 * rng.normal(size=x.shape) < 1.0
    labels, _ = ndimage.label(solid)
    solid = ndimage.binary_fill_holes(labels == 1 + np.argmax(np.bincount(labels.ravel())[1:]))
    filled, counts = fill_tunnels(solid, 3.0)
    assert 1 - euler_number(solid) > 100
    assert 1 - euler_number(filled) < 0.2 * (1 - euler_number(solid))
    assert max(counts) == euler_number(filled) - euler_number(solid)
    assert ndimage.label(filled)[1] == 1
    assert not (solid & ~filled).any()


def test_no_width_keeps_all():
    filled, counts = fill_tunnels(bored(1), 0.0)
    assert counts == (0, 0)
    assert np.array_equal(filled, bored(1))


def test_patches_are_looked_at_while_that_is_little_work(monkeypatch):
    wall = np.zeros((30, 30, 30), dtype=bool)
    wall[12:18] = True
    wall[12:18, 13:16, 13:16] = False
    monkeypatch.setattr("homolog.grooming.tunnels.MAX_LOOKS", 0)
    unchanged, filled = fill_tunnels(wall, 4.0)
    assert np.array_equal(unchanged, wall)
    assert filled == (0, 0)


def test_a_sharp_edge_has_no_tunnels_and_a_bore_has_one():
    corners = np.array([[0, 0, 0], [10, 0, 0], [0, 10, 0], [0, 0, 12.0]])
    sharp = TriangleMesh(corners, np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]))
    level = level_of_mesh(sharp, None)
    fewest, most = sorted(fill_tunnels(level.values < 0.0, 3.0)[1])
    assert fewest <= 0 < most
    assert not distance_field(level, 1.0, 3.0).notes
    values = np.pad(np.where(bored(2), -1.0, 1.0), 6, constant_values=1.0)
    notes = distance_field(Level(values, np.eye(4), 1.0), 1.0, 3.0).notes
    assert len(notes) == 1
    assert notes[0].endswith(": 1")
