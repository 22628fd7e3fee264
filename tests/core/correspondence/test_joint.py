"""Several structures of each subject, optimized together."""

import dataclasses

import numpy as np
import pytest

from homolog.correspondence import Shape, optimize
from homolog.errors import Cancelled, InputError
from homolog.settings import OptimizeSettings, Procrustes
from homolog.statistics.procrustes import align
from homolog.surfaces.mesh import joined

SETTINGS = OptimizeSettings(
    particles=48, split_iterations=10, anneal_iterations=40, settle_iterations=60, procrustes=Procrustes.RIGID
)
ANGLES = np.radians([-20.0, -8.0, 0.0, 7.0, 21.0])


def placed(degrees, shift):
    pose = np.eye(4)
    c, s = np.cos(degrees), np.sin(degrees)
    pose[:2, :2] = [[c, -s], [s, c]]
    pose[:3, 3] = shift
    return pose


def moved(shape, pose):
    """Return a shape that lies elsewhere in its file, and is aligned back."""
    field = dataclasses.replace(shape.field, index_to_world=pose @ shape.field.index_to_world)
    meshes = shape.mesh.placed(pose), shape.coarse_mesh.placed(pose)
    return Shape(shape.name, field, *meshes, np.linalg.inv(pose))


def subject(parts):
    meshes = joined([part.mesh for part in parts]), joined([part.coarse_mesh for part in parts])
    return Shape(parts[0].name, parts[0].field, *meshes, np.eye(4), parts=tuple(parts))


@pytest.fixture(scope="module")
def subjects(make_shape):
    """Return five subjects with a structure that grows in one axis, and one beside it that only turns."""
    turning = make_shape("turning", (5.0, 11.0, 8.0))
    return [
        subject(
            [
                dataclasses.replace(make_shape(f"s{k}", (12.0, 9.0, 6.0 + 0.5 * k))),
                dataclasses.replace(moved(turning, placed(angle, (25.0, 0.0, 0.0))), name=f"s{k}"),
            ]
        )
        for k, angle in enumerate(ANGLES)
    ]


@pytest.fixture(scope="module")
def result(subjects):
    return optimize(subjects, SETTINGS, device="cpu")


def test_the_particles_of_a_subject_are_those_of_its_structures(result, subjects):
    assert result.local.shape == (5, 96, 3)
    assert np.array_equal(result.local, np.concatenate([part.local for part in result.parts], axis=1))
    for number, part in enumerate(result.parts):
        for shape, points in zip(subjects, part.local, strict=True):
            field = shape.parts[number].field
            assert np.abs(field.sample_values(points)).max() < 0.2 * field.spacing


def test_subjects_are_aligned_as_wholes_and_keep_the_places_of_their_structures(result):
    moved_back = np.einsum("mij,mnj->mni", result.alignments[:, :3, :3], result.local)
    assert np.allclose(moved_back + result.alignments[:, None, :3, 3], result.world)
    centres = result.world.reshape(5, 2, 48, 3).mean(axis=2)
    assert np.allclose(np.linalg.norm(centres[:, 1] - centres[:, 0], axis=1), 25.0, atol=0.3)


def test_a_structure_that_only_turns_has_no_variation_of_its_own(result):
    varied = [align(part.local, scaling=False).var(axis=0).sum() for part in result.parts]
    assert varied[1] < 0.01 * varied[0]


def test_subjects_can_be_aligned_by_one_structure(subjects):
    first = optimize(subjects, SETTINGS, device="cpu", align_by=0)
    own = first.world[:, :48]
    assert np.allclose(align(own, scaling=False).var(axis=0).sum(), own.var(axis=0).sum(), rtol=1e-3)


def test_the_particles_of_the_other_structure_count_for_the_ensemble(result, subjects):
    alone = optimize([shape.parts[0] for shape in subjects], SETTINGS, device="cpu")
    assert not np.array_equal(alone.local, result.parts[0].local)
    assert np.allclose(alone.local, result.parts[0].local, atol=1.5)


def test_a_cancelled_run_of_several_structures_ends_as_if_it_had_not_been(result, subjects):
    saved = []

    def tick(_fraction, message):
        if message.startswith("optimizing") and len(saved) > 2:
            raise Cancelled

    with pytest.raises(Cancelled):
        optimize(subjects, SETTINGS, device="cpu", checkpoint=saved.append, tick=tick)
    again = optimize(subjects, SETTINGS, device="cpu", resume=saved[-1])
    assert np.array_equal(again.local, result.local)
    assert np.array_equal(again.world, result.world)


def test_a_checkpoint_of_one_structure_does_not_continue_several(subjects):
    saved = []
    optimize([shape.parts[0] for shape in subjects], SETTINGS, device="cpu", checkpoint=saved.append)
    with pytest.raises(InputError, match="another cohort"):
        optimize(subjects, SETTINGS, device="cpu", resume=saved[0])


def test_mirrored_subjects_stay_mirrored(subjects):
    flip = np.diag([-1.0, 1.0, 1.0, 1.0])

    def image(shape):
        field = dataclasses.replace(shape.field, index_to_world=flip @ shape.field.index_to_world)
        meshes = shape.mesh.placed(flip), shape.coarse_mesh.placed(flip)
        return Shape(shape.name, field, *meshes, shape.alignment @ flip)

    mixed = [
        dataclasses.replace(subject([image(part) for part in shape.parts]), alignment=flip)
        if k % 2
        else shape
        for k, shape in enumerate(subjects)
    ]
    both, same = (optimize(shapes, SETTINGS, device="cpu") for shapes in (mixed, subjects))
    assert (np.linalg.det(both.alignments[:, :3, :3]) < 0.0).tolist() == [False, True, False, True, False]
    assert np.allclose(both.world, same.world, atol=1e-2)
