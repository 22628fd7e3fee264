"""Correspondence without size: how large a shape is plays no part, and results keep sizes."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from homolog.correspondence import InitialParticles, initialize_fit, optimize
from homolog.geometry import scale_of, transform_points
from homolog.registration import entropy as poses_module
from homolog.registration.entropy import entropy_step
from homolog.settings import GroomSettings, OptimizeSettings, Procrustes, RunSettings

SETTINGS = OptimizeSettings(
    particles=60, split_iterations=40, anneal_iterations=100, settle_iterations=60, procrustes=Procrustes.FORM
)
GROWTH = (0.6, 1.0, 1.8)


@pytest.fixture(scope="module")
def grown(make_shape):
    """Return one ellipsoid in three sizes, turned and shifted a little."""
    random = np.random.default_rng(4)
    shapes = []
    for k, growth in enumerate(GROWTH):
        shape = make_shape(f"g{k}", tuple(growth * np.array([12.0, 9.0, 6.0])))
        alignment = np.eye(4)
        alignment[:3, :3] = Rotation.from_rotvec(0.1 * random.normal(size=3)).as_matrix()
        alignment[:3, 3] = random.normal(size=3)
        shapes.append(dataclasses.replace(shape, alignment=alignment))
    return shapes


@pytest.fixture(scope="module")
def result(grown):
    return optimize(grown, SETTINGS)


def test_particles_of_a_shape_three_times_as_large_lie_at_the_same_places(result):
    normalize_size = result.local / np.array(GROWTH)[:, None, None]
    apart = np.linalg.norm(normalize_size - normalize_size.mean(axis=0), axis=2)
    assert apart.mean() < 0.3


def test_a_result_keeps_every_size_and_its_world_is_the_aligned_local_particles(result):
    np.testing.assert_allclose(scale_of(result.alignments), 1.0, atol=1e-9)
    np.testing.assert_allclose(transform_points(result.alignments, result.local), result.world, atol=1e-9)
    sizes = np.linalg.norm(result.world - result.world.mean(axis=1, keepdims=True), axis=2).mean(axis=1)
    np.testing.assert_allclose(sizes / sizes[1], GROWTH, rtol=0.02)
    middles = result.world.mean(axis=1)
    assert np.ptp(middles, axis=0).max() < 1e-6


def test_the_normals_of_a_result_are_turned_as_its_particles_are(result):
    for growth, alignment, local, normals in zip(
        GROWTH, result.alignments, result.local, result.normals, strict=True
    ):
        upright = local / np.square(growth * np.array([12.0, 9.0, 6.0]))
        upright /= np.linalg.norm(upright, axis=1, keepdims=True)
        assert np.einsum("nd,nd->n", upright @ alignment[:3, :3].T, normals).min() > 0.99


def test_frames_show_every_shape_in_its_own_size(grown):
    frames = []
    optimize(grown, SETTINGS, observe=frames.append)
    for frame in frames[:: max(1, len(frames) // 5)]:
        np.testing.assert_allclose(scale_of(frame.alignments), 1.0, atol=1e-6)
    last = frames[-1].world
    sizes = np.linalg.norm(last - last.mean(axis=1, keepdims=True), axis=2).mean(axis=1)
    np.testing.assert_allclose(sizes / sizes[1], GROWTH, rtol=0.05)


def test_a_new_shape_of_another_size_is_fitted_to_shapes_that_stay(grown, result, make_shape):
    model = [dataclasses.replace(s, alignment=a) for s, a in zip(grown, result.alignments, strict=True)]
    shapes = [*model, make_shape("new", (30.0, 22.5, 15.0))]
    start = initialize_fit(shapes, result.local, np.array([True, True, True, False]))
    fitted = optimize(shapes, SETTINGS, initial=start)
    np.testing.assert_array_equal(fitted.world[:3], transform_points(result.alignments, result.local))
    np.testing.assert_array_equal(fitted.alignments[:3], result.alignments)
    assert scale_of(fitted.alignments[3:])[0] == pytest.approx(1.0)
    apart = np.linalg.norm(fitted.local[3] / 2.5 - result.local[1], axis=1)
    assert apart.mean() < 0.5


def test_a_result_grows_into_one_of_the_same_sizes(grown, result):
    more = optimize(
        grown, SETTINGS.model_copy(update={"particles": 90}), initial=InitialParticles(result.local)
    )
    np.testing.assert_allclose(scale_of(more.alignments), 1.0, atol=1e-9)
    assert more.local.shape == (3, 90, 3)


def test_poses_by_entropy_leave_a_body_where_it_is_though_a_part_of_it_wanders():
    random = np.random.default_rng(5)
    body = 50.0 * random.normal(size=(200, 3))
    points = np.stack([body] * 6)
    points[:, :40, 1] += np.linspace(-20.0, 20.0, 6)[:, None]
    poses = np.tile(np.eye(4), (6, 1, 1))
    for _ in range(10):
        posed = transform_points(poses, points)
        poses = entropy_step(posed, poses, np.full(6, True), scaling=True, regularization=0.1)
    turns = Rotation.from_matrix(poses[:, :3, :3] / scale_of(poses)[:, None, None])
    assert np.degrees((turns * turns[0].inv()).magnitude()).max() < 0.2


def test_poses_by_entropy_do_not_depend_on_the_blocks_in_which_many_shapes_are_taken(monkeypatch):
    random = np.random.default_rng(6)
    points = random.normal(size=(30, 3)) + 0.1 * random.normal(size=(11, 30, 3))
    free = np.arange(11) % 5 > 0
    monkeypatch.setattr(poses_module, "MANY_SHAPES", 0)
    monkeypatch.setattr(poses_module, "TOGETHER", 1)
    results = []
    for block in (1, 4):
        monkeypatch.setattr(poses_module, "BLOCK", block)
        start = np.tile(np.eye(4), (11, 1, 1))
        results.append(entropy_step(points, start, free, scaling=True, regularization=0.1))
    np.testing.assert_allclose(*results, atol=1e-12)
    assert np.abs(results[0][free] - np.eye(4)).max() > 1e-3
    np.testing.assert_array_equal(results[0][~free], np.tile(np.eye(4), (3, 1, 1)))


@pytest.mark.parametrize(
    ("groom", "expected"),
    [
        ({}, Procrustes.FORM),
        ({"scaling": True}, Procrustes.SHAPE),
        ({"alignment": "none"}, Procrustes.OFF),
        ({"alignment": "center"}, Procrustes.OFF),
        ({"alignment": "axes"}, Procrustes.OFF),
    ],
)
def test_auto_compares_forms_where_shapes_were_registered_and_takes_others_as_they_lie(groom, expected):
    assert RunSettings(groom=GroomSettings(**groom)).placing.procrustes is expected
    settings = OptimizeSettings(procrustes=Procrustes.RIGID)
    assert RunSettings(groom=GroomSettings(**groom), optimize=settings).placing is settings
