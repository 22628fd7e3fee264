"""Errors of particles against a dense true correspondence: meshes of all subjects with one topology.

A particle's true place on another subject is the same point of the same face there. Beans have no such
meshes, so `bean_mesh` defines one. The slot and its rim correspond by the meridian of the slot's ellipsoid
and the share of the way from its floor to the rim. On the body, the equator and the lower half correspond to
themselves, and points between them and the rim move in proportion.
"""

from collections.abc import Iterable

import numpy as np
import pyvista

from homolog.arrays import FloatArray
from homolog.beans.generate import Bean
from homolog.beans.surface import rim

AROUND, SLOT, UPPER, LOWER = 384, 48, 48, 48


def bean_mesh(bean: Bean) -> pyvista.PolyData:
    """Return a bean's surface; vertices correspond between the beans of a geometry."""
    edge = (rim(bean, AROUND) - bean.slot_centre) / bean.slot_axes
    angle = 2.0 * np.pi * np.arange(AROUND) / AROUND
    around = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    polar = np.arccos(-edge[:, 2]) * (np.arange(1, SLOT + 1) / SLOT)[:, None]
    slot = np.concatenate([np.sin(polar)[..., None] * around, -np.cos(polar)[..., None]], axis=-1)
    slot = bean.slot_axes * slot + bean.slot_centre

    equator, height = bean.body_axes[:2] * around, bean.body_axes[2]
    share = np.sin(0.5 * np.pi * np.arange(1, UPPER + 1) / UPPER)[:, None, None]  # even steps along the body
    upper = (1.0 - share) * slot[-1, :, :2] + share * equator
    lower = np.cos(0.5 * np.pi * np.arange(1, LOWER) / LOWER)[:, None, None] * equator
    sides = [(upper, height), (lower, -height)]
    body = [np.concatenate([xy, _height(xy, bean, top)[..., None]], axis=-1) for xy, top in sides]
    rings = np.concatenate([slot, *body])
    floor = bean.slot_centre - [0.0, 0.0, bean.slot_axes[2]]
    vertices = np.concatenate([rings.reshape(-1, 3), [floor, [0.0, 0.0, -height]]])
    return pyvista.PolyData.from_regular_faces(vertices, _faces(len(rings)))


def truth_errors(meshes: Iterable[pyvista.PolyData], local: FloatArray) -> FloatArray:
    """Return the errors [mm] of particles (M, N, 3) in file coordinates, between all pairs of subjects.

    Entry (k, i, p) is the distance of particle p of the i-th other subject to the place that corresponds to
    the particle of subject k; shape (M, M - 1, N).
    """
    meshes = list(meshes)
    faces, vertices = meshes[0].regular_faces, np.stack([mesh.points for mesh in meshes]).astype(float)
    assert all(np.array_equal(mesh.regular_faces, faces) for mesh in meshes), "topologies differ"
    errors = np.empty((len(meshes), len(meshes) - 1, local.shape[1]))
    for k, mesh in enumerate(meshes):
        cells, closest = mesh.find_closest_cell(local[k], return_closest_point=True)
        corners = faces[cells]
        first, *others = vertices[k][corners].swapaxes(0, 1)
        sides = np.stack([other - first for other in others], axis=-1)
        inner = (np.linalg.pinv(sides) @ (closest - first)[..., None])[..., 0]
        weights = np.column_stack([1.0 - inner.sum(axis=1), inner])
        true = np.einsum("nc,mncx->mnx", weights, vertices[:, corners])
        errors[k] = np.delete(np.linalg.norm(true - local, axis=2), k, axis=0)
    return errors


def _height(xy: FloatArray, bean: Bean, top: float) -> FloatArray:
    level = ((xy / bean.body_axes[:2]) ** 2).sum(axis=-1)
    return np.asarray(top * np.sqrt(np.maximum(1.0 - level, 0.0)))


def _faces(rings: int) -> FloatArray:
    """Triangles between successive rings, and to the vertices at both ends."""
    at = np.arange(AROUND)
    following = (at + 1) % AROUND
    start = AROUND * np.arange(rings - 1)[:, None]
    between = [
        np.stack(np.broadcast_arrays(start + at, start + following, start + AROUND + at), axis=-1),
        np.stack(
            np.broadcast_arrays(start + following, start + AROUND + following, start + AROUND + at), axis=-1
        ),
    ]
    last = AROUND * (rings - 1)
    first = np.stack([np.full(AROUND, AROUND * rings), following, at], axis=-1)
    end = np.stack([np.full(AROUND, AROUND * rings + 1), last + at, last + following], axis=-1)
    return np.concatenate([*(item.reshape(-1, 3) for item in between), first, end])
