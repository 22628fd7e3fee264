"""Particles and the entropies that place them (the paper's Eq. 1-6)."""

from homolog.correspondence.joint import StructureShapes, alignments_of_wholes
from homolog.correspondence.launcher import load_kernels
from homolog.correspondence.optimizer import optimize, optimize_jointly
from homolog.correspondence.refit import initialize_fit, repair
from homolog.correspondence.types import (
    Checkpoint,
    Frame,
    FrameCallback,
    InitialParticles,
    OptimizedParticles,
    Reason,
    Shape,
    Stage,
)

__all__ = [
    "Checkpoint",
    "Frame",
    "FrameCallback",
    "InitialParticles",
    "OptimizedParticles",
    "Reason",
    "Shape",
    "Stage",
    "StructureShapes",
    "alignments_of_wholes",
    "initialize_fit",
    "load_kernels",
    "optimize",
    "optimize_jointly",
    "repair",
]
