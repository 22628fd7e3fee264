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


@pytest.fixture
def correlated():
    """Return a maker of shapes with a few strong modes and noise, and no effect of anything."""

    def make(subjects=24, particles=30, seed=0):
        generator = np.random.default_rng(seed)
        scores = generator.normal(size=(subjects, 4)) * [4.0, 3.0, 2.5, 2.0]
        shapes = np.tensordot(scores, generator.normal(size=(4, particles, 3)), axes=1)
        return shapes + 0.3 * generator.normal(size=shapes.shape)

    return make


@pytest.fixture
def covariates():
    """Return a maker of two covariates, age and sex, that have nothing to do with each other."""

    def make(subjects=24, seed=0):
        generator = np.random.default_rng(seed + 100)
        age = generator.normal(60.0, 10.0, subjects)
        sex = np.resize(["f", "m", "m"], subjects).tolist()
        return {"age": age.tolist(), "sex": sex}

    return make


@pytest.fixture
def sphere(unit_sphere):
    """Vertices and outward faces of a unit sphere."""
    return unit_sphere(800)
