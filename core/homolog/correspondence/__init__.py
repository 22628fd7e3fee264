"""Particles and the entropies that place them (the paper's Eq. 1-6)."""

from homolog.correspondence.launcher import load_kernels
from homolog.correspondence.optimizer import optimize
from homolog.correspondence.poses import best_similarity, inverted, transformed
from homolog.correspondence.repair import fitting_start, repair
from homolog.correspondence.types import (
    Checkpoint,
    Frame,
    Observe,
    OptimizedParticles,
    Reason,
    Shape,
    Stage,
    Start,
)

__all__ = [
    "Checkpoint",
    "Frame",
    "Observe",
    "OptimizedParticles",
    "Reason",
    "Shape",
    "Stage",
    "Start",
    "best_similarity",
    "fitting_start",
    "inverted",
    "load_kernels",
    "optimize",
    "repair",
    "transformed",
]
