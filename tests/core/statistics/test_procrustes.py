import numpy as np
from scipy.spatial.transform import Rotation

from homolog.statistics.procrustes import align, rms_radii


def _scattered(shape, seed, count=8):
    """The same shape turned, moved and scaled at random."""
    generator = np.random.default_rng(seed)
    turns = Rotation.random(count, rng=generator).as_matrix()
    scales = generator.uniform(0.8, 1.2, (count, 1, 1))
    return scales * (shape @ turns) + generator.normal(size=(count, 1, 3)) * 10.0, scales[:, 0, 0]


def test_copies_of_one_shape_fall_together_with_scaling_and_differ_in_size_without(ellipsoids):
    shapes, scales = _scattered(ellipsoids(subjects=2)[0], 0)
    scaled = align(shapes, scaling=True)
    np.testing.assert_allclose(scaled, np.broadcast_to(scaled[0], scaled.shape), atol=1e-9)
    rigid = align(shapes, scaling=False)
    np.testing.assert_allclose(rms_radii(rigid), rms_radii(shapes))
    np.testing.assert_allclose(rms_radii(shapes) / rms_radii(shapes)[0], scales / scales[0])


def test_mirror_images_are_not_turned_into_each_other(ellipsoids):
    shape = ellipsoids(subjects=2, noise=2.0)[0]
    both = align(np.array([shape, shape * [-1.0, 1.0, 1.0]]), scaling=False)
    assert np.linalg.norm(both[0] - both[1], axis=1).mean() > 1.0


def test_aligned_shapes_stay_where_they_are(ellipsoids):
    shapes = align(ellipsoids() + np.array([100.0, -50.0, 20.0]), scaling=False)
    np.testing.assert_allclose(align(shapes, scaling=False), shapes, atol=1e-6)
    scaled = align(shapes, scaling=True)
    np.testing.assert_allclose(scaled.mean(axis=(0, 1)), shapes.mean(axis=(0, 1)), atol=1e-9)
    assert np.linalg.norm(scaled.mean(axis=0) - shapes.mean(axis=0), axis=1).max() < 0.5
