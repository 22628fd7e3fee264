"""Inputs and results of the optimization."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from homolog.arrays import BoolArray, Float32Array, FloatArray, IntArray, frozen
from homolog.memory import Store
from homolog.surfaces.distance_field import DistanceField
from homolog.surfaces.mesh import TriangleMesh

__all__ = [
    "Checkpoint",
    "Frame",
    "FrameCallback",
    "InitialParticles",
    "OptimizedParticles",
    "Reason",
    "Shape",
    "Stage",
]


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """One subject's surface, as the optimizer needs it.

    Attributes
    ----------
    name : str
        The subject's name, for messages.
    field : DistanceField or None
        Implicit surface in local coordinates; None for an open one, whose particles lie on the mesh.
    mesh, coarse_mesh : TriangleMesh
        Surfaces in local coordinates, of the same topology; the coarse one is for alignment and for
        the first splits, when particles are few.
    alignment : (4, 4) float64 array
        Similarity from local to world coordinates.
    landmarks : (L, 3) float64 array or None
        Corresponding points in local coordinates [mm], on which the first particles are placed.
    """

    name: str
    field: DistanceField | None
    mesh: TriangleMesh
    coarse_mesh: TriangleMesh
    alignment: FloatArray
    landmarks: FloatArray | None = None

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        object.__setattr__(self, "alignment", frozen(self.alignment, np.float64))
        if self.landmarks is not None:
            object.__setattr__(self, "landmarks", frozen(self.landmarks, np.float64))

    def stored(self, store: Store) -> "Shape":
        """Return the shape with field and surfaces in a store."""
        return replace(
            self,
            field=self.field and self.field.stored(store),
            mesh=self.mesh.stored(store),
            coarse_mesh=self.coarse_mesh.stored(store),
        )


@dataclass(frozen=True, slots=True, eq=False)
class InitialParticles:
    """Particles to start from, in place of initialization by registration.

    Attributes
    ----------
    local : (M, n, 3) float64 array
        In file coordinates [mm], on the surfaces or near them.
    free : (M, n) bool array, optional
        Particles that may move; all by default. The others stay bit-identical, and interact with the free
        ones.
    """

    local: FloatArray
    free: BoolArray | None = None

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        object.__setattr__(self, "local", frozen(self.local, np.float64))
        if self.free is not None:
            object.__setattr__(self, "free", frozen(self.free, np.bool_))


class Stage(StrEnum):
    """Part of an optimization."""

    SPLITTING = "splitting"
    OPTIMIZING = "optimizing"


class Reason(StrEnum):
    """Why an optimization ended."""

    CONVERGED = "converged"
    ITERATIONS = "iterations"
    REGISTRATION = "registration"


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """The particles at one moment.

    Attributes
    ----------
    stage : Stage
    iteration : int
        Counted over the whole optimization.
    world : (M, n, 3) float64 array
        Particles in world coordinates [mm].
    energies : (3,) float64 array
        Sampling, ensemble and normals part of the objective, per particle; nan before the first iteration.
    alignments : (M, 4, 4) float64 array
        Local to world, at this moment.
    ends_stage : bool
        Whether a stage in which the shapes were compared, or the first round of the registration that
        places the first particles, has just ended and others follow: a preliminary result.
    parts : tuple of Frame
        The structures of subjects with several, each aligned with its like; empty for a single one.
    """

    stage: Stage
    iteration: int
    world: FloatArray
    energies: FloatArray
    alignments: FloatArray
    ends_stage: bool = False
    parts: "tuple[Frame, ...]" = ()

    @property
    def counts(self) -> tuple[int, ...]:
        """Particles of each of several structures; empty for a single one."""
        return tuple(part.world.shape[1] for part in self.parts)


@dataclass(frozen=True, slots=True, eq=False)
class Checkpoint:
    """The state of an optimization; on the CPU a resumed run is bit-identical.

    Attributes
    ----------
    left : int
        Stages after the current one.
    done : int
        Completed iterations of the current stage.
    iteration : int
        Iterations in all.
    positions : (M, n, 3) float32 array
        In the optimizer's coordinates.
    widths : (M, n) float32 array
        Parzen widths.
    means : (n, 3) float32 array
        Mean normals.
    neighbours : (n, k) int32 array
        Of each particle on the mean shape; k is 0 before the first iteration.
    coefficients : (n, k) float32 array
        With which they predict its deviation from the mean.
    poses : (M, 4, 4) float64 array
        Alignment so far, in the optimizer's coordinates.
    faces : (M, n) int32 array
        Faces of the surface set's meshes that the particles are on.
    energies : (T, 4) float64 array
        As recorded so far.
    repaired : (M, n) int32 array
        The iteration at which a particle was relocated, 0 if never.
    tangential_weight : float
        Of tangential distances in steps of the poses while particles are few.
    parts : float
        Of the surface that varied independently when the particles were first placed.
    variance, left_out : float
        Of a subject, and of a left-out one, then (`Start`) [squared optimizer length].
    others : tuple of Checkpoint
        The further structures of subjects with several, whose first this is; empty for a single one.
    """

    left: int
    done: int
    iteration: int
    positions: Float32Array
    widths: Float32Array
    means: Float32Array
    neighbours: IntArray
    coefficients: Float32Array
    poses: FloatArray
    faces: IntArray
    energies: FloatArray
    repaired: IntArray
    tangential_weight: float
    parts: float
    variance: float
    left_out: float
    others: "tuple[Checkpoint, ...]" = ()


@dataclass(frozen=True, slots=True, eq=False)
class OptimizedParticles:
    """The result: N corresponding particles on M shapes.

    Attributes
    ----------
    world, local : (M, N, 3) float64 arrays
        Particles in aligned and in file coordinates [mm].
    normals : (M, N, 3) float64 array
        Outward unit normals in world coordinates.
    energies : (T, 4) float64 array
        Iteration and the three terms of the objective, per recorded iteration.
    alignments : (M, 4, 4) float64 array
        Local to world, at the end of the run.
    iterations : int
    reason : Reason
    repaired : (M, N) int32 array
        The iteration at which a misplaced particle was relocated, 0 if never.
    parts : tuple of OptimizedParticles
        The structures of subjects with several, each aligned with its like, of all subjects that have it;
        their particles one after another are those of the subjects that have all. Empty for a single one.
    """

    world: FloatArray
    local: FloatArray
    normals: FloatArray
    energies: FloatArray
    alignments: FloatArray
    iterations: int
    reason: Reason
    repaired: IntArray
    parts: "tuple[OptimizedParticles, ...]" = ()


FrameCallback = Callable[[Frame], None]
