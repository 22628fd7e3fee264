"""The registration that places the first particles."""

import numpy as np
from scipy.spatial.transform import Rotation

from homolog.correspondence.initialization.registration import (
    InitialRegistration,
    ThinPlateMap,
    registration_tree,
    shape_distances,
)
from homolog.correspondence.initialization.spreading import spread_vertices
from homolog.geometry import farthest_point_sampling
from homolog.surfaces.mesh import TriangleMesh


def test_a_smoothing_map_keeps_affine_maps_however_stiff_it_is():
    random = np.random.default_rng(0)
    control, points = random.normal(size=(30, 3)), random.normal(size=(50, 3))
    affine, shift = random.normal(size=(3, 3)), random.normal(size=3)
    moved = ThinPlateMap.fit(control, points).apply(control @ affine.T + shift, 100.0)
    np.testing.assert_allclose(moved, points @ affine.T + shift, atol=1e-8)


def test_a_map_without_smoothing_interpolates():
    control, targets = np.random.default_rng(0).normal(size=(2, 30, 3))
    moved = ThinPlateMap.fit(control, control).apply(targets, 0.0)
    np.testing.assert_allclose(moved, targets, atol=1e-7)


def test_a_smoothing_map_solves_the_thin_plate_system():
    control, targets = np.random.default_rng(1).normal(size=(2, 20, 3))
    kernel = -np.linalg.norm(control[:, None] - control[None], axis=-1) + 0.7 * np.eye(20)
    affine = np.column_stack([np.ones(20), control])
    system = np.block([[kernel, affine], [affine.T, np.zeros((4, 4))]])
    solution = np.linalg.solve(system, np.vstack([targets, np.zeros((4, 3))]))
    expected = targets - 0.7 * solution[:20]
    moved = ThinPlateMap.fit(control, control).apply(targets, 0.7)
    np.testing.assert_allclose(moved, expected, atol=1e-8)


def test_vertex_normals_of_a_sphere_point_outward(ball):
    outward = ball.mesh.vertices / np.linalg.norm(ball.mesh.vertices, axis=1, keepdims=True)
    assert (ball.mesh.vertex_normals * outward).sum(axis=1).min() > 0.98


def test_spread_points_are_farther_apart_than_random_ones():
    points = np.random.default_rng(1).normal(size=(500, 3))
    chosen = points[farthest_point_sampling(points, 20)]
    gaps = np.linalg.norm(chosen[:, None] - chosen[None], axis=-1)[np.triu_indices(20, 1)]
    some = np.linalg.norm(points[:20, None] - points[None, :20], axis=-1)[np.triu_indices(20, 1)]
    assert len(set(map(tuple, chosen))) == 20
    assert gaps.min() > 2.0 * some.min()


def test_particles_are_spread_over_the_inside_of_a_thin_bowl_as_over_its_outside(ball):
    inward = np.where(ball.mesh.vertices[:, 2:] > 0.0, [0.8, 0.8, -0.8], 1.0)
    bowl = TriangleMesh(ball.mesh.vertices * inward, ball.mesh.faces)
    inside = inward[:, 2] < 0.0
    by_paths = spread_vertices(bowl, 24, np.array([0]))
    by_straight_lines = farthest_point_sampling(bowl.vertices, 24)
    assert len(set(by_paths.tolist())) == 24
    assert 7 <= inside[by_paths].sum() <= 12  # 0.39 of the area
    assert inside[by_straight_lines].sum() < 5


def test_the_medoid_is_the_shape_in_the_middle(ellipsoid_shapes):
    distances = shape_distances([shape.coarse_mesh for shape in ellipsoid_shapes])
    assert registration_tree(*distances)[0] == 2


def tree_of(points):
    distances = np.linalg.norm(points[:, None] - points[None], axis=2)
    return registration_tree(np.arange(len(points)), distances)


def test_shapes_along_one_large_variation_are_reached_step_by_step():
    reference, parents = tree_of(np.arange(7.0)[:, None] * [1.0, 0.5])
    assert reference == 3
    assert parents.tolist() == [1, 2, 3, 3, 3, 4, 5]


def test_shapes_that_vary_in_independent_ways_are_reached_directly():
    _, parents = tree_of(np.concatenate([np.zeros((1, 6)), np.eye(6)]))
    assert parents.tolist() == [0] * 7


def test_equal_shapes_are_reached():
    reference, parents = tree_of(np.zeros((4, 2)))
    assert parents.tolist() == [reference] * 4


def test_first_particles_follow_a_known_deformation(ellipsoid_shapes):
    source = ellipsoid_shapes[0].coarse_mesh
    unit = 0.12
    plain = TriangleMesh(source.vertices / unit, source.faces)
    bent = plain.vertices.copy()
    bent[:, 2] += 6.0 * np.sin(bent[:, 0] / 50.0)
    registration = InitialRegistration([plain, TriangleMesh(bent, source.faces)], 60)
    result = registration.particles(np.tile(np.eye(4), (2, 1, 1)))
    expected = result[0].copy()
    expected[:, 2] += 6.0 * np.sin(expected[:, 0] / 50.0)
    spacing = np.sqrt(plain.area / 60)
    assert np.linalg.norm(result[1] - expected, axis=1).mean() < 0.25 * spacing
    turned = np.tile(np.eye(4), (2, 1, 1))
    turned[1, :3, :3] = Rotation.from_euler("z", 4.0, degrees=True).as_matrix()
    again = registration.particles(turned)
    assert np.linalg.norm(again[1] - expected, axis=1).mean() < 0.25 * spacing


def test_a_rough_shell_is_registered_to_the_nearest_point_of_the_same_side(ball):
    random = np.random.default_rng(0)
    sphere = ball.mesh.vertices / np.linalg.norm(ball.mesh.vertices, axis=1, keepdims=True)

    def shell():
        """A wall of two hundredths, with its rough inner side turned inside out."""
        sides = [size * (1.0 + 0.001 * random.normal(size=(len(sphere), 1))) * sphere for size in (1.0, 0.98)]
        faces = [ball.mesh.faces, ball.mesh.faces[:, ::-1] + len(sphere)]
        return TriangleMesh(25.0 * np.concatenate(sides), np.concatenate(faces))

    meshes = [shell(), shell(), shell()]
    points = InitialRegistration(meshes, 100).particles(np.tile(np.eye(4), (3, 1, 1)))
    apart = np.linalg.norm(points - points.mean(axis=0), axis=2)
    inside = np.linalg.norm(points, axis=2) < 25.0 * 0.99
    assert (inside == inside[0]).all()
    assert apart.mean() < 0.5  # a tenth of the distance between particles
