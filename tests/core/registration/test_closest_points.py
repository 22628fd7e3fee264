"""Iterative closest points of several pairs of surfaces together."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from homolog.registration.closest_points import OrientedPoints, SearchedPoints
from homolog.registration.icp import refined, refined_each


def ellipsoid(axes, count, degrees=0.0):
    """Return evenly spaced points of an ellipsoid, turned about its third axis."""
    k = np.arange(count) + 0.5
    polar, azimuth = np.arccos(1.0 - 2.0 * k / count), np.pi * (1.0 + 5.0**0.5) * k
    sphere = np.column_stack(
        [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)]
    )
    normals = sphere / axes
    turn = Rotation.from_euler("z", degrees, degrees=True).as_matrix()
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True) @ turn.T
    return OrientedPoints(sphere * axes @ turn.T, normals, np.zeros(3))


def test_pairs_are_registered_together_as_one_by_one():
    moving = [ellipsoid([1.0, 1.2, 1.5], 300, 10.0), ellipsoid([0.9, 1.3, 1.6], 300, -8.0)]
    fixed = [ellipsoid([1.0, 1.2, 1.5], 1500), ellipsoid([1.1, 1.3, 1.4], 1500)]
    together = refined_each(
        [SearchedPoints(item) for item in moving], [SearchedPoints(item) for item in fixed]
    )
    for own, other, fit in zip(moving, fixed, together, strict=True):
        alone = refined(own, other)
        assert np.allclose(fit.pose, alone.pose, atol=1e-9)
        assert fit.distance == pytest.approx(alone.distance)


def test_point_sets_of_unlike_sizes_are_registered_together():
    shift = np.array([0.1, -0.05, 0.08])
    moving = [ellipsoid([1.0, 1.2, 1.5], count) for count in (280, 450)]
    moving = [replace(item, points=item.points + shift) for item in moving]
    fixed = [ellipsoid([1.0, 1.2, 1.5], count) for count in (700, 1500)]
    for fit in refined_each(
        [SearchedPoints(item) for item in moving], [SearchedPoints(item) for item in fixed]
    ):
        assert np.allclose(fit.pose[:3, 3], -shift, atol=0.02)
