"""Passes over all shapes that refine a model grown from a core set: the stages of a joint optimization.

The objective hardly depends on the variance along the modes, so that it depends on the start where an
optimization ends. Like a joint optimization, the passes begin near the mean shape, where variance is least.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from homolog.correspondence.entropy.terms import TermSchedule
from homolog.correspondence.schedule import StagePlan, plan_stages
from homolog.settings import OptimizeSettings

__all__ = ["EXTRAPOLATION", "Passes", "plan_passes"]

EXTRAPOLATION = 0.7
"""Fraction of the last pass's motion that is added to the positions and normals of which an ensemble is made.
The other shapes of an ensemble do not move with a shape, so that without it the mean would lag behind."""
_TO_MEAN, _SPREADING, _ANNEALING = 3, 8, 10
"""Numbers of passes of the joint optimization's stages: distance to the mean, few particles, annealing."""


@dataclass(frozen=True, slots=True)
class Passes:
    """The passes over all shapes.

    Attributes
    ----------
    first : tuple of StagePlan
        Those with changing regularization, one a pass.
    settling : StagePlan
        Every later one.
    """

    first: tuple[StagePlan, ...]
    settling: StagePlan


def plan_passes(settings: OptimizeSettings) -> Passes:
    """Return the passes over the shapes of a run with a core set."""
    to_mean, spreading, *_, annealing, settling = plan_stages(settings)
    begin, end = spreading.ensemble.end, settling.ensemble.end
    annealing = replace(
        annealing,
        iterations=settings.anneal_iterations,
        ensemble=TermSchedule(annealing.ensemble.weight, max(begin, end), end),
        normals=replace(spreading.normals, start=spreading.normals.end, end=settling.normals.end),
    )
    plans = zip((to_mean, spreading, annealing), (_TO_MEAN, _SPREADING, _ANNEALING), strict=True)
    parts = [part for plan, number in plans for part in _parts(plan, number)]
    together = [*parts, replace(settling, iterations=parts[-1].iterations)]
    *first, last = (replace(plan, count=settings.particles) for plan in together)
    return Passes(tuple(first), last)


def _parts(plan: StagePlan, number: int) -> Sequence[StagePlan]:
    """Return a stage in parts."""
    shares = [(index / number, (index + 1) / number) for index in range(number)]
    return [
        replace(
            plan,
            iterations=-(-plan.iterations // number),
            ensemble=plan.ensemble.part(*share),
            normals=plan.normals.part(*share),
        )
        for share in shares
    ]
