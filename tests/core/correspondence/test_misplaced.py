"""Particles on the wrong wall of one shape: told from shapes that differ, moved back, alike after a kill."""

from types import SimpleNamespace

import numpy as np
import pytest
from homolog.correspondence.exchanges import EnsembleRows, Exchanges
from scipy.spatial import cKDTree

from homolog.correspondence import InitialParticles, loop, optimize, recorder
from homolog.correspondence.entropy.terms import Term
from homolog.correspondence.misplaced import exchange, find_misplaced, find_swapped, snap_to_mesh
from homolog.errors import Cancelled
from homolog.settings import Method, OptimizeSettings

QUICK = OptimizeSettings(particles=64, anneal_iterations=20, settle_iterations=300)
ON = QUICK.model_copy(update={"anneal_iterations": 5, "split_iterations": 5, "regularization_start": 5e-4})
SHAPE = 2  # that a particle strays on


def turned(degrees):
    """Return unit normals (..., 3), turned so far from z."""
    angle = np.radians(degrees)
    return np.stack([np.sin(angle), np.zeros_like(angle), np.cos(angle)], axis=-1)


def strays_of(degrees):
    """Judge normals (M, N) turned so far from a mean of z."""
    return find_misplaced(turned(np.asarray(degrees, float)), np.tile([0.0, 0.0, 1.0], (len(degrees[0]), 1)))


@pytest.fixture(scope="module")
def discs(make_shape):
    """Return five flat ellipsoids that differ in one axis."""
    return [make_shape(f"disc {k}", (14.0, 12.0 + 0.5 * k, 3.0)) for k in range(5)]


@pytest.fixture(scope="module")
def spoiled(discs):
    """Return an optimized layout with the middle particle of a disc on its opposite wall, and which it is."""
    local = np.array(optimize(discs, QUICK).local)
    particle = int(np.argmin(np.linalg.norm(local[SHAPE, :, :2], axis=1)))
    local[SHAPE, particle, 2] *= -1.0
    return local, particle


def test_a_stray_is_told_from_shapes_that_agree():
    degrees = np.full((5, 30), 5.0)
    degrees[3, 7] = 80.0
    expected = np.zeros((5, 30), bool)
    expected[3, 7] = True
    np.testing.assert_array_equal(strays_of(degrees), expected)


def test_where_all_shapes_differ_nobody_strays():
    degrees = np.full((5, 30), 5.0)
    degrees[:, 7] = [60.0, 20.0, 25.0, 40.0, 0.0]
    assert not strays_of(degrees).any()


def test_two_shapes_cannot_tell_which_of_them_strays():
    degrees = np.full((2, 30), 5.0)
    degrees[1, 7] = 80.0
    assert not strays_of(degrees).any()


def test_a_shape_that_is_matched_differently_as_a_whole_is_left_alone():
    degrees = np.full((5, 30), 5.0)
    degrees[3, :10] = 80.0
    assert not strays_of(degrees).any()


def test_a_point_put_on_a_thin_wall_that_bends_stays_on_its_side(make_shape):
    mesh = make_shape("disc", (14.0, 12.0, 1.5)).mesh
    points = np.random.default_rng(0).normal(size=(400, 3)) * [8.0, 7.0, 1.0]
    normals = np.tile([0.0, 0.0, 1.0], (400, 1))
    nearest = cKDTree(mesh.vertices).query(snap_to_mesh(points, normals, mesh))[1]
    assert mesh.vertex_normals[nearest, 2].min() > 0.0


def test_a_particle_on_the_wrong_wall_is_put_right_and_the_run_says_so(discs, spoiled):
    local, particle = spoiled
    arguments = []
    result = optimize(
        discs, ON, initial=InitialParticles(local), tick=lambda _, message: arguments.append(message)
    )
    np.testing.assert_array_equal(np.argwhere(result.repaired > 0), [[SHAPE, particle]])
    assert np.einsum("nd,nd->n", result.normals[SHAPE], result.normals[0]).min() > 0.9
    assert arguments[-1] == "optimizing: 64 particles, 1 repaired on 1 shape"


def test_a_particle_that_has_left_its_surface_is_put_back_and_the_run_goes_on(discs, spoiled):
    local, particle = spoiled
    local = local.copy()
    local[SHAPE, particle] = (80.0, 0.0, 0.0)
    result = optimize(discs, ON, initial=InitialParticles(local))
    assert result.repaired[SHAPE, particle] > 0
    on_surface = cKDTree(discs[SHAPE].mesh.vertices).query(result.local[SHAPE])[0]
    assert on_surface.max() < discs[SHAPE].mesh.mean_edge
    assert np.isfinite(result.energies).all()


