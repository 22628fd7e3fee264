"""Kernels one by one: surfaces, normals on the sphere, sampling forces."""

import numpy as np
import pytest
import pyvista as pv
import warp as wp
from scipy.spatial import cKDTree

from homolog.correspondence.engine import Engine
from homolog.correspondence.entropy.terms import Term
from homolog.correspondence.fields import field_array, opening_array
from homolog.correspondence.kernels import particles as kernels
from homolog.correspondence.kernels import step as step_kernels
from homolog.correspondence.kernels.functions import stencil_cache
from homolog.correspondence.kernels.sampling import PairCodes
from homolog.correspondence.launcher import Launcher
from homolog.correspondence.prepared_cohort import MEAN_AREA, prepare_cohort
from homolog.correspondence.schedule import Weights
from homolog.correspondence.surface_sets import (
    Similarity,
    build_surface_set,
    face_neighbours,
)
from homolog.settings import OptimizeSettings
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.nearest import nearest_faces

LAUNCHER = Launcher("cpu", threads=1)


def vectors(values):
    return wp.array(np.asarray(values, dtype=np.float32).reshape(-1, 3), dtype=wp.vec3, device="cpu")


def on_sphere(count, seed=0):
    points = np.random.default_rng(seed).normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def projected(shape, placement, points, steps=3, cached=True):
    fields = field_array([shape], [placement], "cpu")
    positions = vectors(placement.apply(points))
    normals = wp.zeros(len(points), dtype=wp.vec3, device="cpu")
    shape_operators = wp.zeros(len(points), dtype=wp.mat33, device="cpu")
    free = wp.full(len(points), 1, dtype=int, device="cpu")
    opening_fields = opening_array([shape], [placement], 1.0, "cpu")
    openings = flat_openings(len(points))
    caches = [stencil_cache(len(points) if cached else 0, "cpu") for _ in range(2)]
    given, made = (
        [len(points), steps, 0, free, fields, opening_fields, *caches],
        [positions, normals, shape_operators, openings],
    )
    LAUNCHER(kernels.project, len(points), [*given, *made])
    return tuple(item.numpy() for item in made)


def flat_openings(count):
    return wp.zeros(count, dtype=wp.vec4, device="cpu")


def unmoved(shapes):
    poses = np.zeros(shapes, dtype=kernels.Pose.numpy_dtype())
    poses["linear"] = poses["rotation"] = np.eye(3)
    return wp.array(poses, dtype=kernels.Pose, device="cpu")


