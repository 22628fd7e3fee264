"""The stages of an optimization: numbers of particles, weights and regularization."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from homolog.correspondence.entropy.terms import Term, TermSchedule
from homolog.correspondence.types import Stage
from homolog.settings import Method, OptimizeSettings
from homolog.threads import MOST_THREADS

__all__ = ["StagePlan", "TimeShares", "Weights", "joint_counts", "particle_counts", "plan_stages"]

STEP_FRACTION = 0.5  # tau over the squared Parzen width
STEP_DECAY_ITERATIONS = 400  # over which tau decays to e^-3 in the last stage
SETTLING = 520.0  # times sqrt(shapes / particles): iterations until the last stage converges, mostly
FEWEST_SETTLING, MOST_SETTLING = 80, 500  # expected
TYPICAL_SHAPES = 30
ITERATION_COST = 100.0  # of what an iteration does once per shape [updates of a particle], for estimates
TABLES_COST = 0.52e5  # of the geodesic tables of one level of detail [the same]
REGISTRATION_COST = 0.65e5  # of the first particles
MIN_FINE_PARTICLES = 300  # from which the fine meshes are used; the coarse ones have 1500 vertices
MAX_INITIAL_PARTICLES = 256  # initialized by registration; the others come from splitting
FEWEST_OF_STRUCTURE = 64  # initial ones of one structure of several
MEAN_WEIGHT = 0.02  # of the squared distance to the mean shape in the first stage [1 / squared length]
MEAN_REGULARIZATION = 1.0e4  # under which H(Z) is the squared distance to the mean shape
NORMALS_ANNEALING = (0.3, 0.01)  # regularization of H(V) [rad²]
COARSE_ANNEALING = 2.0 / 3.0  # of the annealing, done before the first split, while iterations are cheap


@dataclass(frozen=True, slots=True)
class Weights:
    """The objective and the step of one iteration; the weight of H(P) is 1.

    Attributes
    ----------
    ensemble, normals : Term
        H(Z) and H(V).
    step : float
        tau over the squared Parzen width.
    coherence : float
        Of the particles with their neighbours (`entropy.coherence`).
    """

    ensemble: Term
    normals: Term
    step: float
    coherence: float = 0.0


@dataclass(frozen=True, slots=True)
class StagePlan:
    """A stage: iterations with a constant number of particles.

    Attributes
    ----------
    stage : Stage
        Splitting, or optimizing with all particles.
    count : int
        Particles on each shape.
    iterations : int
        Largest number of iterations.
    ensemble, normals : TermSchedule
        H(Z) and H(V).
    coherence : float
        Of the particles with their neighbours.
    until_converged : bool
        Whether the stage ends at convergence. Its steps decay, to damp the jitter of simultaneous moves.
    expected_settling : int
        Iterations until convergence, for estimates of the remaining time.
    """

    stage: Stage
    count: int
    iterations: int
    ensemble: TermSchedule
    normals: TermSchedule
    coherence: float
    until_converged: bool = False
    expected_settling: int = MOST_SETTLING

    @property
    def factors(self) -> tuple[float, float, float]:
        """Weights of H(P), H(Z) and H(V) in the objective."""
        return 1.0, self.ensemble.weight, self.normals.weight

    @property
    def expected_iterations(self) -> int:
        """Iterations for estimates of the remaining time."""
        return min(self.iterations, self.expected_settling) if self.until_converged else self.iterations

    def weights(self, iteration: int) -> Weights:
        """Return the weights of one of the stage's iterations."""
        done = iteration / self.iterations
        return Weights(
            self.ensemble.at(done),
            self.normals.at(done),
            step=STEP_FRACTION * math.exp(-3.0 * min(1.0, iteration / STEP_DECAY_ITERATIONS))
            if self.until_converged
            else STEP_FRACTION,
            coherence=self.coherence,
        )


