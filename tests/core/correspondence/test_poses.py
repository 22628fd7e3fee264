"""Alignment by corresponding points, alone and inside an optimization."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from homolog.correspondence import optimize
from homolog.errors import Cancelled
from homolog.geometry import fit_similarity, inverse_matrices, transform_points
from homolog.registration.entropy import MANY_SHAPES, entropy_step
from homolog.registration.procrustes import procrustes_step
from homolog.settings import OptimizeSettings, Procrustes

SETTINGS = OptimizeSettings(particles=60, split_iterations=40, anneal_iterations=100, settle_iterations=60)


def random_similarity(random, angle=0.2, shift=1.5, scale=1.0):
    result = np.eye(4)
    result[:3, :3] = scale * Rotation.from_rotvec(angle * random.normal(size=3)).as_matrix()
    result[:3, 3] = shift * random.normal(size=3)
    return result


def spread_of(world):
    """Variance per particle [mm²]."""
    return float(np.square(world - world.mean(axis=0)).sum() / (len(world) - 1) / world.shape[1])


@pytest.mark.parametrize(("shapes", "particles"), [(5, 40), (MANY_SHAPES + 3, 31)])  # one by one, in blocks
@pytest.mark.parametrize("scaling", [False, True])
def test_compiled_steps_of_poses_are_those_of_numpy(shapes, particles, scaling):
    random = np.random.default_rng(0)
    points = 20.0 * random.normal(size=(particles, 3)) + random.normal(size=(shapes, particles, 3))
    points[:, 0] += 9.0 * random.normal(size=(shapes, 3))  # an outlier
    poses = np.stack([random_similarity(random) for _ in range(shapes)])
    free = np.arange(shapes) != 2
    expected, compiled = (
        entropy_step(points, poses, free, scaling=scaling, regularization=0.1, compiled=kind)
        for kind in (False, True)
    )
    np.testing.assert_allclose(compiled, expected, atol=1e-11)
    np.testing.assert_array_equal(compiled[2], poses[2])
    assert np.abs(compiled - poses).max() > 1e-3


@pytest.mark.parametrize("scaling", [False, True])
def test_a_similarity_is_found_again(scaling):
    random = np.random.default_rng(0)
    points = random.normal(size=(1, 20, 3))
    matrix = random_similarity(random, 1.0, 3.0, 1.7 if scaling else 1.0)
    moved = transform_points(matrix[None], points)
    np.testing.assert_allclose(fit_similarity(points[0], moved[0], scaling=scaling), matrix, atol=1e-12)
    np.testing.assert_allclose(transform_points(inverse_matrices(matrix[None]), moved), points, atol=1e-12)


def test_a_mirrored_shape_is_turned_not_mirrored():
    points = np.random.default_rng(0).normal(size=(30, 3))
    result = fit_similarity(points, points * [-1.0, 1.0, 1.0], scaling=True)
    assert np.linalg.det(result[:3, :3]) > 0.0


@pytest.mark.parametrize("scaling", [False, True])
def test_rounds_of_procrustes_bring_copies_of_one_shape_together(scaling):
    random = np.random.default_rng(1)
    shape = random.normal(size=(40, 3))
    matrices = np.stack([random_similarity(random, 0.5, 2.0, 1.0 + 0.2 * k * scaling) for k in range(5)])
    points = transform_points(matrices, np.stack([shape] * 5))
    poses = np.tile(np.eye(4), (5, 1, 1))
    for _ in range(60):
        posed = transform_points(poses, points)
        poses = procrustes_step(posed, posed, poses, np.full(5, True), scaling=scaling)
    assert spread_of(transform_points(poses, points)) < 1e-6
    scales = np.cbrt(np.linalg.det(poses[:, :3, :3]))
    assert np.log(scales).mean() == pytest.approx(0.0, abs=1e-9)


def test_a_pose_that_may_not_change_stays_and_draws_the_others():
    random = np.random.default_rng(2)
    shape = random.normal(size=(40, 3))
    points = transform_points(np.stack([random_similarity(random) for _ in range(3)]), np.stack([shape] * 3))
    before = np.tile(np.eye(4), (3, 1, 1))
    after = before
    for _ in range(20):
        posed = transform_points(after, points)
        after = procrustes_step(posed, posed, after, np.array([True, False, True]), scaling=False)
    np.testing.assert_array_equal(after[1], before[1])
    np.testing.assert_allclose(transform_points(after, points), np.stack([points[1]] * 3), atol=1e-9)


@pytest.fixture(scope="module")
def disturbed(ellipsoid_shapes):
    """Return the ellipsoids, each turned and shifted a little."""
    random = np.random.default_rng(3)
    return [dataclasses.replace(s, alignment=random_similarity(random, 0.05)) for s in ellipsoid_shapes]


def test_disturbed_alignments_give_the_model_of_undisturbed_ones(ellipsoid_shapes, disturbed):
    rigid = SETTINGS.model_copy(update={"procrustes": Procrustes.RIGID})
    expected = optimize(ellipsoid_shapes, rigid)
    result = optimize(disturbed, rigid)
    plain = optimize(disturbed, SETTINGS)
    assert spread_of(plain.world) > 5.0 * spread_of(expected.world)
    assert spread_of(result.world) == pytest.approx(spread_of(expected.world), rel=0.1)
    assert result.energies[-1, 1:].sum() < expected.energies[-1, 1:].sum() + 0.01
    np.testing.assert_allclose(transform_points(result.alignments, result.local), result.world, atol=1e-9)
    turns = result.alignments[:, :3, :3]
    np.testing.assert_allclose(turns @ turns.transpose(0, 2, 1), np.tile(np.eye(3), (5, 1, 1)), atol=1e-9)


def test_size_is_taken_out_and_the_local_particles_stay_on_their_surfaces(ellipsoid_shapes, make_shape):
    grown = [
        make_shape(f"g{k}", tuple(f * np.array([12.0, 9.0, 6.0]))) for k, f in enumerate((0.8, 1.0, 1.3))
    ]
    result = optimize(grown, SETTINGS.model_copy(update={"procrustes": Procrustes.SHAPE}))
    assert spread_of(result.world) < 0.05
    for scale, points in zip((0.8, 1.0, 1.3), result.local, strict=True):
        level = np.linalg.norm(points / (scale * np.array([12.0, 9.0, 6.0])), axis=1) - 1.0
        assert np.abs(level).max() < 0.01


def test_an_aligning_run_that_was_broken_off_ends_bit_identical(disturbed):
    disturbed = disturbed[:3]
    rigid = SETTINGS.model_copy(update={"procrustes": Procrustes.RIGID})
    kept = []

    def tick(fraction, message):
        if kept and fraction > 0.7:
            raise Cancelled

    with pytest.raises(Cancelled):
        optimize(disturbed, rigid, tick=tick, checkpoint=kept.append)
    whole, rest = optimize(disturbed, rigid), optimize(disturbed, rigid, resume=kept[-1])
    np.testing.assert_array_equal(rest.world, whole.world)
    np.testing.assert_array_equal(rest.alignments, whole.alignments)


def test_shapes_from_slender_to_flat_are_not_turned_onto_the_mean(make_shape):
    """The widest lies nearest to the mean's surface when its long axis is turned onto the mean's."""
    amounts = np.linspace(-0.9, 0.9, 6)
    axes = np.array([12.0, 9.0, 6.0]) * np.exp(amounts[:, None] * [-0.5, 0.5, 0.0])
    cohort = [make_shape(f"s{k}", tuple(row)) for k, row in enumerate(axes)]
    result = optimize(cohort, SETTINGS.model_copy(update={"procrustes": Procrustes.RIGID}))
    turns = Rotation.from_matrix(result.alignments[:, :3, :3])
    assert np.degrees(turns.magnitude()).max() < 15.0
