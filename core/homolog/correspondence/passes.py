"""Passes over all shapes that refine a model grown from a core set.

In a pass, other shapes do not move with a shape, so that what is common to many of them changes slowly: the
mean, and the directions of the modes. Passes do not begin near the mean shape, as joint optimizations do,
because they would not recover the variance.
"""

from dataclasses import dataclass, replace

from homolog.correspondence.entropy.terms import TermSchedule
from homolog.correspondence.schedule import StagePlan, plan_stages
from homolog.settings import OptimizeSettings

__all__ = ["EXTRAPOLATION", "Passes", "plan_passes"]

EXTRAPOLATION = 0.7
"""Fraction of the last pass's motion that is added to the positions and normals of which an ensemble is made.
The other shapes of an ensemble do not move with a shape, so that without it the mean would lag behind."""
_ANNEALING = 10
"""Number of passes of the annealing."""


@dataclass(frozen=True, slots=True)
class Passes:
    """The passes over all shapes.

    Attributes
    ----------
    annealing : tuple of StagePlan
        Those with decreasing regularization, one a pass.
    settling : StagePlan
        Every later one.
    """

    annealing: tuple[StagePlan, ...]
    settling: StagePlan


def plan_passes(settings: OptimizeSettings) -> Passes:
    """Return the passes over the shapes of a run with a core set."""
    _, spreading, *_, annealing, settling = plan_stages(settings)
    begin, end = spreading.ensemble.end, settling.ensemble.end
    ensemble = TermSchedule(annealing.ensemble.weight, max(begin, end), end)
    normals = replace(spreading.normals, start=spreading.normals.end, end=settling.normals.end)
    iterations = -(-settings.anneal_iterations // _ANNEALING)
    shares = [(index / _ANNEALING, (index + 1) / _ANNEALING) for index in range(_ANNEALING)]
    return Passes(
        tuple(
            replace(
                annealing,
                count=settings.particles,
                iterations=iterations,
                ensemble=ensemble.part(*share),
                normals=normals.part(*share),
            )
            for share in shares
        ),
        replace(settling, count=settings.particles, iterations=iterations),
    )
