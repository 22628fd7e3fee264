"""Exchanges of two particles of one shape, and how far they lower the entropies across the shapes."""

import numpy as np
import pytest
import warp as wp
from scipy.spatial import cKDTree

from homolog.correspondence.entropy.dual import entropy
from homolog.correspondence.entropy.terms import Term
from homolog.correspondence.exchanges import LEAST_GAIN, EnsembleRows, Exchanges
from homolog.correspondence.kernels import exchanges as kernels
from homolog.registration.entropy import covariance

SHAPES, COUNT = 6, 60
TERMS = Term(0.02, 5e-4), Term(0.15, 0.01)


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def placed(order, values):
    return np.stack([value[own] for value, own in zip(values, order, strict=True)])


@pytest.fixture
def rows():
    """Return noisy particles on a sphere, each in its own place on every shape."""
    random = np.random.default_rng(0)
    k = np.arange(COUNT) + 0.5
    polar, azimuth = np.arccos(1 - 2 * k / COUNT), np.pi * (1 + 5**0.5) * k
    places = np.stack(
        [np.cos(azimuth) * np.sin(polar), np.sin(azimuth) * np.sin(polar), np.cos(polar)], axis=1
    )
    normals = unit(places + 0.05 * random.normal(size=(SHAPES, COUNT, 3)))
    positions = 10.0 * places + 0.3 * random.normal(size=(SHAPES, COUNT, 3))
    openings = 0.05 * random.normal(size=(SHAPES, COUNT))
    return EnsembleRows(positions, normals, unit(normals.mean(axis=0)), openings, TERMS)


def after(rows, order):
    parts = (placed(order, item) for item in (rows.positions, rows.normals))
    return EnsembleRows(*parts, rows.means, placed(order, rows.openings), TERMS)


def objective(rows):
    """Return the weighted entropies, summed up over all particles."""
    parts = zip(TERMS, (rows.positions, rows.of_normals()), strict=True)
    return sum(
        term.weight * entropy(covariance((item - item.mean(axis=0)).reshape(SHAPES, -1)), term.regularization)
        for term, item in parts
    ) * (SHAPES * COUNT)


def test_the_gain_of_an_exchange_is_the_change_of_the_objective(rows):
    exchanges = Exchanges(rows)
    before = objective(rows)
    for shape, pair in ((2, [3, 7]), (2, [3, 11]), (5, [40, 1])):
        gain = exchanges.gains(shape, np.array([pair])).sum()
        exchanges.make(shape, np.array(pair))
        changed = objective(after(rows, exchanges.order))
        assert gain == pytest.approx(before - changed, abs=1e-9)
        before = changed


def test_exchanged_particles_go_back_and_others_stay(rows):
    order = np.tile(np.arange(COUNT), (SHAPES, 1))
    for shape in (1, 4):
        pair = [
            8,
            int(np.argsort(np.linalg.norm(rows.positions[shape] - rows.positions[shape, 8], axis=1))[1]),
        ]
        order[shape, pair] = pair[::-1]
    exchanges = Exchanges(after(rows, order))
    exchanges.make_all(np.ones((SHAPES, COUNT), dtype=bool))
    np.testing.assert_array_equal(placed(exchanges.order, order), np.tile(np.arange(COUNT), (SHAPES, 1)))


def test_exchanges_do_not_depend_on_the_number_of_threads(rows, monkeypatch):
    order = np.tile(np.arange(COUNT), (SHAPES, 1))
    for shape in range(SHAPES):
        apart = np.linalg.norm(rows.positions[shape] - rows.positions[shape, 9 * shape + 4], axis=1)
        pair = np.argsort(apart)[:2]
        order[shape, pair] = pair[::-1]
    shuffled = after(rows, order)
    orders = []
    for threads in (1, 4, 4):
        for user in ("device", "correspondence.near_pairs"):
            monkeypatch.setattr(f"homolog.{user}.cores", lambda threads=threads: threads)
        exchanges = Exchanges(shuffled)
        exchanges.make_all(np.ones((SHAPES, COUNT), dtype=bool))
        orders.append(exchanges.order)
    assert (orders[0] != np.arange(COUNT)).sum() == 2 * SHAPES
    assert all(np.array_equal(order, orders[0]) for order in orders)


def test_particles_that_may_not_move_are_not_exchanged(rows):
    spoiled = after(rows, np.stack([np.arange(COUNT)] * 5 + [np.roll(np.arange(COUNT), 1)]))
    exchanges = Exchanges(spoiled)
    exchanges.make_all(np.arange(COUNT) >= 30 * np.ones((SHAPES, 1)))
    np.testing.assert_array_equal(exchanges.order[:, :30], np.tile(np.arange(30), (SHAPES, 1)))
    assert objective(after(spoiled, exchanges.order)) < objective(spoiled)


def test_where_only_normals_would_agree_better_particles_stay(rows):
    near = int(np.argsort(np.linalg.norm(rows.positions[0] - rows.positions[0, 8], axis=1))[1])
    normals = rows.normals.copy()
    normals[0, [8, near]] = normals[0, [near, 8]]
    terms = Term(1e-6, 5e-4), Term(1.0, 0.01)
    odd = EnsembleRows(rows.positions, normals, rows.means, rows.openings, terms)
    pair = np.array([8, near])
    assert Exchanges(odd).gains(0, pair[None])[0, 1] > 1.0
    assert not Exchanges(odd).lower(0, pair, LEAST_GAIN)


@pytest.mark.cuda
def test_a_gpu_makes_the_exchanges_of_the_cpu(rows, gpu):
    order = np.tile(np.arange(COUNT), (SHAPES, 1))
    order[::2, [3, 11]] = [11, 3]
    orders = []
    for device in ("cpu", gpu):
        exchanges = Exchanges(after(rows, order))
        exchanges.make_all(np.ones((SHAPES, COUNT), dtype=bool), device=device)
        orders.append(exchanges.order)
    np.testing.assert_array_equal(*orders)


@pytest.mark.parametrize("device", ["cpu", pytest.param("cuda:0", marks=pytest.mark.cuda)])
def test_the_nearest_particles_of_a_gpu_are_those_of_a_tree(rows, device):
    found = wp.zeros((SHAPES * COUNT, int(kernels.NEAREST)), dtype=wp.int32, device=device)
    positions = wp.array(rows.positions.reshape(-1, 3), dtype=wp.vec3d, device=device)
    wp.launch(kernels.find_nearest, SHAPES * COUNT, inputs=[0, COUNT, positions, found], device=device)
    expected = [cKDTree(own).query(own, k=int(kernels.NEAREST) + 1)[1][:, 1:] for own in rows.positions]
    np.testing.assert_array_equal(found.numpy(), np.concatenate(expected))
