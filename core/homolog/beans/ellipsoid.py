"""Exact geometry of an ellipsoid at the origin."""

import numpy as np
from scipy import special

from homolog.arrays import FloatArray

__all__ = ["closest_on_ellipsoid", "ellipsoid_area", "ellipsoid_level", "ellipsoid_normals", "spread_points"]

_NEWTON_STEPS = 60
_SMALL = 1e-9


def ellipsoid_level(points: FloatArray, axes: FloatArray) -> FloatArray:
    """Return (x/a)² + (y/b)² + (z/c)² - 1 for points (..., 3): negative inside."""
    return np.asarray(((points / axes) ** 2).sum(axis=-1) - 1.0)


def ellipsoid_normals(points: FloatArray, axes: FloatArray) -> FloatArray:
    """Return unit outward normals, shape (..., 3), at points of the surface."""
    gradient = points / axes**2
    return np.asarray(gradient / np.linalg.norm(gradient, axis=-1, keepdims=True))


def closest_on_ellipsoid(points: FloatArray, axes: FloatArray) -> FloatArray:
    """Return the closest points on the surface of an ellipsoid, for points inside or outside.

    Parameters
    ----------
    points : (n, 3) array
        Positions relative to the centre.
    axes : (3,) array
        Semi-axes.

    Notes
    -----
    The nearest point is q_i = a_i² p_i / (t + a_i²) with the largest root t of
    sum (a_i p_i / (t + a_i²))² = 1; Newton's method rises to it from below, because the left side is
    convex and decreasing (D. Eberly, "Distance from a point to an ellipse, an ellipsoid, or a
    hyperellipsoid", 2013).
    """
    side = np.where(points < 0.0, -1.0, 1.0)
    p = np.maximum(np.abs(points), _SMALL * axes)
    squares = axes**2
    t = (axes * p - squares).max(axis=1, keepdims=True)
    for _ in range(_NEWTON_STEPS):
        terms = (axes * p / (t + squares)) ** 2
        step = (terms.sum(axis=1, keepdims=True) - 1.0) / (2.0 * terms / (t + squares)).sum(
            axis=1, keepdims=True
        )
        t = t + np.maximum(step, 0.0)
        if step.max(initial=0.0) < 1e-11 * squares.max():
            break
    return np.asarray(side * squares * p / (t + squares))


def ellipsoid_area(axes: FloatArray) -> float:
    """Return the surface area, by Legendre's formula with incomplete elliptic integrals."""
    c, b, a = np.sort(axes)
    if a == c:
        return float(4.0 * np.pi * a**2)
    angle = np.arccos(c / a)
    modulus = a**2 * (b**2 - c**2) / (b**2 * (a**2 - c**2))
    second, first = special.ellipeinc(angle, modulus), special.ellipkinc(angle, modulus)
    sine, cosine = np.sin(angle), np.cos(angle)
    return float(2.0 * np.pi * (c**2 + a * b / sine * (second * sine**2 + first * cosine**2)))


def spread_points(axes: FloatArray, count: int) -> FloatArray:
    """Return a Fibonacci lattice on the surface, shape (count, 3): even up to the axes' stretch."""
    index = np.arange(count) + 0.5
    z = 1.0 - 2.0 * index / count
    turn = np.pi * (1.0 + np.sqrt(5.0)) * index
    radius = np.sqrt(1.0 - z**2)
    return np.asarray(np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=1) * axes)
