"""Whole optimizations of small cohorts: what they reach, what leaves them unchanged, how they stop."""

import dataclasses

import numpy as np
import pytest

from homolog.correspondence import Reason, Shape, optimize
from homolog.correspondence.initialization.splitting import split
from homolog.correspondence.launcher import Launcher
from homolog.correspondence.recorder import RunRecorder
from homolog.correspondence.schedule import TimeShares, joint_counts, particle_counts, plan_stages
from homolog.errors import Cancelled, InputError, NumericalError
from homolog.geodesics import solve_tables
from homolog.settings import Method, OptimizeSettings, Procrustes
from homolog.surfaces.distance_field import DistanceField
from homolog.surfaces.mesh import TriangleMesh

QUICK = OptimizeSettings(particles=40, split_iterations=20, anneal_iterations=80, settle_iterations=60)


def level_of(points, axes):
    return np.linalg.norm(points / axes, axis=-1) - 1.0


def spread_of(world):
    """Variance per particle [mm²]."""
    return float(((world - world.mean(axis=0)) ** 2).sum() / (len(world) - 1) / world.shape[1])


@dataclasses.dataclass
class Watched:
    """A whole optimization, and what it handed over on its way."""

    result: object
    checkpoints: list
    frames: list
    ticks: list


@pytest.fixture(scope="module")
def watched(ellipsoid_shapes):
    checkpoints, frames, ticks = [], [], []
    result = optimize(
        ellipsoid_shapes,
        QUICK,
        tick=lambda fraction, message: ticks.append((fraction, message)),
        checkpoint=checkpoints.append,
        observe=frames.append,
    )
    return Watched(result, checkpoints, frames, ticks)


@pytest.fixture(scope="module")
def actual(watched):
    return watched.result


def test_particles_lie_on_every_surface_and_spread_over_it(actual, ellipsoid_shapes):
    for index in range(len(ellipsoid_shapes)):
        axes = np.array([12.0, 9.0, 6.0 + 0.5 * index])
        points = actual.local[index]
        assert np.abs(level_of(points, axes)).max() < 0.01
        gaps = np.linalg.norm(points[:, None] - points[None], axis=-1)
        np.fill_diagonal(gaps, np.inf)
        nearest = gaps.min(axis=1)
        assert nearest.std() / nearest.mean() < 0.2


def test_the_progress_of_the_first_particles_only_grows(ellipsoid_shapes, monkeypatch):
    fractions, launchers = [], []

    class KeptLauncher(Launcher):
        def __init__(self, *arguments, **named):
            super().__init__(*arguments, **named)
            launchers.append(self)

    def tick(fraction, message):
        if message == "first particles":
            fractions.append(fraction)

    monkeypatch.setattr("homolog.correspondence.loop.Launcher", KeptLauncher)
    rigid = QUICK.model_copy(update={"procrustes": Procrustes.RIGID})
    # A frame is emitted after the first round; launches that take long poll as here.
    optimize(ellipsoid_shapes, rigid, tick=tick, observe=lambda _: launchers[-1].poll_cancel())
    assert fractions == sorted(fractions)
    assert len(set(fractions)) > 2


def test_one_growing_axis_is_one_mode(actual):
    centred = (actual.world - actual.world.mean(axis=0)).reshape(len(actual.world), -1)
    variances = np.linalg.svd(centred, compute_uv=False) ** 2
    assert variances[0] / variances.sum() > 0.97


def test_normals_are_those_of_the_surface(actual):
    axes = np.array([12.0, 9.0, 6.0])
    outward = actual.local[0] / axes**2
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    assert (outward * actual.normals[0]).sum(axis=1).min() > 0.999


def test_the_same_seed_gives_the_same_bits_and_another_seed_does_not(actual, ellipsoid_shapes):
    again = optimize(ellipsoid_shapes, QUICK)
    other = optimize(ellipsoid_shapes, QUICK.model_copy(update={"seed": 1}))
    np.testing.assert_array_equal(again.world, actual.world)
    assert np.abs(other.world - actual.world).max() > 0.1


def test_a_resumed_optimization_ends_bit_identical_wherever_it_was_broken_off(
    actual, watched, ellipsoid_shapes
):
    kept = watched.checkpoints
    assert len(kept) == len(plan_stages(QUICK))
    for checkpoint in (kept[2], kept[-2], kept[-1]):
        rest = optimize(ellipsoid_shapes, QUICK, resume=checkpoint)
        np.testing.assert_array_equal(rest.world, actual.world)
        np.testing.assert_array_equal(rest.energies, actual.energies)


