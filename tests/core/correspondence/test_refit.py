"""Some particles of a result optimized again: patches, new subjects, more particles."""

import numpy as np
import pytest

from homolog.correspondence import InitialParticles, initialize_fit, optimize, repair
from homolog.correspondence.refit import predict_positions
from homolog.errors import InputError
from homolog.settings import OptimizeSettings

SETTINGS = OptimizeSettings(particles=100, split_iterations=30, anneal_iterations=150, settle_iterations=150)


@pytest.fixture(scope="module")
def result(ellipsoid_shapes):
    return optimize(ellipsoid_shapes, SETTINGS)


@pytest.fixture(scope="module")
def spacing(result):
    gaps = np.linalg.norm(result.local[0][:, None] - result.local[0], axis=-1)
    np.fill_diagonal(gaps, np.inf)
    return float(gaps.min(axis=1).mean())


def spread_of(world):
    """Variance per particle [mm²]."""
    return float(np.square(world - world.mean(axis=0)).sum() / (len(world) - 1) / world.shape[1])


def with_swap(result, shape, particle):
    """Return the particles with one and its nearest neighbour exchanged, and where they are."""
    gaps = np.linalg.norm(result.local[shape] - result.local[shape, particle], axis=-1)
    pair = np.argsort(gaps)[:2]
    swapped = result.local.copy()
    swapped[shape, pair] = swapped[shape, pair[::-1]]
    return swapped, pair


@pytest.mark.parametrize(("shape", "particle"), [(0, 0), (2, 17), (4, 55)])
def test_swapped_neighbours_return_to_their_places_and_nothing_else_moves(
    result, spacing, ellipsoid_shapes, shape, particle
):
    swapped, pair = with_swap(result, shape, particle)
    movable = np.zeros(swapped.shape[:2], dtype=bool)
    movable[shape, pair] = True
    repaired = repair(ellipsoid_shapes, SETTINGS, swapped, movable)
    np.testing.assert_array_equal(repaired.local[~movable], result.local[~movable])
    np.testing.assert_array_equal(repaired.world[~movable], result.world[~movable])
    assert np.linalg.norm(repaired.local - result.local, axis=-1).max() < 0.15 * spacing


def test_a_patch_may_move_on_all_subjects_while_one_is_not_trusted(result, spacing, ellipsoid_shapes):
    swapped, pair = with_swap(result, 1, 30)
    near = np.argsort(np.linalg.norm(result.local[1] - result.local[1, 30], axis=-1))[:9]
    movable, wrong = np.zeros((2, *swapped.shape[:2]), dtype=bool)
    movable[:, near] = True
    wrong[1, pair] = True
    repaired = repair(ellipsoid_shapes, SETTINGS, swapped, movable, misplaced=wrong)
    np.testing.assert_array_equal(repaired.local[~movable], result.local[~movable])
    assert np.linalg.norm(repaired.local - result.local, axis=-1).max() < 0.3 * spacing
    assert np.linalg.norm(repaired.local - result.local, axis=-1)[movable].min() > 0.0


def test_the_prediction_does_not_look_at_what_is_misplaced():
    random = np.random.default_rng(0)
    mean = random.normal(size=(60, 3))
    world = np.stack([mean @ (np.eye(3) + 0.1 * random.normal(size=(3, 3))) for _ in range(4)])
    misplaced = np.zeros((4, 60), dtype=bool)
    misplaced[1, 7] = misplaced[2, 7] = True
    spoilt = world.copy()
    spoilt[misplaced] += 5.0
    np.testing.assert_allclose(predict_positions(spoilt, misplaced)[1, 7], world[1, 7], atol=0.3)
    np.testing.assert_array_equal(predict_positions(spoilt, misplaced)[~misplaced], world[~misplaced])


def test_a_subject_with_nothing_in_place_cannot_be_repaired(result, ellipsoid_shapes):
    movable = np.zeros(result.local.shape[:2], dtype=bool)
    movable[3] = True
    with pytest.raises(InputError, match="fit the subject"):
        repair(ellipsoid_shapes, SETTINGS, result.local, movable)


def test_a_new_subject_lands_where_it_is_in_the_joint_model(result, spacing, ellipsoid_shapes):
    known = np.array([True, True, False, True, True])
    model = optimize([s for s, item in zip(ellipsoid_shapes, known, strict=True) if item], SETTINGS)
    start = initialize_fit(ellipsoid_shapes, model.local, known)
    fitted = optimize(ellipsoid_shapes, SETTINGS, initial=start)
    np.testing.assert_array_equal(fitted.local[known], model.local)
    # the others' places, of which it is the middle one
    expected = model.local.mean(axis=0)
    assert np.linalg.norm(fitted.local[2] - expected, axis=-1).mean() < 0.15 * spacing


def test_more_particles_are_added_to_those_there_are(result, ellipsoid_shapes):
    more = SETTINGS.model_copy(update={"particles": 230, "ensemble_weight": 0.02})
    grown = optimize(ellipsoid_shapes, more, initial=InitialParticles(result.local))
    fresh = optimize(ellipsoid_shapes, more)
    assert grown.world.shape == (5, 230, 3)
    assert spread_of(grown.world) == pytest.approx(spread_of(fresh.world), rel=0.1)
    assert grown.energies[-1, 1:].sum() == pytest.approx(fresh.energies[-1, 1:].sum(), abs=0.03)


def test_a_start_that_does_not_fit_is_refused(result, ellipsoid_shapes):
    fewer = SETTINGS.model_copy(update={"particles": 50})
    with pytest.raises(InputError, match="100 on 5 shapes"):
        optimize(ellipsoid_shapes, fewer, initial=InitialParticles(result.local))
    held = np.zeros(result.local.shape[:2], dtype=bool)
    with pytest.raises(InputError, match="nothing to optimize"):
        optimize(ellipsoid_shapes, SETTINGS, initial=InitialParticles(result.local, held))
    more = SETTINGS.model_copy(update={"particles": 150})
    with pytest.raises(InputError, match="all particles"):
        optimize(ellipsoid_shapes, more, initial=InitialParticles(result.local, ~held))
