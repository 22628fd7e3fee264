"""The exact surface of a bean: outer ellipsoid, slot and the sharp rim where they meet."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from homolog.arrays import BoolArray, FloatArray, IntArray
from homolog.beans.ellipsoid import (
    closest_on_ellipsoid,
    ellipsoid_area,
    ellipsoid_level,
    ellipsoid_normals,
    spread_points,
)
from homolog.beans.generate import Bean

__all__ = ["BeanContact", "closest_on_bean", "rim", "surface_areas", "surface_points"]

_RIM_POINTS = 2048
_WALL_STEEPNESS = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class BeanContact:
    """The closest surface points of some points, with normals and location.

    Attributes
    ----------
    points : (n, 3) array
        Nearest points of the bean's surface [mm].
    distance : (n,) array
        Signed distance to them [mm], negative in the solid.
    normals : (n, 3) array
        Exact unit outward normals of the bean at `points`. On the rim, whose normals form a fan, the
        direction from the rim to the point.
    on_slot : (n,) bool array
        Whether the closest point is on the slot's surface; on the rim, the surface whose normal is nearer to
        `normals` decides.
    wall : (n,) int array
        -1 or 1 on a wall of the slot (the side of its centre line y = position); 0 off the slot and on its
        floor, where the normal is less than 30° from the xz plane.
    """

    points: FloatArray
    distance: FloatArray
    normals: FloatArray
    on_slot: BoolArray
    wall: IntArray


def rim(bean: Bean, count: int = _RIM_POINTS) -> FloatArray:
    """Return points of the closed curve where slot and outer ellipsoid meet, shape (count, 3).

    Along every meridian of the slot ellipsoid, from its lowest point (inside the bean) to its equator
    (outside), the curve is crossed once; the crossing is found by bisection.
    """
    angle = 2.0 * np.pi * np.arange(count) / count
    low, high = np.zeros(count), np.full(count, np.pi / 2.0)
    for _ in range(52):
        middle = (low + high) / 2.0
        inside = ellipsoid_level(_on_slot_sphere(bean, middle, angle), bean.body_axes) < 0.0
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return _on_slot_sphere(bean, low, angle)


def closest_on_bean(points: FloatArray, bean: Bean) -> BeanContact:
    """Find the nearest points on the analytic surface.

    Parameters
    ----------
    points : (n, 3) array
        Positions in the bean's frame [mm].
    bean : Bean
        The shape.

    Notes
    -----
    Candidates are the closest points on the two ellipsoids, if these belong to the bean, and on the rim (a
    fine polygon, accurate to 1e-4 mm). The result is exact for points near the surface, such as particles;
    for points far above the slot's opening or deep in the solid the distance is an upper bound.
    """
    points = np.asarray(points, dtype=np.float64)
    centre = bean.slot_centre
    body = closest_on_ellipsoid(points, bean.body_axes)
    slot = closest_on_ellipsoid(points - centre, bean.slot_axes) + centre
    edge = _closest_on_rim(points, bean)
    candidates = np.stack([body, slot, edge])
    reach = np.linalg.norm(candidates - points, axis=2)
    reach[0, ellipsoid_level(body - centre, bean.slot_axes) < 0.0] = np.inf
    reach[1, ellipsoid_level(slot, bean.body_axes) > 0.0] = np.inf
    sheet = reach.argmin(axis=0)
    index = np.arange(len(points))
    nearest, distance = candidates[sheet, index], reach[sheet, index]

    outside = (ellipsoid_level(points, bean.body_axes) > 0.0) | (
        ellipsoid_level(points - centre, bean.slot_axes) < 0.0
    )
    body_normals = ellipsoid_normals(nearest, bean.body_axes)
    slot_normals = -ellipsoid_normals(nearest - centre, bean.slot_axes)
    normals = np.where((sheet == 1)[:, None], slot_normals, body_normals)
    fan = (sheet == 2) & (distance > 0.0)
    normals[fan] = (points - nearest)[fan] / distance[fan, None]
    slot_nearer = ((slot_normals - body_normals) * normals).sum(axis=1) > 0.0
    on_slot = np.where(sheet == 2, slot_nearer, sheet == 1)
    steep = np.abs(slot_normals[:, 1]) > _WALL_STEEPNESS
    wall = np.where(on_slot & steep, np.sign(nearest[:, 1] - bean.position), 0.0).astype(np.int8)
    return BeanContact(nearest, np.where(outside, distance, -distance), normals, on_slot, wall)


def surface_areas(bean: Bean) -> tuple[float, float]:
    """Return the bean's surface area and the part of it that is the slot's [mm²].

    Gauss-Legendre quadrature along the slot's meridians, the trapezoidal rule around: both converge
    spectrally on these smooth integrands.
    """
    count = 512
    angle = 2.0 * np.pi * np.arange(count) / count
    a, b, c = bean.slot_axes
    nodes, weights = np.polynomial.legendre.leggauss(32)
    share, weights = (nodes + 1.0) / 2.0, weights / 2.0
    edge = (rim(bean, count) - bean.slot_centre) / bean.slot_axes
    polar = np.arccos(-edge[:, 2]) * share[:, None]
    ring = np.sqrt(
        (b * c * np.cos(angle) * np.sin(polar)) ** 2
        + (a * c * np.sin(angle) * np.sin(polar)) ** 2
        + (a * b * np.cos(polar)) ** 2
    ) * np.sin(polar)
    slot = float((weights[:, None] * ring * np.arccos(-edge[:, 2])).sum() * 2.0 * np.pi / count)
    outer = np.hypot(edge[:, 0], edge[:, 1])
    radius = outer * share[:, None]
    x = a * radius * np.cos(angle)
    y = bean.position + b * radius * np.sin(angle)
    big_a, big_b, big_c = bean.body_axes
    height = np.sqrt(1.0 - (x / big_a) ** 2 - (y / big_b) ** 2)
    slope = np.sqrt(1.0 + (big_c * x / big_a**2 / height) ** 2 + (big_c * y / big_b**2 / height) ** 2)
    cap = float((weights[:, None] * slope * a * b * radius * outer).sum() * 2.0 * np.pi / count)
    return ellipsoid_area(bean.body_axes) - cap + slot, slot


def surface_points(bean: Bean, count: int = 16000) -> tuple[FloatArray, FloatArray]:
    """Return points that cover the bean's surface densely and their outward normals, both (n, 3).

    About `count` points are placed on each ellipsoid; those that belong to the bean are kept.
    """
    body = spread_points(bean.body_axes, count)
    body = body[ellipsoid_level(body - bean.slot_centre, bean.slot_axes) > 0.0]
    slot = spread_points(bean.slot_axes, count // 4)
    kept = slot[ellipsoid_level(slot + bean.slot_centre, bean.body_axes) < 0.0]
    normals = [ellipsoid_normals(body, bean.body_axes), -ellipsoid_normals(kept, bean.slot_axes)]
    return np.concatenate([body, kept + bean.slot_centre]), np.concatenate(normals)


def _on_slot_sphere(bean: Bean, polar: FloatArray, angle: FloatArray) -> FloatArray:
    """Points of the slot ellipsoid: polar angle from its lowest point, angle around z."""
    unit = [np.sin(polar) * np.cos(angle), np.sin(polar) * np.sin(angle), -np.cos(polar)]
    return np.asarray(bean.slot_centre + bean.slot_axes * np.stack(unit, axis=-1))


def _closest_on_rim(points: FloatArray, bean: Bean) -> FloatArray:
    curve = rim(bean)
    _, index = cKDTree(curve).query(points)
    best: FloatArray = curve[index]
    reach = np.full(len(points), np.inf)
    for step in (-1, 1):
        start, side = curve[index], curve[(index + step) % len(curve)] - curve[index]
        along = ((points - start) * side).sum(axis=1) / (side**2).sum(axis=1)
        foot = start + np.clip(along, 0.0, 1.0)[:, None] * side
        distance = np.linalg.norm(points - foot, axis=1)
        best = np.where((distance < reach)[:, None], foot, best)
        reach = np.minimum(reach, distance)
    return best
