"""Particles and the entropies that place them (the paper's Eq. 1-6)."""

from homolog.correspondence.optimizer import optimize
from homolog.correspondence.types import (
    Checkpoint,
    Correspondence,
    Frame,
    Observe,
    Reason,
    Shape,
    Stage,
)

__all__ = ["Checkpoint", "Correspondence", "Frame", "Observe", "Reason", "Shape", "Stage", "optimize"]
