"""How many particles when, and what the weights are on the way."""

import math
from dataclasses import dataclass

from homolog.correspondence.types import Stage
from homolog.settings import OptimizeSettings

__all__ = ["Plan", "Weights", "particle_counts", "plan_stages"]

STEP = 0.5  # tau, of the squared Parzen width
SHRINK = 400  # iterations over which it shrinks to e^-3 when all is annealed
FIRST = 256  # at most so many particles are placed by registration; the others come by splitting
MEAN_PULL = 0.02  # strength of that pull, per squared optimizer length
HUGE = 1.0e4  # a regularisation under which H(Z) is the squared distance to the mean shape


@dataclass(frozen=True, slots=True)
class Weights:
    """What the schedule sets for one iteration (lengths in the optimizer's unit).

    Attributes
    ----------
    ensemble, normals : float
        Weights of H(Z) and H(V).
    regularization : float
        Of the ensemble's dual, a squared length.
    normals_regularization : float
        Of the normals' dual [rad²].
    step : float
        tau over the squared Parzen width.
    """

    ensemble: float
    normals: float
    regularization: float
    normals_regularization: float
    step: float


@dataclass(frozen=True, slots=True)
class Plan:
    """Iterations with one number of particles.

    Attributes
    ----------
    stage : Stage
        Splitting, or optimizing with all particles.
    count : int
        Particles on each shape.
    iterations : int
        At most so many.
    weight, normals_weight : float
        Of the ensemble and of the normals.
    ensemble, normals : tuple of 2 float
        Regularisation at the start and at the end, between them geometric: the ensemble's in squared
        optimizer lengths, the normals' in rad².
    until_converged : bool
        Whether the stage may end early; its steps shrink meanwhile, as simultaneous moves leave a jitter.
    """

    stage: Stage
    count: int
    iterations: int
    weight: float
    normals_weight: float
    ensemble: tuple[float, float]
    normals: tuple[float, float]
    until_converged: bool = False

    @property
    def usual(self) -> int:
        """Iterations to reckon with."""
        return min(self.iterations, SHRINK) if self.until_converged else self.iterations

    def weights(self, iteration: int) -> Weights:
        """Return the weights of one of the stage's iterations."""
        done = iteration / self.iterations
        return Weights(
            ensemble=self.weight,
            normals=self.normals_weight,
            regularization=self.ensemble[0] * (self.ensemble[1] / self.ensemble[0]) ** done,
            normals_regularization=self.normals[0] * (self.normals[1] / self.normals[0]) ** done,
            step=STEP * math.exp(-3.0 * min(1.0, iteration / SHRINK)) if self.until_converged else STEP,
        )


def particle_counts(particles: int, fewest: int = FIRST) -> list[int]:
    """Return the numbers of particles: halved, rounded up, down to at most `fewest`; ascending."""
    counts = [particles]
    while counts[-1] > fewest:
        counts.append((counts[-1] + 1) // 2)
    return counts[::-1]


def plan_stages(settings: OptimizeSettings, present: int | None = None) -> list[Plan]:
    """Return the stages of an optimization, from the first particles, or those `present`, to all.

    Plans for the same number of particles end alike, wherever they begin.
    """
    normals = settings.normals_weight if settings.method.uses_normals else 0.0
    weight, split = settings.ensemble_weight, settings.split_iterations
    stages = []
    if present is None:
        counts = particle_counts(settings.particles)
        whole = (MEAN_PULL * HUGE, normals, (HUGE, HUGE), (0.3, 0.3))
        stages.append(Plan(Stage.SPLITTING, counts[0], split, *whole))
    else:
        counts = particle_counts(settings.particles, present)[1:]
    stages += [
        Plan(Stage.SPLITTING, count, split, weight, normals, (10.0, 0.2), (0.3, 0.03)) for count in counts
    ]
    begin, end = settings.regularization_start, settings.regularization_end
    rest = (settings.particles, settings.anneal_iterations, weight, normals)
    stages.append(Plan(Stage.OPTIMIZING, *rest, (begin, end), (0.3, 0.01)))
    rest = (settings.particles, settings.settle_iterations, weight, normals)
    stages.append(Plan(Stage.OPTIMIZING, *rest, (end, end), (0.01, 0.01), until_converged=True))
    return stages