def turned(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def test_projection_reaches_the_surface_with_its_normal_and_curvature(ball):
    placement = Similarity(0.5 * turned(0.7), np.array([3.0, -2.0, 1.0]))
    positions, normals, shape_operators, _ = projected(ball, placement, 10.8 * on_sphere(200))
    radial = positions - placement.origin
    np.testing.assert_allclose(np.linalg.norm(radial, axis=1), 5.0, atol=0.01)
    outward = radial / np.linalg.norm(radial, axis=1, keepdims=True)
    np.testing.assert_allclose(normals, outward, atol=2e-3)
    flat = np.eye(3) - outward[:, :, None] * outward[:, None, :]
    np.testing.assert_allclose(shape_operators, flat / 5.0, atol=0.02)


def test_the_opening_angle_comes_with_its_gradient(ball):
    placement = Similarity(0.5 * turned(0.7), np.array([3.0, -2.0, 1.0]))
    points = 10.0 * on_sphere(50)
    openings = projected(ball, placement, points, steps=0)[3]
    assert (openings[:, 3] < np.pi).all()  # a ball is convex
    ahead, behind = (projected(ball, placement, r * on_sphere(50), steps=0)[3] for r in (10.05, 9.95))
    radial = on_sphere(50) @ turned(0.7).T
    slopes = (openings[:, :3] * radial).sum(axis=1)
    np.testing.assert_allclose(slopes, (ahead[:, 3] - behind[:, 3]) / (0.5 * 0.1), rtol=0.01)


def test_the_walk_ends_on_the_nearest_face(ball):
    placement = Similarity(np.eye(3), np.zeros(3))
    level = build_surface_set([ball.mesh], [None], [placement], "cpu")
    points = 10.0 * on_sphere(100)
    faces = wp.zeros(len(points), dtype=int, device="cpu")
    feet = wp.zeros(len(points), dtype=kernels.SurfacePoint, device="cpu")
    places = [level.surfaces, vectors(points), vectors(points / 10.0)]
    LAUNCHER(kernels.locate, len(points), [len(points), *places, faces, feet])
    corners = ball.mesh.vertices[ball.mesh.faces]
    samples = np.einsum("sk,fkd->fsd", np.random.default_rng(1).dirichlet(np.ones(3), 200), corners)
    nearest, _ = cKDTree(samples.reshape(-1, 3)).query(points)
    result = np.linalg.norm(points - feet.numpy()["position"], axis=1)
    assert (result <= nearest + 1e-4).all()


def test_a_foot_follows_its_particle_around_the_rim_of_a_slab_though_the_particle_is_below_the_mesh():
    slab = pv.Box((-10.0, 10.0, -10.0, 10.0, -3.0, 0.0), level=9).triangulate().clean()
    mesh = TriangleMesh(np.asarray(slab.points, dtype=np.float64), slab.faces.reshape(-1, 4)[:, 1:])
    level = build_surface_set([mesh], [None], [Similarity(np.eye(3), np.zeros(3))], "cpu")
    start = np.array([[9.5, 0.3, -0.1]])
    faces = wp.array(nearest_faces(mesh, start, np.array([[0.0, 0.0, 1.0]])), dtype=int, device="cpu")
    feet = wp.zeros(1, dtype=kernels.SurfacePoint, device="cpu")
    for depth in np.arange(0.1, 1.6, 0.1):  # down the side, a little within the slab
        places = [level.surfaces, vectors([[9.7, 0.3, -depth]]), vectors([[1.0, 0.0, 0.0]])]
        LAUNCHER(kernels.locate, 1, [1, *places, faces, feet])
    np.testing.assert_allclose(feet.numpy()["position"][0], [10.0, 0.3, -1.5], atol=1e-4)


def test_faces_compared_by_a_kernel_are_those_of_the_search_tree(ball):
    level = build_surface_set([ball.mesh], [None], [Similarity(np.eye(3), np.zeros(3))], "cpu")
    points, outward = 9.7 * on_sphere(200), on_sphere(200, seed=1)  # most normals agree with no near face
    outward[:100] = points[:100] / 9.7 * np.where(np.arange(100) % 2, 1.0, -1.0)[:, None]
    points, normals = vectors(points), vectors(outward)
    faces = wp.zeros(200, dtype=int, device="cpu")
    LAUNCHER(kernels.find_faces, 200, [200, level.surfaces, points, normals, faces])
    expected = nearest_faces(ball.mesh, points.numpy(), normals.numpy())
    np.testing.assert_array_equal(faces.numpy(), expected)


def test_face_neighbors_share_an_edge(ball):
    across = next(face_neighbours([ball.mesh]))
    for corner in range(3):
        shared = [
            len(set(mine) & set(theirs))
            for mine, theirs in zip(ball.mesh.faces, ball.mesh.faces[across[:, corner]], strict=True)
        ]
        assert set(shared) == {2}


def means_and_logs(means, *normals, openings=None):
    """Fréchet means, started from the given ones, and the Logs of each shape's normals."""
    layout = kernels.Layout()
    layout.per_shape, layout.shapes = len(means), len(normals)
    held, given = vectors(means), vectors(np.concatenate(normals))
    angles = flat_openings(given.size)
    if openings is not None:
        angles.numpy()[:, 3] = np.ravel(openings)
    centred, logs = (wp.zeros(given.size, dtype=wp.vec3, device="cpu") for _ in range(2))
    LAUNCHER(
        step_kernels.mean_normals,
        len(means),
        [layout, unmoved(len(normals)), given, given, angles, held, centred, logs],
    )
    return held.numpy(), logs.numpy().reshape(len(normals), -1, 3)


def across(means, seed):
    side = np.cross(means, on_sphere(len(means), seed))
    return side / np.linalg.norm(side, axis=1, keepdims=True)


@pytest.mark.parametrize("angle", [0.0, 1e-4, 0.01, 0.5, np.pi / 2])
def test_the_log_of_a_normal_is_as_long_as_its_angle_and_in_the_tangent_plane(angle):
    means = on_sphere(50)
    side = across(means, 1)
    pair = [np.cos(angle) * means + sign * np.sin(angle) * side for sign in (1.0, -1.0)]
    result, logs = means_and_logs(means, *pair)
    np.testing.assert_allclose(result, means, atol=1e-5)
    np.testing.assert_allclose(logs[0], angle * side, atol=4e-4)


@pytest.mark.parametrize("angle", [2.0, 3.0, np.pi - 0.03])
def test_the_log_keeps_its_length_near_the_opposite_normal(angle):
    start = on_sphere(50)
    far = np.cos(angle) * start + np.sin(angle) * across(start, 1)
    means, logs = means_and_logs(start, *[start] * 200, far)
    apart = np.arccos(np.clip((means * far).sum(axis=1), -1.0, 1.0))
    assert apart.min() > angle - 0.05
    np.testing.assert_allclose(np.linalg.norm(logs[-1], axis=1), apart, atol=5e-3)
    np.testing.assert_allclose((logs[-1] * means).sum(axis=1), 0.0, atol=5e-3)


def test_the_mean_normal_is_the_frechet_mean():
    middle = on_sphere(50)
    side, up = across(middle, 1), across(middle, 2)
    normals = [
        np.cos(a) * middle + np.sin(a) * (side if k % 2 else up) for k, a in enumerate((0.3, 0.8, -0.5))
    ]
    means = middle
    for _ in range(20):
        means, logs = means_and_logs(means, *normals)
    _, logs = means_and_logs(means, *normals)
    np.testing.assert_allclose(logs.sum(axis=0), 0.0, atol=1e-5)


def test_opening_angles_lie_centred_along_the_mean_normal():
    middle = on_sphere(50)
    openings = np.random.default_rng(1).uniform(0.0, 6.0, size=(3, 50))
    means, logs = means_and_logs(middle, middle, middle, middle, openings=openings)
    expected = (openings - openings.mean(axis=0))[..., None] * means
    np.testing.assert_allclose(logs, expected, atol=1e-5)


def test_opposite_normals_give_finite_logs():
    middle = on_sphere(50)
    means, logs = means_and_logs(middle, middle, -middle)
    assert np.isfinite(means).all()
    assert np.isfinite(logs).all()


def pulled_back(means, normals, gradients):
    """(dLog)' g through the combine kernel, with unit curvature and nothing else."""
    count = len(means)
    layout = kernels.Layout()
    layout.per_shape, layout.shapes = count, 1
    parameters = np.zeros(1, dtype=kernels.StepParameters.numpy_dtype())
    parameters["step"], parameters["normals_weight"] = 1.0, -1.0
    even = kernels.Surface()
    even.size = 1.0
    zero = vectors(np.zeros((count, 3)))
    out = wp.zeros(count, dtype=wp.vec3, device="cpu")
    shape_operators = wp.array(
        np.tile(np.eye(3, dtype=np.float32), (count, 1, 1)), dtype=wp.mat33, device="cpu"
    )
    LAUNCHER(
        step_kernels.combine,
        count,
        [
            layout,
            wp.array(parameters, dtype=kernels.StepParameters, device="cpu"),
            wp.zeros(1, dtype=int, device="cpu"),
            wp.full(count, 1, dtype=int, device="cpu"),
            wp.zeros(1, dtype=float, device="cpu"),
            wp.array([even], dtype=kernels.Surface, device="cpu"),
            unmoved(1),
            vectors(normals),
            vectors(means),
            shape_operators,
            flat_openings(count),
            zero,
            zero,
            vectors(gradients),
            out,
        ],
    )
    return out.numpy()


@pytest.mark.parametrize("angle", [0.05, 0.6, 1.5, 2.5])
def test_the_gradient_of_the_normals_matches_finite_differences(angle):
    def log(mean, normal):
        c = (mean * normal).sum(axis=1, keepdims=True)
        return np.arccos(c) / np.sqrt(1.0 - c * c) * (normal - c * mean)

    means, gradients = on_sphere(60), on_sphere(60, seed=2)
    normals = np.cos(angle) * means + np.sin(angle) * across(means, 1)
    along = across(normals, 3)
    eps = 1e-5
    moved = [np.cos(eps) * normals + sign * np.sin(eps) * along for sign in (1.0, -1.0)]
    difference = ((log(means, moved[0]) - log(means, moved[1])) * gradients).sum(axis=1) / (2 * eps)
    analytic = (pulled_back(means, normals, gradients) * along).sum(axis=1)
    np.testing.assert_allclose(analytic, difference, rtol=2e-3, atol=2e-3)


def test_kept_coefficients_are_replaced_when_a_particle_leaves_its_cell(ball):
    placement = Similarity(np.eye(3), np.zeros(3))
    points = 12.0 * on_sphere(50)  # several cells from the surface: each Newton step enters another
    for kept, read in zip(
        projected(ball, placement, points), projected(ball, placement, points, cached=False), strict=True
    ):
        np.testing.assert_array_equal(kept, read)


def test_kept_codes_give_the_particles_that_the_tables_give(ball):
    cohort = prepare_cohort([ball, ball], OptimizeSettings(particles=64), device="cpu")
    points = np.stack([cohort.to_optimizer[0].apply(10.0 * on_sphere(64, seed=5))] * 2)
    ended = []
    for keeps in (True, False):
        engine = Engine(
            cohort.fields,
            cohort.opening_fields,
            cohort.surface_set(64),
            points,
            geodesic=True,
            area=MEAN_AREA,
            launcher=LAUNCHER,
        )
        if not keeps:
            engine.sampling.known = wp.zeros((engine.total, 0), dtype=PairCodes, device="cpu")
        engine.start_stage([Weights(Term(0.02, 1.0), Term(0.05, 0.1), 0.5)] * 20)
        for _ in range(4):
            engine.iterate()
        ended.append(engine.host_positions())
    assert np.abs(ended[0] - points).max() > 1.0
    np.testing.assert_array_equal(*ended)


@pytest.mark.parametrize("method", ["geodesic", "euclidean"])
def test_the_sampling_force_matches_finite_differences_of_the_sampling_energy(ball, method):
    cohort = prepare_cohort([ball, ball], OptimizeSettings(method=method, particles=64), device="cpu")
    points = np.stack([cohort.to_optimizer[0].apply(10.0 * on_sphere(64, seed=5))] * 2)

    def sampled(positions, widths=None, rounds=40):
        """Energy, forces, widths and normals, the widths at their fixed point."""
        engine = Engine(
            cohort.fields,
            cohort.opening_fields,
            cohort.surface_set(64),
            positions,
            geodesic=cohort.geodesic,
            area=MEAN_AREA,
            launcher=LAUNCHER,
        )
        sampling = engine.sampling
        if widths is not None:
            sampling.widths.assign(widths)
        engine.locate()
        sampling.rebuild_neighbour_lists(engine.positions, engine.faces, engine.closest)
        for _ in range(rounds):
            sampling.compute_forces(engine.positions, engine.normals, engine.faces, engine.closest)
            sampling.widths.assign(sampling.next_widths)
        forces = sampling.forces.numpy().reshape(2, -1, 3)
        energy = sampling.energies.numpy().sum(dtype=float)
        return energy, forces, sampling.widths.numpy(), engine.host_normals()

    _, forces, widths, normals = sampled(points)
    side = np.cross(normals, on_sphere(64, seed=6)[None])
    eps = 0.02
    for particle in (0, 7, 21, 40):
        values = []
        for sign in (1.0, -1.0):
            moved = points.copy()
            moved[0, particle] += sign * eps * side[0, particle]
            values.append(sampled(moved, widths, rounds=12)[0])
        difference = (values[0] - values[1]) / (2 * eps)
        expected = -float((forces[0, particle] * side[0, particle]).sum())
        scale = float(np.linalg.norm(forces[0, particle])) + 0.05
        assert expected == pytest.approx(difference, abs=0.06 * scale)


def test_threads_pass_the_interpreter_lock_on_sooner_only_while_a_launcher_with_many_is_open():
    import sys

    usual = sys.getswitchinterval()
    first, second = Launcher("cpu", threads=3), Launcher("cpu", threads=3)
    first.close()
    during = sys.getswitchinterval()
    second.close()
    assert during < usual
    assert sys.getswitchinterval() == usual
