"""A quick second run with another seed: how far the particles of a model depend on chance."""

import numpy as np

from homolog.correspondence import optimize
from homolog.geometry import transform_points
from homolog.inspection.verdict import Agreement, agreement
from homolog.progress import Tick
from homolog.run.result import OptimizationOutcome

__all__ = ["agreement_of_seeds"]

QUICK = 128
"""Particles of the second run. A model of no more would itself be the quick one."""
SUBJECTS = 8
"""Most subjects of it, so that it takes seconds for a cohort of any size."""


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
    if count <= QUICK or len(shapes) < 3:
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
