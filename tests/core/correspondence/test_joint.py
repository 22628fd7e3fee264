"""Several structures of each subject, optimized together."""

import dataclasses

import numpy as np
import pytest

from homolog.correspondence import InitialParticles, Shape, StructureShapes, optimize, optimize_jointly
from homolog.errors import Cancelled, InputError
from homolog.settings import OptimizeSettings, Procrustes
from homolog.statistics.procrustes import align
from homolog.statistics.relative_pose import relative_poses
from homolog.surfaces.mesh import joined

SETTINGS = OptimizeSettings(
    particles=48, split_iterations=10, anneal_iterations=40, settle_iterations=60, procrustes=Procrustes.RIGID
)
BRIEF = SETTINGS.model_copy(update={"split_iterations": 5, "anneal_iterations": 10, "settle_iterations": 20})
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


def whole(parts, alignment):
    meshes = joined([part.mesh for part in parts]), joined([part.coarse_mesh for part in parts])
    return Shape(parts[0].name, parts[0].field, *meshes, alignment)


def together(subjects, *, counts=(48, 48), settings=SETTINGS, sides=None, initial=(None, None), **options):
    """Optimize subjects, each of which has a shape or None for each structure."""
    structures = [
        StructureShapes(
            [shape for shape in shapes if shape is not None],
            settings.model_copy(update={"particles": count}),
            own,
        )
        for shapes, count, own in zip(zip(*subjects, strict=True), counts, initial, strict=True)
    ]
    wholes = [
        whole(parts, (sides or {}).get(parts[0].name, np.eye(4))) for parts in subjects if None not in parts
    ]
    return optimize_jointly(wholes, structures, device="cpu", **options)


@pytest.fixture(scope="module")
def subjects(make_shape):
    """Return five subjects with a structure that grows in one axis, and one beside it that only turns."""
    turning = make_shape("turning", (5.0, 11.0, 8.0))
    return [
        (
            make_shape(f"s{k}", (12.0, 9.0, 6.0 + 0.5 * k)),
            dataclasses.replace(moved(turning, placed(angle, (25.0, 0.0, 0.0))), name=f"s{k}"),
        )
        for k, angle in enumerate(ANGLES)
    ]


@pytest.fixture(scope="module")
def result(subjects):
    return together(subjects)


def test_the_particles_of_a_subject_are_those_of_its_structures(result, subjects):
    assert result.local.shape == (5, 96, 3)
    assert np.array_equal(result.local, np.concatenate([part.local for part in result.parts], axis=1))
    for number, part in enumerate(result.parts):
        for parts, points in zip(subjects, part.local, strict=True):
            field = parts[number].field
            assert np.abs(field.sample_values(points)).max() < 0.2 * field.spacing


def test_subjects_are_aligned_as_wholes_and_keep_the_places_of_their_structures(result):
    moved_back = np.einsum("mij,mnj->mni", result.alignments[:, :3, :3], result.local)
    assert np.allclose(moved_back + result.alignments[:, None, :3, 3], result.world)
    centres = result.world.reshape(5, 2, 48, 3).mean(axis=2)
    assert np.allclose(np.linalg.norm(centres[:, 1] - centres[:, 0], axis=1), 25.0, atol=0.3)


def test_a_structure_that_only_turns_has_no_variation_of_its_own(result):
    varied = [align(part.local, scaling=False).var(axis=0).sum() for part in result.parts]
    assert varied[1] < 0.01 * varied[0]


def test_growth_and_turn_are_modes_of_their_own(make_shape):
    turning = make_shape("turning", (5.0, 11.0, 8.0))
    pairs = [
        (
            make_shape(f"s{k}", (12.0, 9.0, 6.0 + 0.5 * k)),
            dataclasses.replace(moved(turning, placed(angle, (25.0, 0.0, 0.0))), name=f"s{k}"),
        )
        for k, angle in enumerate(np.radians([-12.0, 14.0, -4.0, 14.0, -12.0]))  # not related to growth
    ]
    planted = together(pairs)
    poses = relative_poses(np.split(planted.world, 2, axis=1), ["growing", "turning"])
    parts = poses.components()
    share = dict(zip(parts.parts, parts.variances / parts.variances.sum(), strict=True))
    assert share["shape turning"] < 0.01
    for row in parts.shares[:2]:
        assert row.max() > 0.99
    assert {parts.parts[int(row.argmax())] for row in parts.shares[:2]} == {"pose turning", "shape growing"}


