"""A quick second run with another seed: how far the particles of a model depend on chance."""

import numpy as np

from homolog.correspondence import optimize
from homolog.correspondence.schedule import TimeShares, plan_stages
from homolog.geometry import transform_points
from homolog.inspection.verdict import Agreement, agreement
from homolog.progress import Tick
from homolog.run.result import OptimizationOutcome
from homolog.settings import OptimizeSettings

__all__ = ["agreement_of_seeds", "cost_of_seeds"]

QUICK = 128
"""Particles of the second run. A model of no more would itself be the quick one."""
SUBJECTS = 8
"""Most subjects of it, so that it takes seconds for a cohort of any size."""
_FEWEST = 3


def cost_of_seeds(settings: OptimizeSettings, shapes: int, threads: int) -> float:
    """Return the expected time of the second run relative to that of the first, 0 if there is none."""
    if settings.particles <= QUICK or shapes < _FEWEST or settings.core_set is not None:
        return 0.0

    def cost(particles: int, shapes: int) -> float:
        stages = plan_stages(settings.model_copy(update={"particles": particles}), None, shapes)
        geodesic = settings.method.uses_geodesics
        return shapes * TimeShares(stages, geodesic=geodesic, registers=True, threads=threads).cost

    return cost(QUICK, min(SUBJECTS, shapes)) / cost(settings.particles, shapes)


def agreement_of_seeds(outcome: OptimizationOutcome, device: str, tick: Tick) -> Agreement | None:
    """Return how far another seed places particles from where a model carries them; None for small models.

    Parameters
    ----------
    outcome : OptimizationOutcome
        Of all subjects.
    device : str
        Warp's device alias.
    tick : Tick
        Progress and cancellation.
    """
    shapes, count = outcome.inputs.shapes, outcome.local.shape[1]
    if count <= QUICK or len(shapes) < _FEWEST:
        return None
    chosen = np.unique(np.linspace(0, len(shapes) - 1, min(SUBJECTS, len(shapes))).astype(np.int64))
    settings = outcome.inputs.settings.placing
    update = {"particles": QUICK, "seed": settings.seed + 1, "core_set": None, "landmarks": False}
    again = optimize(
        [shapes[index] for index in chosen.tolist()],
        settings.model_copy(update=update),
        device=device,
        tick=lambda fraction, _: tick(fraction, "placing particles again with another seed"),
    )
    placed = transform_points(outcome.alignments[chosen], again.local)
    return agreement(outcome.world[chosen], placed)
