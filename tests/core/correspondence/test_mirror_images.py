"""Shapes whose alignment is a reflection give what their mirror images give."""

from dataclasses import replace

import numpy as np
import pytest

from homolog.correspondence import InitialParticles, initialize_fit, optimize, repair
from homolog.geometry import transform_points
from homolog.settings import OptimizeSettings
from homolog.surfaces.mirroring import MIRROR

SETTINGS = OptimizeSettings(particles=16, split_iterations=5, anneal_iterations=10, settle_iterations=10)
MIRRORED = np.array([False, True, False, True, True])


def flipped(shape):
    """Return the shape as a file of the other side holds it, with an alignment that mirrors it back."""
    return replace(
        shape,
        field=shape.field.mirrored,
        mesh=shape.mesh.placed(MIRROR),
        coarse_mesh=shape.coarse_mesh.placed(MIRROR),
        alignment=shape.alignment @ MIRROR,
    )


def signed(local):
    return np.where(MIRRORED[:, None, None], local * [-1.0, 1.0, 1.0], local)


@pytest.fixture(scope="module")
def placed(ellipsoid_shapes):
    """Return shapes that lie beside the plane by which they are mirrored."""
    shift = np.eye(4)
    shift[:3, 3] = (5.0, 1.0, -2.0)
    return [replace(ellipsoid_shape, alignment=shift) for ellipsoid_shape in ellipsoid_shapes]


@pytest.fixture(scope="module")
def both_sides(placed):
    return [flipped(item) if odd else item for item, odd in zip(placed, MIRRORED, strict=True)]


@pytest.fixture(scope="module")
def results(placed, both_sides):
    return optimize(placed, SETTINGS), optimize(both_sides, SETTINGS)


def test_mirrored_shapes_give_the_same_world_particles(results):
    one_side, both = results
    assert np.array_equal(one_side.world, both.world)
    assert np.array_equal(one_side.normals, both.normals)


def test_local_particles_lie_in_the_frame_of_the_file(results):
    one_side, both = results
    assert np.array_equal(both.local, signed(one_side.local))


def test_alignments_are_reflections_that_lead_from_local_to_world(results):
    result = results[1]
    assert np.array_equal(np.linalg.det(result.alignments[:, :3, :3]) < 0.0, MIRRORED)
    assert np.allclose(transform_points(result.alignments, result.local), result.world, atol=1e-12)


def test_frames_tell_the_same_alignments(both_sides):
    frames = []
    result = optimize(both_sides, SETTINGS, observe=frames.append)
    assert np.allclose(frames[-1].alignments, result.alignments)


def test_a_landmark_of_a_mirrored_shape_is_met_there(placed):
    marked = [replace(item, landmarks=item.mesh.vertices[:1]) for item in placed]
    both = [
        replace(flipped(item), landmarks=item.mesh.vertices[:1] @ MIRROR[:3, :3]) if odd else item
        for item, odd in zip(marked, MIRRORED, strict=True)
    ]
    assert np.array_equal(optimize(both, SETTINGS).world, optimize(marked, SETTINGS).world)


def test_a_repair_of_a_mirrored_shape_is_that_of_its_image(placed, both_sides, results):
    movable = np.zeros(results[0].world.shape[:2], dtype=bool)
    movable[1, :4] = True
    there = repair(placed, SETTINGS, results[0].local, movable)
    here = repair(both_sides, SETTINGS, results[1].local, movable)
    assert np.array_equal(here.local, signed(there.local))


def test_a_new_shape_starts_from_known_ones_of_the_other_side(placed, both_sides, results):
    known = np.array([True, True, True, True, False])
    there = initialize_fit(placed, results[0].local[known], known)
    here = initialize_fit(both_sides, results[1].local[known], known)
    assert np.array_equal(here.local, signed(there.local))


def test_particles_to_begin_with_are_taken_in_the_frame_of_the_file(placed, both_sides, results):
    there = optimize(placed, SETTINGS, initial=InitialParticles(results[0].local))
    here = optimize(both_sides, SETTINGS, initial=InitialParticles(results[1].local))
    assert np.array_equal(here.local, signed(there.local))