def test_subjects_can_be_aligned_by_one_structure(subjects):
    first = together(subjects, align_by=0)
    own = first.world[:, :48]
    assert np.allclose(align(own, scaling=False).var(axis=0).sum(), own.var(axis=0).sum(), rtol=1e-3)


def test_the_particles_of_the_other_structure_count_for_the_ensemble(result, subjects):
    alone = optimize([parts[0] for parts in subjects], SETTINGS, device="cpu")
    assert not np.array_equal(alone.local, result.parts[0].local)
    assert np.allclose(alone.local, result.parts[0].local, atol=1.5)


def test_a_cancelled_run_of_several_structures_ends_as_if_it_had_not_been(result, subjects):
    saved = []

    def tick(_fraction, message):
        if message.startswith("optimizing") and len(saved) > 2:
            raise Cancelled

    with pytest.raises(Cancelled):
        together(subjects, checkpoint=saved.append, tick=tick)
    again = together(subjects, resume=saved[-1])
    assert np.array_equal(again.local, result.local)
    assert np.array_equal(again.world, result.world)


def test_a_checkpoint_of_one_structure_does_not_continue_several(subjects):
    saved = []
    optimize([parts[0] for parts in subjects], SETTINGS, device="cpu", checkpoint=saved.append)
    with pytest.raises(InputError, match="another cohort"):
        together(subjects, resume=saved[0])


def test_mirrored_subjects_stay_mirrored(subjects):
    flip = np.diag([-1.0, 1.0, 1.0, 1.0])

    def image(shape):
        field = dataclasses.replace(shape.field, index_to_world=flip @ shape.field.index_to_world)
        meshes = shape.mesh.placed(flip), shape.coarse_mesh.placed(flip)
        return Shape(shape.name, field, *meshes, shape.alignment @ flip)

    mixed = [tuple(map(image, parts)) if number % 2 else parts for number, parts in enumerate(subjects)]
    both, same = together(mixed, sides={"s1": flip, "s3": flip}), together(subjects)
    assert (np.linalg.det(both.alignments[:, :3, :3]) < 0.0).tolist() == [False, True, False, True, False]
    assert np.allclose(both.world, same.world, atol=1e-2)


def test_structures_have_as_many_particles_as_each_needs(subjects):
    saved = []
    few = together(subjects, counts=(300, 24), settings=BRIEF, checkpoint=saved.append)
    assert [part.local.shape[1] for part in few.parts] == [300, 24]
    assert few.world.shape == (5, 324, 3)
    early = next(item for item in saved if item.positions.shape[1] == 150)
    assert early.others[0].positions.shape[1] == 24
    again = together(subjects, counts=(300, 24), settings=BRIEF, resume=early)
    assert np.array_equal(again.local, few.local)


def test_a_subject_takes_part_with_the_structures_that_it_has(subjects):
    lacking = [*subjects[:4], (subjects[4][0], None)]
    some = together(lacking)
    assert some.world.shape == (4, 96, 3)
    assert [part.local.shape for part in some.parts] == [(5, 48, 3), (4, 48, 3)]
    assert np.array_equal(some.local[:, :48], some.parts[0].local[:4])
    without = together(subjects[:4])
    assert not np.array_equal(without.local, some.local)


def test_new_subjects_are_fitted_to_particles_that_stay(subjects):
    before = together(subjects[:4])
    known = np.array([True] * 4 + [False])
    start = [
        InitialParticles(np.concatenate([part.local, part.local[:1]]), np.repeat(~known[:, None], 48, axis=1))
        for part in before.parts
    ]
    after = together(subjects, initial=start)
    assert np.array_equal(after.local[:4], before.local)
    assert not np.array_equal(after.local[4], before.local[0])
