"""Opening angles: what they are on surfaces where they are known."""

import numpy as np

from homolog.correspondence.entropy.opening_angles import opening_grid, openings_at
from homolog.surfaces.distance_field import DistanceField


def box(half, spacing=1.0, margin=20.0):
    """A box around the origin as a distance field."""
    count = np.ceil((np.asarray(half) + margin) / spacing).astype(int)
    lines = [np.arange(-n, n + 1) * spacing for n in count]
    grid = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1)
    q = np.abs(grid) - half
    values = np.linalg.norm(np.maximum(q, 0.0), axis=-1) + np.minimum(q.max(axis=-1), 0.0)
    frame = np.diag([spacing] * 3 + [1.0])
    frame[:3, 3] = [line[0] for line in lines]
    return DistanceField(values, frame)


def angles(points, field):
    return openings_at(points, *opening_grid(field, 4.0))


def test_the_opening_angle_is_that_between_the_faces_of_an_edge():
    field = box((25.0, 25.0, 25.0))
    points = np.array([[25.0, 3.0, 2.0], [25.0, 25.0, 1.0], [25.0, 25.0, 25.0]])
    expected = np.array([np.pi, np.pi / 2, np.pi / 4])  # a plane, an edge, a corner
    np.testing.assert_allclose(angles(points, field), expected, atol=0.05)


def test_a_finer_grid_gives_the_same_angles():
    points = np.array([[12.0, 1.0, 2.0], [12.0, 10.0, 1.0], [8.0, 12.0, 12.0]])
    coarse, fine = (angles(points, box((12.0, 12.0, 12.0), spacing)) for spacing in (1.0, 0.5))
    np.testing.assert_allclose(fine, coarse, atol=0.05)


def test_the_angles_do_not_depend_on_how_far_the_grid_reaches():
    points = np.array([[12.0, 1.0, 2.0], [12.0, 9.0, 1.0], [12.0, 9.0, 7.0]])
    wide, tight = (angles(points, box((12.0, 9.0, 7.0), margin=m)) for m in (20.0, 3.0))
    np.testing.assert_allclose(tight, wide, atol=1e-3)
