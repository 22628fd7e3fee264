"""Particles that came to lie on another wall of one shape than of most: found by normals, and put right.

A particle that has slipped over a rim feels nothing on the flat wall behind it that would bring it back.
Where the other shapes agree, they tell its place.
"""

from collections.abc import Callable

import numpy as np
from scipy.interpolate import RBFInterpolator
from scipy.spatial import cKDTree

from homolog.arrays import BoolArray, FloatArray, IntArray
from homolog.correspondence.engine import Engine, turns_of
from homolog.correspondence.poses import inverted, transformed
from homolog.correspondence.start import features, spread_indices, vertex_normals
from homolog.errors import InputError
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["predicted", "put_right", "snapped", "strays"]

ANGLE = np.radians(45.0)  # from the mean normal, of a stray …
BEYOND = 3.0  # … and so many times the median over the shapes, which so have to agree
FEWEST = 3  # shapes that it takes to say which of them is the odd one
LOCAL = 0.1  # share of a shape's particles; where more disagree, it is matched differently as a whole
ALIKE = 0.5  # cosine from which a surface faces as it does nearby
NEAR, FAR = 300, 100  # particles around the misplaced ones that tell their place, and more all over the shape


def strays(normals: FloatArray, means: FloatArray) -> BoolArray:
    """Return which particles face another way than on most shapes, (M, N).

    Parameters
    ----------
    normals : (M, N, 3) array
        Unit normals as they are compared.
    means : (N, 3) array
        Their Fréchet means over the shapes.
    """
    angles = np.arccos(np.clip(np.einsum("mnd,nd->mn", normals, means), -1.0, 1.0))
    found: BoolArray = (angles > ANGLE) & (angles > BEYOND * np.median(angles, axis=0))
    found[found.mean(axis=1) > LOCAL] = False
    return found & (len(normals) >= FEWEST)


def put_right(engine: Engine, allowed: BoolArray) -> BoolArray:
    """Move an engine's strays to where the other shapes have them; returns which were moved, (M, N).

    Parameters
    ----------
    engine : Engine
    allowed : (M, N) bool array
        Particles that may be moved.
    """
    means = engine.host_means()
    wrong = strays(engine.posed_normals(), means) & allowed
    if not wrong.any():
        return wrong
    goals = transformed(
        inverted(engine.poses), predicted(engine.posed_positions(), wrong, engine.launch.breathe)
    )
    normals = np.einsum("mji,nj->mni", turns_of(engine.poses), means)
    positions = engine.host_positions().astype(np.float64)
    for k in np.flatnonzero(wrong.any(axis=1)).tolist():
        engine.launch.breathe()
        one = wrong[k]
        positions[k, one] = snapped(goals[k, one], normals[k, one], engine.level.meshes[k])
    engine.place(positions)
    return wrong


def predicted(
    world: FloatArray, misplaced: BoolArray, breathe: Callable[[], None] = lambda: None
) -> FloatArray:
    """Return particles of which the misplaced ones are where the other subjects have them.

    Parameters
    ----------
    world : (M, N, 3) array
        Aligned particles.
    misplaced : (M, N) bool array
        Those to be moved.
    breathe : callable
        Called before each subject; it may raise to stop the work.

    Returns
    -------
    (M, N, 3) array
        For each subject the mean of the others is carried to it by a thin-plate map through the particles
        that are in place, most of them around the misplaced ones.

    Raises
    ------
    InputError
        If on some subject none is in place.
    """
    result = world.copy()
    for k in np.flatnonzero(misplaced.any(axis=1)).tolist():
        breathe()
        trusted = ~misplaced
        trusted[k] = False
        trusted[:, ~trusted.any(axis=0)] = True  # misplaced on all others: better they than none
        trusted[k] = False
        weights = trusted / trusted.sum(axis=0)
        others = np.einsum("mn,mnd->nd", weights, world)
        if misplaced[k].all():
            raise InputError("no particle of one subject is in place; fit the subject to the others instead")
        sought, known = np.flatnonzero(misplaced[k]), np.flatnonzero(~misplaced[k])
        near = np.argsort(cKDTree(others[sought]).query(others[known])[0])[:NEAR]
        far = spread_indices(others[known], min(FAR, len(known)))
        guides = known[np.union1d(near, far)]
        carry = RBFInterpolator(others[guides], world[k, guides], kernel="linear", degree=1)
        result[k, sought] = carry(others[sought])
    return result


def snapped(points: FloatArray, normals: FloatArray, mesh: TriangleMesh) -> FloatArray:
    """Return points on a mesh near the given ones, on the side that faces as the normals do, (n, 3)."""
    facing = vertex_normals(mesh)
    nearest: IntArray = np.asarray(
        cKDTree(features(mesh.vertices, facing)).query(features(points, normals))[1]
    )
    feet, upward = mesh.vertices[nearest], facing[nearest]
    aside = points - feet
    aside -= upward * np.einsum("nd,nd->n", aside, upward)[:, None]
    length = np.linalg.norm(aside, axis=1, keepdims=True)
    there: FloatArray = feet + aside * np.minimum(1.0, mesh.mean_edge / np.maximum(length, 1e-12))
    around = facing[np.asarray(cKDTree(mesh.vertices).query(there)[1])]
    through = np.einsum("nd,nd->n", around, upward) < ALIKE  # the wall is thin and bends
    there[through] = feet[through]
    return there