def test_cancelling_stops_at_once_and_hands_over_a_checkpoint_to_go_on_from(actual, ellipsoid_shapes):
    kept, calls = [], []

    def tick(fraction, message):
        calls.append(fraction)
        if fraction > 0.8 and message.startswith("optimizing"):
            raise Cancelled

    with pytest.raises(Cancelled):
        optimize(ellipsoid_shapes, QUICK, tick=tick, checkpoint=kept.append)
    assert sorted(calls) == calls
    rest = optimize(ellipsoid_shapes, QUICK, resume=kept[-1])
    np.testing.assert_array_equal(rest.world, actual.world)


def test_every_iteration_there_is_a_chance_to_cancel(watched):
    assert sum("particles" in message for _, message in watched.ticks) >= watched.result.iterations


def test_a_checkpoint_of_another_cohort_is_refused(watched, ellipsoid_shapes):
    kept = watched.checkpoints
    with pytest.raises(InputError, match="another cohort"):
        optimize(ellipsoid_shapes[:4], QUICK, resume=kept[-1])
    faces = kept[-1].faces.copy()
    faces[2, 3] = 10**6
    with pytest.raises(InputError, match="another cohort"):
        optimize(ellipsoid_shapes, QUICK, resume=dataclasses.replace(kept[-1], faces=faces))


def test_frames_show_the_stages_in_order(watched):
    frames = watched.frames
    iterations = [frame.iteration for frame in frames]
    assert iterations == sorted(iterations)
    assert all(frame.world.shape[0] == 5 for frame in frames)
    assert all(np.isfinite(frame.energies).all() == (frame.iteration > 0) for frame in frames)


def test_the_objective_is_recorded_and_the_run_says_why_it_ended(actual):
    assert actual.reason in (Reason.CONVERGED, Reason.ITERATIONS)
    assert actual.energies[-1, 0] == actual.iterations
    assert np.isfinite(actual.energies).all()


@pytest.mark.parametrize("method", list(Method))
def test_every_method_reaches_a_uniform_layout(method, ellipsoid_shapes):
    settings = QUICK.model_copy(update={"method": method, "particles": 24})
    result = optimize(ellipsoid_shapes[:3], settings)
    assert result.world.shape == (3, 24, 3)
    assert spread_of(result.world) < 1.0
    assert (result.energies[-1, 3] == 0.0) == (not method.uses_normals)


@pytest.mark.parametrize("particles", [5, 13, 37])
def test_any_number_of_particles_can_be_asked_for(particles, ellipsoid_shapes):
    result = optimize(ellipsoid_shapes[:2], QUICK.model_copy(update={"particles": particles}))
    assert result.world.shape == (2, particles, 3)


def test_counts_halve_down_to_what_registration_places():
    assert particle_counts(1000) == [250, 500, 1000]
    assert particle_counts(40) == [40]


def test_structures_begin_with_their_shares_of_the_first_particles_and_end_together():
    none = [None] * 6
    assert joint_counts([256, 256], none[:2]) == [[128, 256], [128, 256]]
    assert joint_counts([300, 24], none[:2]) == [[150, 300], [24, 24]]
    assert joint_counts([512] * 6, none) == [[64, 128, 256, 512]] * 6
    assert joint_counts([512, 256], [256, 256]) == [[256, 512], [256, 256]]


def test_a_split_moves_parent_and_child_apart_the_same_way_on_every_shape():
    random = np.random.default_rng(0)
    positions = random.normal(size=(3, 6, 3))
    normals = np.tile([0.0, 0.0, 1.0], (3, 6, 1))
    result = split(positions, normals, 9, np.full(len(positions), 0.5), random)
    parents = [i for i in range(6) if not np.allclose(result[0, i], positions[0, i])]
    gaps = result[:, 6:] - result[:, parents]
    np.testing.assert_allclose(np.linalg.norm(gaps, axis=2), 1.0, rtol=1e-5)
    np.testing.assert_allclose(gaps[0], gaps[2], atol=1e-6)
    np.testing.assert_allclose(gaps[..., 2], 0.0, atol=1e-6)


