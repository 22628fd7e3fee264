"""Particles that came to lie on another wall of one shape than of most, or in each other's place: moved back.

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
from homolog.correspondence.start import features, snapped, spread_indices
from homolog.errors import InputError

__all__ = ["exchanged", "move_back", "predicted", "put_right", "strays"]

ANGLE = np.radians(45.0)  # from the mean normal, of a stray …
BEYOND = 3.0  # … and so many times the median over the shapes, which so have to agree
FEWEST = 3  # shapes that it takes to say which of them is the odd one
LOCAL = 0.1  # share of a shape's particles; where more disagree, it is matched differently as a whole
AROUND = 8  # particles that tell where one between them ought to be
CLEARLY, EITHER = 0.5, 0.8  # of the distances of two particles, and of either, from where they ought to be
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
    posed, normals, means = engine.posed_positions(), engine.posed_normals(), engine.host_means()
    wrong = strays(normals, means) & allowed
    partners = exchanged(posed, means)
    swapped = (partners != np.arange(posed.shape[1])) & allowed & ~wrong
    swapped &= np.take_along_axis(swapped, partners, axis=1)
    if swapped.any():
        order = np.where(swapped, partners, np.arange(posed.shape[1]))
        engine.place(np.take_along_axis(engine.host_positions().astype(np.float64), order[..., None], axis=1))
    if wrong.any():
        move_back(engine, wrong)
    moved: BoolArray = wrong | swapped
    return moved


def exchanged(posed: FloatArray, means: FloatArray) -> IntArray:
    """Return the particle that stands in each one's place on its shape, itself for nearly all, (M, N).

    Where a particle ought to be follows from the mean of all shapes and from how the particles around it
    depart from theirs. Two that lie much nearer to each other's place than to their own are exchanged.

    Parameters
    ----------
    posed : (M, N, 3) array
        Particles as they are compared.
    means : (N, 3) array
        Mean unit normals.
    """
    n_shapes, count = posed.shape[:2]
    partners = np.tile(np.arange(count), (n_shapes, 1))
    if n_shapes < FEWEST or count <= AROUND + 2:
        return partners
    mean = posed.mean(axis=0)
    around = np.asarray(cKDTree(features(mean, means)).query(features(mean, means), k=AROUND + 1)[1])[:, 1:]
    for k in range(n_shapes):
        away = posed[k] - mean
        places = mean + np.median(away[around], axis=1)
        error = np.linalg.norm(posed[k] - places, axis=1)
        near = np.asarray(cKDTree(posed[k]).query(places, k=2)[1])
        first = np.where(near[:, 0] == np.arange(count), near[:, 1], near[:, 0])
        mutual = np.flatnonzero((first[first] == np.arange(count)) & (np.arange(count) < first))
        i, j = mutual, first[mutual]
        other_i = np.linalg.norm(posed[k, j] - places[i], axis=1)
        other_j = np.linalg.norm(posed[k, i] - places[j], axis=1)
        better = other_i + other_j < CLEARLY * (error[i] + error[j])
        better &= (other_i < EITHER * error[i]) & (other_j < EITHER * error[j])
        partners[k, i[better]], partners[k, j[better]] = j[better], i[better]
    return partners


def move_back(engine: Engine, wrong: BoolArray) -> None:
    """Move misplaced particles (M, N) of an engine to where the other shapes have them.

    Not all particles of a shape may be misplaced.
    """
    means = engine.host_means()
    posed = np.where(wrong[..., None], 0.0, engine.posed_positions())  # lost ones may not be numbers
    goals = transformed(inverted(engine.poses), predicted(posed, wrong, engine.launch.breathe))
    normals = np.einsum("mji,nj->mni", turns_of(engine.poses), means)
    positions = engine.host_positions().astype(np.float64)
    for k in np.flatnonzero(wrong.any(axis=1)).tolist():
        engine.launch.breathe()
        moved = wrong[k]
        positions[k, moved] = snapped(goals[k, moved], normals[k, moved], engine.level.meshes[k])
    engine.place(positions)


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
            raise InputError(
                "all particles of one subject are misplaced; fit the subject to the others instead"
            )
        sought, known = np.flatnonzero(misplaced[k]), np.flatnonzero(~misplaced[k])
        near = np.argsort(cKDTree(others[sought]).query(others[known])[0])[:NEAR]
        far = spread_indices(others[known], min(FAR, len(known)))
        guides = known[np.union1d(near, far)]
        carry = RBFInterpolator(others[guides], world[k, guides], kernel="linear", degree=1)
        result[k, sought] = carry(others[sought])
    return result
