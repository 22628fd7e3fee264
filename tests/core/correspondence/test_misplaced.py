"""Particles that have left their surface: put back, alike after a kill."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from homolog.correspondence import InitialParticles, optimize, recorder
from homolog.correspondence.misplaced import snap_to_mesh
from homolog.errors import Cancelled
from homolog.settings import OptimizeSettings

QUICK = OptimizeSettings(particles=64, anneal_iterations=20, settle_iterations=300)
ON = QUICK.model_copy(update={"anneal_iterations": 5, "split_iterations": 5, "regularization_start": 5e-4})
SHAPE = 2  # that a particle has left


@pytest.fixture(scope="module")
def discs(make_shape):
    """Return five flat ellipsoids that differ in one axis."""
    return [make_shape(f"disc {k}", (14.0, 12.0 + 0.5 * k, 3.0)) for k in range(5)]


@pytest.fixture(scope="module")
def spoiled(discs):
    """Return an optimized layout with the middle particle of a disc far from it, and which it is."""
    local = np.array(optimize(discs, QUICK).local)
    particle = int(np.argmin(np.linalg.norm(local[SHAPE, :, :2], axis=1)))
    local[SHAPE, particle] = (80.0, 0.0, 0.0)
    return local, particle


def test_a_point_put_on_a_thin_wall_that_bends_stays_on_its_side(make_shape):
    mesh = make_shape("disc", (14.0, 12.0, 1.5)).mesh
    points = np.random.default_rng(0).normal(size=(400, 3)) * [8.0, 7.0, 1.0]
    normals = np.tile([0.0, 0.0, 1.0], (400, 1))
    nearest = cKDTree(mesh.vertices).query(snap_to_mesh(points, normals, mesh))[1]
    assert mesh.vertex_normals[nearest, 2].min() > 0.0


def test_a_particle_that_has_left_its_surface_is_put_back_and_the_run_goes_on(discs, spoiled):
    local, particle = spoiled
    result = optimize(discs, ON, initial=InitialParticles(local))
    assert result.repaired[SHAPE, particle] > 0
    on_surface = cKDTree(discs[SHAPE].mesh.vertices).query(result.local[SHAPE])[0]
    assert on_surface.max() < discs[SHAPE].mesh.mean_edge
    assert np.isfinite(result.energies).all()


def test_a_run_resumed_before_or_after_a_repair_ends_bit_identical(discs, spoiled, monkeypatch):
    monkeypatch.setattr(recorder, "CHECKPOINT_INTERVAL_S", 0.0)
    kept = []
    whole = optimize(discs, ON, initial=InitialParticles(spoiled[0]), checkpoint=kept.append)
    first = [item.repaired.any() for item in kept].index(True)
    for checkpoint in (kept[first - 1], kept[first], kept[-1]):
        rest = optimize(discs, ON, initial=InitialParticles(spoiled[0]), resume=checkpoint)
        np.testing.assert_array_equal(rest.local, whole.local)
        np.testing.assert_array_equal(rest.repaired, whole.repaired)
        np.testing.assert_array_equal(rest.energies, whole.energies)


def test_a_run_cancelled_in_the_middle_of_a_repair_ends_bit_identical(discs, spoiled, monkeypatch):
    whole = optimize(discs, ON, initial=InitialParticles(spoiled[0]))

    def cancelled(*_):
        raise Cancelled

    kept = []
    monkeypatch.setattr("homolog.correspondence.misplaced.snap_to_mesh", cancelled)
    with pytest.raises(Cancelled):
        optimize(discs, ON, initial=InitialParticles(spoiled[0]), checkpoint=kept.append)
    monkeypatch.undo()
    assert not kept[-1].repaired.any()
    rest = optimize(discs, ON, initial=InitialParticles(spoiled[0]), resume=kept[-1])
    np.testing.assert_array_equal(rest.local, whole.local)
    np.testing.assert_array_equal(rest.energies, whole.energies)
