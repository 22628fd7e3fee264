"""Particles and the entropies that place them (the paper's Eq. 1-6)."""
