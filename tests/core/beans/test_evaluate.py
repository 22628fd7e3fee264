from dataclasses import asdict

import numpy as np

from homolog.beans.evaluate import evaluate
from homolog.beans.generate import WIDE, Bean
from homolog.beans.surface import closest_on_bean, surface_areas, surface_points


def test_perfect_correspondence_has_the_floors_figures(ideal_particles, wide_beans):
    figures = evaluate(ideal_particles, wide_beans)
    assert 0.002 < figures.leak < 0.02
    assert figures.ground_truth_r2 > 0.98
    assert figures.r2_position > 0.999
    assert figures.r2_width > 0.99
    assert figures.wall_swap == 0.0
    assert figures.normals_over_90_pairs < 0.002
    assert 0.85 < figures.slot_fill < 1.15
    assert figures.distance_max < 1e-3
    np.testing.assert_allclose(sum(figures.mode_shares), 1.0)


def test_particles_off_the_surface_are_measured(ideal_particles, wide_beans):
    moved = np.stack(
        [
            points + 0.3 * closest_on_bean(points, bean).normals
            for points, bean in zip(ideal_particles, wide_beans, strict=True)
        ]
    )
    figures = evaluate(moved, wide_beans)
    np.testing.assert_allclose(
        [figures.distance_mean, figures.distance_p95, figures.distance_max], 0.3, atol=1e-3
    )


def test_a_planted_swap_of_slot_walls_is_counted_by_pairs(ideal_particles, wide_beans):
    contacts = [
        closest_on_bean(points, bean) for points, bean in zip(ideal_particles, wide_beans, strict=True)
    ]
    wall = np.array([contact.wall for contact in contacts])
    always = np.flatnonzero((wall > 0).all(axis=0))
    particles = ideal_particles.copy()
    particles[0, always, 1] = 2.0 * wide_beans[0].position - particles[0, always, 1]
    both = np.array([contact.on_slot for contact in contacts]).astype(int)
    both_pairs = (both.sum(axis=0) * (both.sum(axis=0) - 1) // 2).sum()
    figures = evaluate(particles, wide_beans)
    assert len(always) > 10
    np.testing.assert_allclose(figures.wall_swap, len(always) * 9 / both_pairs)
    assert figures.normals_over_90_pairs > evaluate(ideal_particles, wide_beans).normals_over_90_pairs


def test_a_scrambled_shape_hides_from_leakage_but_not_from_linear_in_truth(ideal_particles, wide_beans):
    particles = ideal_particles.copy()
    particles[3] = np.random.default_rng(0).permutation(particles[3])
    figures = evaluate(particles, wide_beans)
    assert figures.leak < 0.02
    assert figures.ground_truth_r2 < 0.7
    assert figures.normals_over_90_pairs > 0.05
    assert figures.var_per_particle > 100.0


def test_particles_that_stay_out_of_the_slot_show_as_no_fill(wide_beans):
    below = surface_points(wide_beans[0], 2000)[0]
    below = below[below[:, 2] < -1.0]
    jitter = np.random.default_rng(0).normal(0.0, 1e-3, (10, len(below), 3))
    figures = evaluate(below + jitter, wide_beans)
    assert figures.slot_fill == 0.0
    assert figures.wall_swap == 0.0
    assert figures.var_per_particle < 1e-4


def test_shares_are_of_the_total_variance_whatever_its_size(ideal_particles, wide_beans):
    figures = asdict(evaluate(ideal_particles, wide_beans))
    mean = ideal_particles.mean(axis=0)
    doubled = asdict(evaluate(mean + 2.0 * (ideal_particles - mean), wide_beans))
    for name in ("leak", "ground_truth_r2", "r2_position", "r2_width"):
        np.testing.assert_allclose(figures[name], doubled[name])
    np.testing.assert_allclose(doubled["var_per_particle"], 4.0 * figures["var_per_particle"])


def _jittered(points, count):
    return points + np.random.default_rng(0).normal(0.0, 1e-6, (count, *points.shape))


def test_a_hole_of_known_radius_is_the_largest_gap(still_beans):
    dense = surface_points(still_beans[0], 6000)[0]
    particles = dense[np.linalg.norm(dense - [0.0, 0.0, -20.0], axis=1) > 9.0]
    figures = evaluate(_jittered(particles, 6), still_beans)
    spacing = np.sqrt(surface_areas(still_beans[0])[0] / len(particles))
    np.testing.assert_allclose(figures.cover_max * spacing, 9.0, atol=0.8)


def test_the_opposite_wall_of_a_thin_slot_is_no_neighbour():
    beans = [Bean(WIDE, 1e-6 * step, 3.0 + 1e-6 * step**2) for step in range(4)]
    walls = np.radians(70.0) * np.array([-1.0, 1.0])
    walls = np.stack([0.0 * walls, np.sin(walls), -np.cos(walls)], axis=1)
    walls = beans[0].slot_centre + beans[0].slot_axes * walls
    lattice = surface_points(beans[0], 4000)[0]
    outside = lattice[lattice[:, 2] < 5.0][::8]
    alone = evaluate(_jittered(outside, 4), beans)
    with_walls = evaluate(_jittered(np.concatenate([walls, outside]), 4), beans)
    assert np.linalg.norm(walls[1] - walls[0]) < 6.0
    assert with_walls.nn_cv > alone.nn_cv + 0.05


def test_still_particles_swap_and_disagree_nowhere(still_beans):
    figures = evaluate(_jittered(surface_points(still_beans[0], 1000)[0], 6), still_beans)
    assert figures.wall_swap == 0.0
    assert figures.normals_over_90_pairs == 0.0
