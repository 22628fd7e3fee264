"""What of a model of several structures is looked at: all, one, shapes without pose, or pose alone."""

from dataclasses import replace

from homolog.comparison.pose import apart
from homolog.errors import InputError
from homolog.io.project import ProjectFolder
from homolog_app.scenes.loaded_result import LoadedResult

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
        result = apart(loaded.result, results, _reference(loaded), poses=aspect == POSES)
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
