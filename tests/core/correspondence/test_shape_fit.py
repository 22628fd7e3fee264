"""One shape against a frozen ensemble."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from homolog.correspondence import optimize, shape_fit
from homolog.correspondence.ensemble import generalization_error, make_ensemble
from homolog.correspondence.entropy.sampling import LIST_ITERATIONS
from homolog.correspondence.fit_engine import FitEngine
from homolog.correspondence.launcher import Launcher
from homolog.correspondence.passes import plan_passes
from homolog.correspondence.prepared_cohort import prepare_cohort
from homolog.correspondence.schedule import plan_stages
from homolog.correspondence.shape_fit import (
    first_particles,
    fit_shape,
    fit_shape_from,
    nearest_template,
    shape_state,
)
from homolog.correspondence.surface_sets import length_unit, normalize_size
from homolog.geometry import transform_points
from homolog.registration import pose_search
from homolog.registration.entropy import entropy_step
from homolog.registration.pose_search import search_poses
from homolog.settings import OptimizeSettings, Procrustes

SETTINGS = OptimizeSettings(
    particles=64,
    split_iterations=30,
    anneal_iterations=200,
    settle_iterations=400,
    procrustes=Procrustes.FORM,
    opening_weight=0.0,
)


@pytest.fixture(scope="module")
def placed(ellipsoid_shapes):
    """The joint optimization of five ellipsoids: shapes with placements, and their states."""
    result = optimize(ellipsoid_shapes, SETTINGS)
    shapes = normalize_size(
        [replace(s, alignment=a) for s, a in zip(ellipsoid_shapes, result.alignments, strict=True)]
    )
    unit = length_unit(shapes)
    placements = np.stack([shape.alignment for shape in shapes])
    placements[:, :3] /= unit
    points, poses = transform_points(placements, result.local), np.tile(np.eye(4), (5, 1, 1))
    for _ in range(50):
        posed = transform_points(poses, points)
        poses = entropy_step(
            posed, poses, np.full(5, True), scaling=True, regularization=SETTINGS.regularization_end
        )
    shapes = [replace(s, alignment=p) for s, p in zip(shapes, poses @ placements, strict=True)]
    states = [
        shape_state(shape, SETTINGS, local, unit=unit, opening_scale=0.0)
        for shape, local in zip(shapes, result.local, strict=True)
    ]
    return shapes, states, unit


def ensemble_of(states, unit):
    templates = range(len(states))
    return make_ensemble(states, SETTINGS, unit=unit, area=1e4, opening_scale=0.0, templates=templates)


@pytest.mark.parametrize("index", [0, 2])
def test_a_joint_optimization_is_a_fixed_point(placed, index):
    shapes, states, unit = placed
    ensemble, plan = ensemble_of(states, unit), plan_passes(SETTINGS).settling
    again = fit_shape(shapes[index], SETTINGS, ensemble, states[index].local, plan=plan)
    spacing = np.sqrt(shapes[index].mesh.area / 64)
    assert np.linalg.norm(again.local - states[index].local, axis=1).mean() < 0.05 * spacing


def test_a_shape_that_was_left_out_lands_near_its_place_in_the_joint_optimization(placed):
    shapes, states, unit = placed
    others = [0, 1, 3, 4]
    ensemble = ensemble_of([states[index] for index in others], unit)
    nearest = nearest_template(ensemble, shapes[2])
    assert others[nearest] in (1, 3)
    begin = first_particles(ensemble, nearest, shapes[others[nearest]], shapes[2])
    fitted = fit_shape(shapes[2], SETTINGS, ensemble, begin)
    spacing = np.sqrt(shapes[2].mesh.area / 64)
    assert np.linalg.norm(fitted.local - states[2].local, axis=1).mean() < 0.15 * spacing
    assert np.abs(np.linalg.det(fitted.placement[:3, :3])) > 0.0


def test_the_pose_is_found_from_particles_that_are_turned_over_the_surface(placed):
    shapes, states, unit = placed
    ensemble = ensemble_of([states[index] for index in (0, 1, 3, 4)], unit)
    turn = Rotation.from_euler("xyz", [10, -5, 15], degrees=True)
    centre = states[2].local.mean(axis=0)
    turned = turn.apply(states[2].local - centre) + centre
    fitted = fit_shape_from(shapes[2], SETTINGS, ensemble, [turned, turned])
    spacing = np.sqrt(shapes[2].mesh.area / 64)
    assert np.linalg.norm(turned - states[2].local, axis=1).mean() > 0.5 * spacing
    assert np.linalg.norm(fitted.local - states[2].local, axis=1).mean() < 0.15 * spacing


def test_of_several_poses_the_one_whose_particles_end_lowest_is_kept(placed, monkeypatch):
    shapes, states, unit = placed
    ensemble = ensemble_of([states[index] for index in (0, 1, 3, 4)], unit)

    def with_a_wrong_one_first(ensemble, terms, surface, poses, *, scaling):
        pose, points = search_poses(ensemble, terms, surface, poses, scaling=scaling)[0]
        turn = np.eye(4)
        turn[:3, :3] = Rotation.from_euler("z", 60.0, degrees=True).as_matrix()
        wrong = turn @ pose
        return [(wrong, surface.nearest(wrong, points, ensemble.normals)[0]), (pose, points)]

    monkeypatch.setattr(shape_fit, "search_poses", with_a_wrong_one_first)
    fitted = fit_shape_from(shapes[2], SETTINGS, ensemble, [states[2].local])
    spacing = np.sqrt(shapes[2].mesh.area / 64)
    assert np.linalg.norm(fitted.local - states[2].local, axis=1).mean() < 0.15 * spacing


def test_poses_do_not_depend_on_the_number_of_threads(placed, monkeypatch):
    shapes, states, unit = placed
    ensemble = ensemble_of([states[index] for index in (0, 1, 3, 4)], unit)
    found = []

    def twice(*given, **named):
        for threads in (1, 2):
            monkeypatch.setattr(pose_search, "cores", lambda threads=threads: threads)
            found.append(search_poses(*given, **named))
        return found[-1]

    monkeypatch.setattr(shape_fit, "search_poses", twice)
    fit_shape_from(shapes[2], SETTINGS, ensemble, [states[2].local, np.roll(states[2].local, 1, axis=1)])
    alone, together = found
    assert len(alone) == len(together)
    for one, other in zip(alone, together, strict=True):
        np.testing.assert_array_equal(one[0], other[0])
        np.testing.assert_array_equal(one[1], other[1])


def test_a_pose_that_the_search_misses_is_followed_from_the_placed_particles(placed, monkeypatch):
    shapes, states, unit = placed
    ensemble = ensemble_of([states[index] for index in (0, 1, 3, 4)], unit)

    def turned(ensemble, terms, surface, poses, *, scaling):
        turn = np.eye(4)
        turn[:3, :3] = Rotation.from_euler("z", 40.0, degrees=True).as_matrix()
        pose = turn @ search_poses(ensemble, terms, surface, poses, scaling=scaling)[0][0]
        return [(pose, surface.nearest(pose, ensemble.mean, ensemble.normals)[0])]

    monkeypatch.setattr(shape_fit, "search_poses", turned)

    def error():
        fitted = fit_shape_from(shapes[2], SETTINGS, ensemble, [states[2].local])
        spacing = np.sqrt(shapes[2].mesh.area / 64)
        return np.linalg.norm(fitted.local - states[2].local, axis=1).mean() / spacing

    assert error() < 0.15
    monkeypatch.setattr(shape_fit, "_MOST_ROUNDS", 0)
    assert error() > 0.3


def test_an_isolated_particle_does_not_outweigh_the_objective(placed):
    shapes, states, unit = placed
    ensemble = ensemble_of([states[index] for index in (0, 1, 3, 4)], unit)
    world = np.diag([unit, unit, unit, 1.0]) @ shapes[2].alignment
    cohort = prepare_cohort(
        [replace(shapes[2], alignment=world)],
        SETTINGS,
        device="cpu",
        counts=[64],
        free_shapes=np.array([True]),
        unit=unit,
        opening_scale=0.0,
    )
    points = cohort.to_optimizer[0].apply(states[2].local)[None]
    engine = FitEngine(ensemble, cohort, points, Launcher("cpu", 1), np.eye(4)[None], is_in_it=False)
    engine.start_stage([plan_stages(SETTINGS, 64)[-1].weights(0)] * LIST_ITERATIONS)
    engine.iterate()
    even = engine.energy()[0]
    densities = engine.sampling.energies.numpy()
    densities[0] = -1000.0
    assert abs(engine.energy()[0] - even) < 0.1


def test_a_lost_particle_is_moved_to_where_the_ensemble_expects_it(placed, monkeypatch):
    shapes, states, unit = placed
    ensemble = ensemble_of([states[index] for index in (0, 1, 3, 4)], unit)
    monkeypatch.setattr(FitEngine, "surface_distances", lambda engine: 1e3 * (np.arange(64) == 7)[None])
    fitted = fit_shape_from(shapes[2], SETTINGS, ensemble, [states[2].local])
    spacing = np.sqrt(shapes[2].mesh.area / 64)
    assert np.linalg.norm(fitted.local - states[2].local, axis=1)[7] < 0.5 * spacing


def test_the_generalization_error_is_what_other_subjects_do_not_explain():
    generator = np.random.default_rng(0)
    modes = generator.normal(size=(3, 40, 3))
    shapes = np.tensordot(generator.normal(size=(50, 3)), modes, axes=1).astype(np.float32)
    assert generalization_error(shapes) < 1e-3
    noisy = shapes + 0.1 * generator.normal(size=shapes.shape).astype(np.float32)
    assert 0.1 < generalization_error(noisy) < 0.2