def particle_counts(particles: int, fewest: int = MAX_INITIAL_PARTICLES) -> list[int]:
    """Return the numbers of particles: halved, rounded up, down to at most `fewest`; ascending."""
    counts = [particles]
    while counts[-1] > fewest:
        counts.append((counts[-1] + 1) // 2)
    return counts[::-1]


def joint_counts(particles: Sequence[int], present: Sequence[int | None]) -> list[list[int]]:
    """Return the numbers of particles of several structures, from `present` ones where given, level by level.

    Each structure begins with its share of the initial particles, so that all cost what one structure with as
    many particles does. Those that reach theirs in fewer levels are split in the last ones only.
    """
    share = MAX_INITIAL_PARTICLES / sum(particles)
    counts = [
        particle_counts(count, known or max(round(share * count), FEWEST_OF_STRUCTURE))
        for count, known in zip(particles, present, strict=True)
    ]
    levels = max(map(len, counts))
    return [own[:1] * (levels - len(own)) + own for own in counts]


def plan_stages(
    settings: OptimizeSettings,
    present: int | None = None,
    shapes: int = TYPICAL_SHAPES,
    counts: Sequence[int] | None = None,
) -> list[StagePlan]:
    """Return the stages of an optimization, from the initial particles, or `present` ones, to all.

    The number of shapes serves estimates of the remaining time only. A weight of H(Z) that is still to be
    derived counts as one. The numbers of particles are `counts` if given, as of `joint_counts`.
    """
    counts = counts or particle_counts(settings.particles, present or MAX_INITIAL_PARTICLES)
    ensemble_weight = 1.0 if settings.ensemble_weight is None else settings.ensemble_weight
    normals_weight = settings.normals_weight if settings.method.uses_normals else 0.0
    coherence = settings.coherence if settings.method is not Method.EUCLIDEAN else 0.0  # as published
    first, last = settings.regularization_start, settings.regularization_end
    split = settings.split_iterations

    def annealing(count: int, begin: float, end: float, iterations: int | None = None) -> StagePlan:
        """Return a stage from one share of the annealing to another."""
        if iterations is None:
            iterations = round((end - begin) * settings.anneal_iterations)
        ensemble = TermSchedule(ensemble_weight, first, last).part(begin, end)
        normals = TermSchedule(normals_weight, *NORMALS_ANNEALING).part(begin, end)
        return StagePlan(Stage.OPTIMIZING, count, iterations, ensemble, normals, coherence)

    def splitting(count: int) -> StagePlan:
        terms = TermSchedule(ensemble_weight, 10.0, 0.2), TermSchedule(normals_weight, 0.3, 0.03)
        return StagePlan(Stage.SPLITTING, count, split, *terms, coherence)

    annealed = 0.0
    if present is None:
        to_mean = TermSchedule(MEAN_WEIGHT * MEAN_REGULARIZATION, MEAN_REGULARIZATION, MEAN_REGULARIZATION)
        constant = TermSchedule(normals_weight, 0.3, 0.3)
        stages = [StagePlan(Stage.SPLITTING, counts[0], split, to_mean, constant, coherence)]
        stages.append(splitting(counts[0]))
        if len(counts) > 1:
            annealed = COARSE_ANNEALING
            stages.append(annealing(counts[0], 0.0, annealed))
            stages += [annealing(count, annealed, annealed, split) for count in counts[1:-1]]
    else:
        stages = [splitting(count) for count in counts[1:]]
    stages.append(annealing(settings.particles, annealed, 1.0))
    end = NORMALS_ANNEALING[1]
    settling = TermSchedule(ensemble_weight, last, last), TermSchedule(normals_weight, end, end)
    iterations = settings.settle_iterations
    expected = round(SETTLING * math.sqrt(shapes / settings.particles))
    expected = min(MOST_SETTLING, max(FEWEST_SETTLING, expected))
    stages.append(
        StagePlan(
            Stage.OPTIMIZING,
            settings.particles,
            iterations,
            *settling,
            coherence,
            until_converged=True,
            expected_settling=expected,
        )
    )
    return stages


class TimeShares:
    """Shares of the parts of an optimization in its time, for estimates of the remaining time.

    Parameters
    ----------
    stages : sequence of StagePlan
    geodesic : bool
        Whether geodesic tables are computed.
    registers : bool
        Whether the first particles are placed by registration.
    threads : int
        Threads of the host that move particles. Costs were calibrated with two. With more, what a thread does
        alone has a larger share.

    Attributes
    ----------
    preparation : float
        Share of the first preparation in the whole.
    first_particles : float
        Share of the first particles in the rest.
    cost : float
        Of the whole, for each shape [updates of a particle].
    """

    def __init__(self, stages: Sequence[StagePlan], *, geodesic: bool, registers: bool, threads: int) -> None:
        more = max(0, min(threads, MOST_THREADS) - 2)
        tables = TABLES_COST * (1.0 if geodesic else 0.1) * (1.0 + 0.1 * more)
        first = REGISTRATION_COST * (1.0 + 0.33 * more) if registers else 0.0
        overhead = ITERATION_COST * (1.0 + 0.33 * more)
        fine = [plan.count >= MIN_FINE_PARTICLES for plan in stages]
        changes = [now is not before for before, now in pairwise(fine)]
        self._tables = [0.0, *(tables if change else 0.0 for change in changes)]  # the first are there before
        self._costs = [plan.expected_iterations * (plan.count + overhead) for plan in stages]
        self._sum = sum(self._tables) + sum(self._costs)
        self.cost = tables + first + self._sum
        self.preparation = tables / self.cost
        self.first_particles = first / (first + self._sum)

    def done(self, index: int, share: float = 0.0) -> float:
        """Return the fraction of all stages when a share of a stage is done, and its tables are made."""
        return self.before(index) + (self._tables[index] + self._costs[index] * min(1.0, share)) / self._sum

    def before(self, index: int) -> float:
        """Return the fraction of all stages before the tables of a stage are made."""
        return (sum(self._tables[:index]) + sum(self._costs[:index])) / self._sum