def test_two_particles_in_each_others_place_are_exchanged_and_nobody_else(discs):
    local = np.array(optimize(discs, QUICK).local)
    middle = int(np.argmin(np.linalg.norm(local[SHAPE, :, :2], axis=1) - local[SHAPE, :, 2]))
    gaps = np.linalg.norm(local[SHAPE] - local[SHAPE, middle], axis=1)
    other = int(np.argsort(gaps)[1])
    world = local.copy()
    world[SHAPE, [middle, other]] = local[SHAPE, [other, middle]]
    normals = np.array([0.0, 0.0, 1.0]) * np.sign(local[0, :, 2:])
    nobody = np.tile(np.arange(64), (5, 1))
    np.testing.assert_array_equal(find_swapped(local, normals), nobody)
    expected = nobody.copy()
    expected[SHAPE, [middle, other]] = other, middle
    np.testing.assert_array_equal(find_swapped(world, normals), expected)


def test_a_run_ends_with_exchanges_that_lower_its_objective(discs, monkeypatch):
    exchanged = np.zeros((5, 64), dtype=bool)
    exchanged[SHAPE, [20, 52]] = True
    given = []

    def exchange(engine, weights, allowed):
        given.append((engine.count, weights.ensemble.regularization, allowed.all()))
        return exchanged

    monkeypatch.setattr("homolog.correspondence.loop.exchange", exchange)
    result = optimize(discs, ON.model_copy(update={"settle_iterations": 5}))
    assert given == [(64, ON.regularization_end, True)]
    assert (result.repaired > 0)[exchanged].all()


def test_an_exchange_puts_two_particles_in_each_others_place():
    k = np.arange(64) + 0.5
    polar, azimuth = np.arccos(1 - k / 32), np.pi * (1 + 5**0.5) * k
    normals = np.stack(
        [np.cos(azimuth) * np.sin(polar), np.sin(azimuth) * np.sin(polar), np.cos(polar)], axis=1
    )
    sizes = 10.0 + 0.1 * np.arange(5)
    spoiled = np.tile(np.arange(64), (5, 1))
    spoiled[SHAPE, [8, 3]] = 3, 8
    put = []
    engine = SimpleNamespace(
        aligned_positions=lambda: sizes[:, None, None] * normals[spoiled],
        host_positions=lambda: sizes[:, None, None] * normals[spoiled],
        aligned_normals=lambda: normals[spoiled],
        host_means=lambda: normals,
        host_openings=lambda: np.zeros((5, 64)),
        set_positions=put.append,
        launch=SimpleNamespace(device="cpu", poll_cancel=lambda: None),
    )
    weights = SimpleNamespace(ensemble=Term(0.02, 5e-4), normals=Term(0.15, 0.01))
    moved = exchange(engine, weights, np.ones((5, 1), dtype=bool))
    np.testing.assert_array_equal(np.argwhere(moved), [[SHAPE, 3], [SHAPE, 8]])
    np.testing.assert_allclose(put[0], sizes[:, None, None] * normals)


def test_the_objective_is_lower_after_a_repair(discs, spoiled):
    result = optimize(discs, ON, initial=InitialParticles(spoiled[0]))
    objective = result.energies[:, 1:].sum(axis=1)
    before = objective[result.energies[:, 0] <= result.repaired.max()]
    assert objective[-1] < before.min() - 0.05


def test_held_particles_are_not_put_right(discs, spoiled):
    local, particle = spoiled
    movable = np.ones(local.shape[:2], bool)
    movable[SHAPE, particle] = False
    result = optimize(discs, ON, initial=InitialParticles(local, movable))
    np.testing.assert_array_equal(result.local[SHAPE, particle], local[SHAPE, particle])


def test_without_normals_in_the_objective_nothing_is_repaired(discs, spoiled):
    settings = ON.model_copy(update={"method": Method.GEODESIC})
    assert not optimize(discs, settings, initial=InitialParticles(spoiled[0])).repaired.any()


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


def test_a_run_cancelled_while_particles_are_exchanged_resumes_to_the_same_result(discs, monkeypatch):
    kept = []

    def cancelled(*_):
        raise Cancelled

    whole = optimize(discs, ON)
    with monkeypatch.context() as patched:
        patched.setattr(loop, "exchange", cancelled)
        with pytest.raises(Cancelled):
            optimize(discs, ON, checkpoint=kept.append)
    resumed = optimize(discs, ON, resume=kept[-1])
    assert resumed.iterations == whole.iterations
    np.testing.assert_array_equal(resumed.local, whole.local)


def test_exchanges_can_be_cancelled_between_shapes():
    def cancelled():
        raise Cancelled

    random = np.random.default_rng(1)
    normals = random.normal(size=(4, 20, 3))
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    rows = EnsembleRows(normals, normals, normals[0], np.zeros((4, 20)), (Term(1.0, 0.1), Term(1.0, 0.1)))
    with pytest.raises(Cancelled):
        Exchanges(rows).make_all(np.ones((4, 20), dtype=bool), cancelled)