def rescale(shape, factor):
    index_to_world = np.diag([factor] * 3 + [1.0]) @ shape.field.index_to_world
    return Shape(
        shape.name,
        DistanceField(shape.field.values * factor, index_to_world),
        TriangleMesh(shape.mesh.vertices * factor, shape.mesh.faces),
        TriangleMesh(shape.coarse_mesh.vertices * factor, shape.coarse_mesh.faces),
        shape.alignment,
    )


def test_a_change_of_units_changes_nothing(actual, ellipsoid_shapes):
    micrometres = optimize([rescale(shape, 1000.0) for shape in ellipsoid_shapes], QUICK)
    assert spread_of(micrometres.world / 1000.0) == pytest.approx(spread_of(actual.world), rel=0.05)
    assert micrometres.energies[-1, 1:].sum() == pytest.approx(actual.energies[-1, 1:].sum(), abs=0.01)


def test_the_order_of_subjects_does_not_matter(actual, ellipsoid_shapes):
    turned = optimize(ellipsoid_shapes[::-1], QUICK)
    assert spread_of(turned.world) == pytest.approx(spread_of(actual.world), rel=0.05)
    assert turned.energies[-1, 1:].sum() == pytest.approx(actual.energies[-1, 1:].sum(), abs=0.01)


def test_a_cohort_repeated_twice_gives_the_same_model(actual, ellipsoid_shapes):
    twins = [dataclasses.replace(shape, name=shape.name + "'") for shape in ellipsoid_shapes]
    double = optimize([*ellipsoid_shapes, *twins], QUICK)
    np.testing.assert_allclose(double.world[:5], double.world[5:], atol=1e-3)
    assert spread_of(double.world) * 9 / 8 == pytest.approx(spread_of(actual.world), rel=0.1)


def test_an_alignment_brings_turned_shapes_to_the_same_model(actual, ellipsoid_shapes, make_shape):
    swap = np.array([[0.0, -1, 0, 3], [1, 0, 0, -2], [0, 0, 1, 5], [0, 0, 0, 1]])
    turned = []
    for k, shape in enumerate(ellipsoid_shapes):
        if k % 2:
            shape = make_shape(shape.name, (9.0, 12.0, 6.0 + 0.5 * k), alignment=swap)
            moved = shape.alignment.copy()
            moved[:3, 3] = 0.0
            shape = dataclasses.replace(shape, alignment=moved)
        turned.append(shape)
    result = optimize(turned, QUICK)
    assert spread_of(result.world) == pytest.approx(spread_of(actual.world), rel=0.15)
    back = result.local[1] @ swap[:3, :3].T
    np.testing.assert_allclose(back, result.world[1], atol=1e-3)


def test_a_shape_whose_field_and_mesh_disagree_is_named(ellipsoid_shapes, make_shape):
    wrong = make_shape("wrong", (12.0, 9.0, 6.0), centre=(9.0, 0.0, 0.0))
    mixed = dataclasses.replace(wrong, field=ellipsoid_shapes[0].field)
    with pytest.raises(NumericalError, match=r"^wrong: "):
        optimize([*ellipsoid_shapes[:2], mixed], QUICK)


def test_fewer_than_two_shapes_are_refused(ellipsoid_shapes):
    with pytest.raises(InputError, match="two shapes"):
        optimize(ellipsoid_shapes[:1], QUICK)


def test_cancelling_in_the_middle_of_an_iteration_loses_nothing(actual, ellipsoid_shapes):
    kept, calls = [], []

    def tick(fraction, message):
        calls.append(message)
        if sum("optimizing" in call for call in calls) == 137:
            raise Cancelled

    with pytest.raises(Cancelled):
        optimize(ellipsoid_shapes, QUICK, tick=tick, checkpoint=kept.append)
    rest = optimize(ellipsoid_shapes, QUICK, resume=kept[-1])
    np.testing.assert_array_equal(rest.world, actual.world)


def test_particles_are_even_on_surfaces_of_very_different_size(make_shape):
    shapes = [make_shape(f"r{r}", (r, r, r), spacing=r / 10.0) for r in (4.0, 12.0, 30.0)]
    actual = optimize(shapes, QUICK.model_copy(update={"particles": 60, "anneal_iterations": 150}))
    for points in actual.local:
        gaps = np.linalg.norm(points[:, None] - points[None], axis=-1)
        np.fill_diagonal(gaps, np.inf)
        nearest = gaps.min(axis=1)
        assert nearest.std() / nearest.mean() < 0.15


