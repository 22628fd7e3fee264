"""Cohorts of particles with a known structure."""

import numpy as np
import pytest


@pytest.fixture
def ellipsoids():
    """Return a maker of ellipsoids [mm] whose first axis varies, with noise."""

    def make(subjects=20, particles=40, noise=0.05, seed=0):
        generator = np.random.default_rng(seed)
        directions = generator.normal(size=(particles, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        axes = np.array([30.0, 20.0, 15.0]) + generator.normal(size=(subjects, 1)) * [3.0, 0.0, 0.0]
        return directions * axes[:, None, :] + noise * generator.normal(size=(subjects, particles, 3))

    return make
