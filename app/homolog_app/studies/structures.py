"""What of a model of several structures is looked at: all, one, shapes without pose, or pose alone."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise

import numpy as np

from homolog.arrays import frozen
from homolog.errors import InputError
from homolog.geometry import fit_similarity, rotation_of, transform_points
from homolog.io.project import ProjectFolder
from homolog.io.results import Part, Result
from homolog.statistics.relative_pose import relative_poses
from homolog.surfaces.mesh import joined
from homolog_app.studies.loaded_result import LoadedResult

__all__ = [
    "ALL",
    "POSES",
    "SHAPES",
    "aspect_of",
    "aspects_of",
    "part_of_aspect",
    "project_of_aspect",
]

ALL, SHAPES, POSES = "", "shapes", "poses"
"""Aspects of a model of several structures; others are ``structure:NAME``."""
_ONE = "structure:"


def aspects_of(loaded: LoadedResult) -> dict[str, str]:
    """Return the aspects of a result, by their titles; none for a single structure."""
    if not loaded.parts:
        return {}
    reference = _reference(loaded)
    whole = {
        "All structures, as they lie": ALL,
        "All shapes, without relative pose": SHAPES,
        f"Pose relative to {reference}, without shapes": POSES,
    }
    return whole | {f"{name} alone": f"{_ONE}{name}" for name in loaded.parts}


def aspect_of(loaded: LoadedResult, aspect: str) -> LoadedResult:
    """Return a result of an aspect of another one.

    Raises
    ------
    InputError
        If there is no such aspect.
    """
    if aspect not in ("", *aspects_of(loaded).values()):
        raise InputError(f"{aspect}: the result has no such structure")
    if aspect == ALL:
        return loaded
    if aspect in (SHAPES, POSES):
        results = {name: part.result for name, part in loaded.parts.items()}
        result = _apart(loaded.result, results, _reference(loaded), aspect)
        return replace(loaded, result=result, is_rigid=aspect == POSES)
    return loaded.parts[aspect.removeprefix(_ONE)]


def part_of_aspect(loaded: LoadedResult, aspect: str) -> LoadedResult:
    """Return the result whose subjects an aspect is about: that of all structures, or of one."""
    return loaded if aspect in (SHAPES, POSES) else aspect_of(loaded, aspect)


def project_of_aspect(project: ProjectFolder, aspect: str) -> ProjectFolder:
    """Return the project of that result."""
    name = aspect.removeprefix(_ONE)
    return project if name == aspect else project.structure(name)


def _reference(loaded: LoadedResult) -> str:
    return loaded.record.settings.optimize.align_by or next(iter(loaded.parts))


def _apart(result: Result, alone: Mapping[str, Result], reference: str, aspect: str) -> Result:
    """Return the shapes in their mean relative pose, or the mean shapes in each subject's, to first order.

    To first order, poses are linear in rotation vectors and translations, and the variance of particles is
    that of `RelativePoses.components`.
    """
    names = [part.name for part in result.parts]
    whole = [result.world[:, part.particles] for part in result.parts]
    first = names.index(reference)
    poses = relative_poses(whole, names, first)
    means = [form.mean(axis=0) for form in poses.forms]
    places = [
        fit_similarity(mean, block.mean(axis=0), scaling=False)
        for mean, block in zip(means, whole, strict=True)
    ]
    axes = rotation_of(places[first])
    world = []
    for index, (form, place) in enumerate(zip(poses.forms, places, strict=True)):
        if aspect == SHAPES:
            world.append(transform_points(place, form))
        else:
            points = transform_points(place, means[index])
            turns = np.radians(poses.rotations[:, index]) @ axes.T
            moves = (poses.translations[:, index] @ axes.T)[:, None]
            world.append(points + np.cross(turns[:, None], points - points.mean(axis=0)) + moves)
    placed, surfaces = np.concatenate(world, axis=1), []
    for part, name in zip(result.parts, names, strict=True):
        own = alone[name]
        rows = [own.names.index(subject) for subject in result.names]
        fit = fit_similarity(
            own.world[rows].mean(axis=0), placed[:, part.particles].mean(axis=0), scaling=True
        )
        surfaces.append(own.mean_surface.placed(fit))
    mean = joined(surfaces)
    parts = [
        Part(part.name, part.particles, slice(*ends))
        for part, ends in zip(result.parts, pairwise((0, *mean.ends)), strict=True)
    ]
    return replace(
        result,
        world=frozen(placed),
        mean_surface=mean,
        smoothing=np.concatenate([alone[name].smoothing for name in names]),
        parts=tuple(parts),
    )