def shares_of(particles, *, geodesic=True, registers=True, threads=2):
    stages = plan_stages(OptimizeSettings(particles=particles))
    return TimeShares(stages, geodesic=geodesic, registers=registers, threads=threads)


def test_estimates_give_preparation_a_smaller_share_the_more_particles_are_placed():
    few, many = shares_of(512), shares_of(4096)
    assert 1.0 > few.preparation > many.preparation > 0.0
    assert 1.0 > few.first_particles > many.first_particles > 0.0
    assert shares_of(512, geodesic=False).preparation < few.preparation
    assert shares_of(512, registers=False).first_particles == 0.0


def test_estimates_count_tables_that_are_computed_between_stages():
    stages, shares = plan_stages(OptimizeSettings(particles=1024)), shares_of(1024)
    fractions = [part for index in range(len(stages)) for part in (shares.before(index), shares.done(index))]
    assert fractions == sorted(fractions)
    (between,) = [index for index in range(len(stages)) if shares.done(index) > shares.before(index)]
    assert [plan.count for plan in stages[between - 1 : between + 1]] == [256, 512]
    assert shares.done(len(stages) - 1, 1.0) == pytest.approx(1.0)


def test_with_more_threads_estimates_give_the_last_particles_a_smaller_share():
    two, eight, many = (shares_of(1024, threads=threads) for threads in (2, 8, 64))
    assert eight.before(4) > two.before(4)
    assert eight.first_particles > two.first_particles
    assert many.before(4) == eight.before(4)  # no more threads are used
    assert shares_of(1024, threads=1).before(4) == two.before(4)


def test_more_shapes_and_fewer_particles_are_expected_to_settle_later():
    def expected(particles, shapes):
        return plan_stages(OptimizeSettings(particles=particles), shapes=shapes)[-1].expected_iterations

    assert expected(1024, 10) <= expected(1024, 28) < expected(1024, 100) < expected(1024, 2000)
    assert expected(1024, 28) < expected(256, 28) < expected(64, 28)
    brief = OptimizeSettings(particles=64, settle_iterations=20)
    assert plan_stages(brief, shapes=28)[-1].expected_iterations == 20


def test_the_nearer_the_objective_is_to_rest_the_sooner_convergence_is_expected():
    recorder = RunRecorder(np.eye(4)[None], None, 1.0, None, None)
    left = []
    for objective in (0.0, 1e-2, 1.1e-2, 1.105e-2):
        recorder.record(np.array([objective, 0.0, 0.0]))
        if len(recorder.rows) > 1:
            left.append(recorder.records_to_convergence(1e-4))
    assert left[0] > left[1] > left[2] == 1


MANY = QUICK.model_copy(update={"particles": 320})
"""So many that tables of the fine meshes are needed."""


@pytest.fixture
def two_balls(make_shape):
    return [make_shape(f"r{r}", (r, r, r), spacing=r / 10.0) for r in (10.0, 12.0)]


def test_a_first_model_is_there_before_the_optimization_and_tables_of_many_particles_later(two_balls):
    solved, seen, iterations = [], [], []

    def solve(meshes, *arguments, **named):
        solved.append(len(seen))
        return solve_tables(meshes, *arguments, **named)

    def observe(frame):
        if frame.ends_stage:
            seen.append(frame.world.shape[1])
            iterations.append(frame.iteration)

    optimize(two_balls, MANY, observe=observe, solve=solve)
    assert iterations[0] == 0
    assert seen[0] == 160
    assert len(solved) == 2
    assert solved[0] == 0
    assert solved[1] == seen.count(160)


def test_a_run_cancelled_while_tables_of_many_particles_are_solved_goes_on_there(two_balls):
    kept, solved = [], []

    def solve(*arguments, **named):
        solved.append(len(kept))
        if len(solved) == 2:
            raise Cancelled
        return solve_tables(*arguments, **named)

    with pytest.raises(Cancelled):
        optimize(two_balls, MANY, device="cpu", checkpoint=kept.append, solve=solve)
    assert kept[-1].positions.shape[:2] == kept[-1].repaired.shape == (2, 160)
    resumed = optimize(two_balls, MANY, device="cpu", resume=kept[-1])
    np.testing.assert_array_equal(resumed.local, optimize(two_balls, MANY, device="cpu").local)
