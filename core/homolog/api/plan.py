"""Planning of a study from a pilot."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from os import PathLike
from typing import Literal

from homolog.api.project import Project
from homolog.comparison.plan import Plan, plan_project
from homolog.comparison.question import alignment_of
from homolog.errors import path_of
from homolog.io.project import ProjectFolder
from homolog.progress import tick_of

__all__ = ["plan"]


def plan(
    project: Project | str | PathLike[str],
    effect: float,
    *,
    width: float | None = None,
    particle: int | None = None,
    group: str = "group",
    between: Sequence[str] = (),
    per_group: Sequence[int] = (8, 12, 20, 30, 50, 80),
    power: float = 0.8,
    alignment: Literal["form", "shape", "as-it-lies"] = "shape",
    studies: int = 100,
    permutations: int = 199,
    random_state: int = 0,
    callback: Callable[[float, str], object] | None = None,
) -> Plan:
    """Return the power of studies with an effect of given size and place, from a pilot, as ``homolog plan``.

    Parameters
    ----------
    project : Project or path
        The pilot: a project with a result, or its folder.
    effect : float
        Height of the effect [mm]: a smooth bump in one of two groups, outward if positive.
    width : float, optional
        Its full width at half maximum [mm]; by default four spacings of the particles.
    particle : int, optional
        Its place; by default the particle whose variation along the normal is the median.
    group : str
        Column of the pilot's groups, whose means are removed.
    between : sequence of str
        Groups of the pilot; all by default.
    per_group : sequence of int
        Numbers per group for which studies are simulated.
    power : float
        Wanted power.
    alignment : {"shape", "form", "as-it-lies"}
        What is compared, as in `compare_groups`.
    studies : int
        Simulated studies of each number.
    permutations : int
        Randomizations in each of them.
    random_state : int
        Random seed; the same seed gives the same plan.
    callback : callable, optional
        Called with the fraction done and a message; any exception that it raises ends the work.

    Returns
    -------
    Plan
        Power and numbers needed, and the stability of modes, map and p.

    Raises
    ------
    InputError
        If the project has no result, the pilot is too small, or a value is invalid.
    """
    folder = project.folder if isinstance(project, Project) else path_of(project, "project")
    return plan_project(
        ProjectFolder(folder),
        effect,
        width=width,
        column=group,
        between=between,
        particle=particle,
        per_group=tuple(per_group),
        power=power,
        alignment=alignment_of(alignment),
        studies=studies,
        permutations=permutations,
        seed=random_state,
        tick=tick_of(callback),
    )
