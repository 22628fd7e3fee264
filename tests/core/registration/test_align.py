from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from homolog.cohort import Subject
from homolog.errors import Cancelled, InputError
from homolog.geometry import rotation_of
from homolog.grooming import groom_subject
from homolog.progress import no_tick
from homolog.registration import align
from homolog.registration.align import register
from homolog.registration.icp import Fit, OrientedPoints, candidates, oriented_points, registered
from homolog.registration.notes import Findings, notes_on
from homolog.registration.orientations import choose
from homolog.registration.typicality import odd_ones
from homolog.settings import Alignment, GroomSettings
from homolog.surfaces.mesh import TriangleMesh


@pytest.fixture(scope="module")
def paw(tmp_path_factory):
    """A shape without any symmetry: an ellipsoid with two bumps of different size."""
    import SimpleITK

    points = np.stack(np.meshgrid(*[np.arange(-16.0, 17.0)] * 3, indexing="ij"), axis=-1)
    mask = ((points / [12.0, 8.0, 5.0]) ** 2).sum(axis=-1) < 1.0
    mask |= np.linalg.norm(points - [7.0, 5.0, 3.0], axis=-1) < 4.5
    mask |= np.linalg.norm(points - [-6.0, 3.0, -3.0], axis=-1) < 3.5
    path = tmp_path_factory.mktemp("paw") / "paw.nrrd"
    SimpleITK.WriteImage(SimpleITK.GetImageFromArray(mask.astype(np.uint8).T), str(path))
    return groom_subject(Subject("paw", path), GroomSettings(mesh_edge=1.0))


def moved(subject, turn, shift, scale=1.0):
    def move(mesh):
        return TriangleMesh(scale * mesh.vertices @ turn.T + shift, mesh.faces)

    return replace(subject, mesh=move(subject.mesh), coarse_mesh=move(subject.coarse_mesh))


def placed(subject, pose):
    return subject.mesh.vertices @ pose[:3, :3].T + pose[:3, 3]


@pytest.fixture
def two(paw):
    turn = Rotation.from_rotvec([0.2, -0.3, 0.25]).as_matrix()
    return [paw, moved(paw, turn, [100.0, -50.0, 20.0])]


def test_none_leaves_every_subject_where_it_is(two):
    poses = align(two, GroomSettings(alignment=Alignment.NONE))
    assert np.allclose(poses, np.eye(4))


def test_center_puts_the_surfaces_middle_at_the_origin_and_turns_nothing(two):
    for item, pose in zip(two, align(two, GroomSettings(alignment=Alignment.CENTER)), strict=True):
        assert np.allclose(pose[:3, :3], np.eye(3))
        assert np.linalg.norm(placed(item, pose).mean(axis=0)) < 0.2


@pytest.mark.parametrize("alignment", [Alignment.AXES, Alignment.ICP])
@pytest.mark.parametrize("vector", [(0.2, -0.3, 0.25), (0.0, 0.0, 3.0), (2.0, 1.0, -1.5)])
def test_axes_and_icp_undo_any_motion(paw, alignment, vector):
    other = moved(paw, Rotation.from_rotvec(vector).as_matrix(), np.array([100.0, -50.0, 20.0]))
    poses = align([paw, other], GroomSettings(alignment=alignment))
    assert np.abs(placed(paw, poses[0]) - placed(other, poses[1])).max() < 0.05


def test_icp_keeps_the_given_orientation_of_a_nearly_symmetric_shape(paw):
    """A shape and its half-turn fit about as well: the one that the user gave stays."""
    y_turn = np.diag([-1.0, 1.0, -1.0])
    double = moved(paw, np.eye(3), np.zeros(3))
    vertices = np.concatenate([paw.coarse_mesh.vertices, (paw.coarse_mesh.vertices - 16.0) @ y_turn + 16.0])
    faces = np.concatenate([paw.coarse_mesh.faces, paw.coarse_mesh.faces + len(paw.coarse_mesh.vertices)])
    double = replace(double, coarse_mesh=TriangleMesh(vertices, faces))
    noise = np.random.default_rng(3).normal(0.0, 0.4, vertices.shape)
    rough = replace(double, coarse_mesh=TriangleMesh(vertices + noise, faces))
    for pose in align([double, rough], GroomSettings()):
        assert np.trace(pose[:3, :3]) > 2.9


def test_scaling_is_in_the_transform_only_and_makes_sizes_equal(paw):
    large = moved(paw, np.eye(3), np.zeros(3), 1.5)
    poses = align([paw, large], GroomSettings(scaling=True))
    scales = np.cbrt(np.linalg.det(poses[:, :3, :3]))
    assert scales == pytest.approx([np.sqrt(1.5), 1.0 / np.sqrt(1.5)], rel=1e-6)
    assert np.abs(placed(paw, poses[0]) - placed(large, poses[1])).max() < 0.05
    assert np.cbrt(np.linalg.det(align([paw, large], GroomSettings())[:, :3, :3])) == pytest.approx(1.0)


def test_scaling_without_alignment_keeps_each_middle(paw):
    large = moved(paw, np.eye(3), np.array([5.0, 6.0, 7.0]), 1.5)
    poses = align([paw, large], GroomSettings(alignment=Alignment.NONE, scaling=True))
    for item, pose in zip([paw, large], poses, strict=True):
        middle = item.coarse_mesh.vertices.mean(axis=0)
        assert np.allclose(pose[:3, :3] @ middle + pose[:3, 3], middle)


def test_a_cohort_of_one_is_its_own_reference(paw):
    (pose,) = align([paw], GroomSettings())
    assert np.allclose(pose[:3, :3], np.eye(3), atol=1e-6)


def test_rotations_are_proper(two):
    for alignment in Alignment:
        for pose in align(two, GroomSettings(alignment=alignment)):
            assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)
            assert np.allclose(pose[3], [0.0, 0.0, 0.0, 1.0])


def test_aligning_can_be_cancelled(two):
    def stop(fraction, message):
        raise Cancelled

    with pytest.raises(Cancelled):
        align(two, GroomSettings(), stop)


@pytest.mark.parametrize(("scale", "message"), [(1e-3, "1000 times as small"), (1e3, "1000 times as large")])
def test_a_shape_in_another_unit_is_refused_by_name(paw, scale, message):
    others = [replace(moved(paw, np.eye(3), np.zeros(3), size), name="other") for size in (0.5, 1, 1, 1, 2)]
    odd = replace(moved(paw, np.eye(3), np.zeros(3), scale), name="odd")
    with pytest.raises(InputError, match=f"odd: is {message} .* in mm"):
        align([*others, odd], GroomSettings())
    assert len(align(others, GroomSettings(alignment=Alignment.CENTER))) == 5


def test_all_shapes_in_another_unit_are_named_with_the_probable_unit(paw):
    sizes = {"a": 1.0, "b": 1e-3, "c": 1.2, "d": 0.9, "e": 1.1e3, "f": 1.0, "g": 150.0}
    shapes = [replace(moved(paw, np.eye(3), np.zeros(3), size), name=name) for name, size in sizes.items()]
    with pytest.raises(InputError) as refusal:
        align(shapes, GroomSettings())
    lines = str(refusal.value).splitlines()
    assert [line[0] for line in lines] == ["b", "e", "g"]
    assert [("in metres" in line, "in micrometres" in line) for line in lines] == [
        (True, False),
        (False, True),
        (False, False),
    ]


@pytest.mark.parametrize("growth", [0.4, 2.5])
def test_icp_undoes_a_turn_whatever_the_size(paw, growth):
    turn = Rotation.from_rotvec([2.0, -1.0, 1.5]).as_matrix()
    other = moved(paw, turn, np.array([100.0, -50.0, 20.0]), growth)
    poses = align([paw, other], GroomSettings())
    assert np.cbrt(np.linalg.det(poses[:, :3, :3])) == pytest.approx(1.0)
    assert np.abs(placed(paw, poses[0]) - placed(other, poses[1]) / growth).max() < 0.1


def test_icp_is_not_misled_by_a_part_that_is_elsewhere():
    random = np.random.default_rng(6)
    directions = random.normal(size=(1500, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    points = directions * [1.5, 1.0, 0.6]
    normals = points / np.square([1.5, 1.0, 0.6])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)

    def with_dent(centre):
        near = np.linalg.norm(points - centre, axis=1) < 0.45
        dented = np.where(near[:, None], points - 0.3 * normals, points)
        return OrientedPoints(dented, normals, np.zeros(3))

    pose = registered(with_dent([0.0, 0.5, 0.5]), with_dent([0.0, -0.2, 0.6])).pose
    scale = np.cbrt(np.linalg.det(pose[:3, :3]))
    turn = Rotation.from_matrix(pose[:3, :3] / scale).magnitude()
    assert np.degrees(turn) < 1.0
    assert scale == pytest.approx(1.0, abs=0.01)


def test_who_does_not_look_like_the_others_or_lay_otherwise_has_a_note(paw):
    random = np.random.default_rng(7)
    cohort = [
        moved(paw, Rotation.from_rotvec(0.1 * random.normal(size=3)).as_matrix(), random.normal(size=3), size)
        for size in (0.8, 0.9, 1.0, 1.1)
    ]
    upside_down = moved(paw, np.diag([1.0, -1.0, -1.0]), np.zeros(3))
    middle = paw.coarse_mesh.vertices.mean(axis=0)
    arms = paw.coarse_mesh.vertices - middle
    flattened = TriangleMesh(arms * [0.3, 1.0, 2.5], paw.coarse_mesh.faces)
    odd = replace(paw, mesh=flattened, coarse_mesh=flattened)
    notes = register([*cohort, upside_down, odd], GroomSettings()).notes
    assert notes[:4] == (None,) * 4
    assert "180°" in notes[4]
    assert "not look like" in notes[5]


def test_a_shape_that_is_far_from_the_typical_one_but_near_others_is_not_odd(coarse_egg):
    shapes = []
    for stretch in (1.0, 1.0, 1.05, 0.95, 1.02, 2.2, 2.1, 2.15):
        points = oriented_points(TriangleMesh(coarse_egg.vertices * [stretch, 1.0, 1.0], coarse_egg.faces))
        shapes.append(points.scaled(1.0 / points.size))
    distances = np.array([registered(shape, shapes[0]).distance for shape in shapes])

    def odd(chosen):
        return odd_ones([shapes[k] for k in chosen], distances[chosen], candidates, no_tick)

    assert odd([0, 1, 2, 3, 4, 5]) == {5}
    assert odd([0, 1, 2, 3, 4, 5, 6]) == {5, 6}  # two of another organ
    assert odd([0, 1, 2, 3, 4, 5, 6, 7]) == set()

    def of_three(between):
        """Whether the third shape is odd, by its distance from the second."""
        apart = {0: 0.2, 1: between}

        def known(moving, fixed):
            return [Fit(np.eye(4), apart[next(k for k, shape in enumerate(shapes) if shape is fixed)])]

        return odd_ones(shapes[:3], np.array([0.0, 0.1, 0.2]), known, no_tick) == {2}

    assert of_three(0.2)
    assert not of_three(0.1)


@pytest.mark.parametrize(
    ("scale", "note"),
    [(2.0, ""), (3.0, "3.0 times as large"), (10.0, "10 times as large"), (0.1, "10 times as small")],
)
def test_a_shape_whose_size_is_far_from_most_others_has_a_note(paw, scale, note):
    cohort = [replace(paw, name=f"paw{k}") for k in range(3)]
    grown = TriangleMesh(paw.coarse_mesh.vertices * scale, paw.coarse_mesh.faces)
    notes = register([*cohort, replace(paw, name="grown", coarse_mesh=grown)], GroomSettings()).notes
    assert notes[:3] == (None,) * 3
    assert note in (notes[3] or "")
    assert bool(notes[3]) == bool(note)


def test_a_shape_that_differs_much_from_the_typical_one_keeps_the_orientation_of_its_neighbours(paw):
    """Most stretched, the paw is as wide as the typical one is long, and fits it better upside down."""
    cohort = []
    for amount in np.linspace(-1.0, 1.0, 6):
        stretched = paw.coarse_mesh.vertices * np.exp(amount * np.array([-0.5, 0.5, 0.0]))
        mesh = TriangleMesh(stretched, paw.coarse_mesh.faces)
        cohort.append(replace(paw, mesh=mesh, coarse_mesh=mesh))
    linear = register(cohort, GroomSettings()).alignments[:, :3, :3]
    turns = Rotation.from_matrix(linear)
    assert np.degrees((turns * turns[2].inv()).magnitude()).max() < 45.0


def test_of_shapes_in_any_orientation_none_is_left_without_a_note_where_little_is_not_symmetric(
    paw, coarse_egg
):
    random = np.random.default_rng(0)
    bump = np.exp(-np.square(np.linalg.norm(coarse_egg.vertices - [15.0, 7.0, 4.0], axis=1) / 6.0) / 2.0)
    shape = coarse_egg.vertices + 2.5 * bump[:, None] * coarse_egg.vertex_normals
    cohort, turns = [], Rotation.random(6, rng=random)
    for turn in turns:
        own = turn.apply(shape * np.exp(random.normal(scale=0.05, size=3)))
        cohort.append(replace(paw, coarse_mesh=TriangleMesh(own, coarse_egg.faces)))
    registration = register(cohort, GroomSettings())
    assert all("orientation" in note for note in registration.notes)


def _round_organs(paw, egg, turns):
    """Return uneven balls with one blunt side, whose files lie as they are turned."""
    random, cohort = np.random.default_rng(2), []
    ball = egg.vertices / [20.0, 14.0, 10.0]
    for turn in turns:
        waves = np.sin(2.5 * ball @ random.normal(size=(3, 6)) + random.uniform(0.0, 6.3, 6))
        own = 10.0 * ball * [1.0, 0.9, 0.8] * (1.0 + 0.03 * waves.sum(axis=1, keepdims=True))
        cohort.append(replace(paw, coarse_mesh=TriangleMesh(turn.apply(own), egg.faces)))
    return cohort


@pytest.mark.parametrize("degrees", [60.0, 70.0])
def test_a_symmetric_shape_is_turned_the_short_way(degrees):
    """Its given orientation settles slowly; three others fit as well."""
    axes, rng = np.array([1.0, 0.7, 0.5]), np.random.default_rng(0)
    turn = Rotation.from_euler("z", degrees, degrees=True)
    shapes = []
    for rotation in (turn, Rotation.identity()):
        sphere = rng.normal(size=(400, 3))
        sphere /= np.linalg.norm(sphere, axis=1, keepdims=True)
        points = sphere * axes * (1.0 + 0.04 * rng.normal(size=(400, 1)))
        normals = sphere / axes / np.linalg.norm(sphere / axes, axis=1, keepdims=True)
        shape = OrientedPoints(rotation.apply(points), rotation.apply(normals), np.zeros(3))
        shapes.append(shape.scaled(1.0 / shape.size))
    pose = registered(*shapes).pose[:3, :3]
    angle = np.degrees(Rotation.from_matrix(pose / np.cbrt(np.linalg.det(pose))).magnitude())
    assert angle == pytest.approx(degrees, abs=15.0)


def test_a_shape_that_a_dent_at_the_other_end_turns_is_named(paw, coarse_egg):
    """Turned by 180°, an ellipsoid fits another one whose dent is at the other end."""
    sphere = coarse_egg.vertices / [20.0, 14.0, 10.0]

    def dented(place):
        vertices = sphere * [40.0, 20.0, 12.0]
        across = np.square(vertices[:, :2] - [place, 0.0]).sum(axis=1)
        vertices[:, 2] -= np.where(vertices[:, 2] > 0.0, 10.0 * np.exp(-across / 100.0), 0.0)
        return replace(paw, coarse_mesh=TriangleMesh(vertices, coarse_egg.faces))

    cohort = [dented(place) for place in np.linspace(-25.0, 25.0, 10)]
    registration = register(cohort, GroomSettings())
    angles = np.degrees(Rotation.from_matrix(rotation_of(registration.alignments)).magnitude())
    assert all(note for note, angle in zip(registration.notes, angles, strict=True) if angle > 90.0)
    assert np.count_nonzero(angles > 90.0) <= 5


def test_round_shapes_keep_the_orientation_of_files_that_lie_alike_and_say_so(paw, coarse_egg):
    turns = Rotation.from_rotvec(np.random.default_rng(1).normal(scale=np.radians(4.0), size=(8, 3)))
    registration = register(_round_organs(paw, coarse_egg, turns), GroomSettings())
    rotations = Rotation.from_matrix(registration.alignments[:, :3, :3])
    assert np.degrees(rotations.magnitude()).max() < 25.0
    assert sum("symmetric" in (note or "") for note in registration.notes) >= 4


def test_round_shapes_of_files_that_lie_in_any_way_are_uncertain(paw, coarse_egg):
    notes = register(
        _round_organs(paw, coarse_egg, Rotation.random(8, random_state=3)), GroomSettings()
    ).notes
    assert sum("uncertain" in (note or "") or "symmetric" in (note or "") for note in notes) >= 4


def _bodies(paw, egg, turned, turn):
    """Return ellipsoids with two bumps, one of which grows; some are turned in their files."""
    cohort = []
    for number, height in enumerate(np.linspace(2.0, 7.0, 8)):
        vertices = np.array(egg.vertices)
        for place, size in (([13.0, 7.0, 4.0], height), ([-6.0, -2.0, 9.4], 4.0)):
            bump = np.exp(-np.square(np.linalg.norm(egg.vertices - place, axis=1) / 5.0) / 2.0)
            vertices += size * bump[:, None] * egg.vertex_normals
        if number in turned:
            vertices = vertices @ turn.T
        cohort.append(replace(paw, coarse_mesh=TriangleMesh(vertices, egg.faces)))
    return cohort


@pytest.mark.parametrize("turned", [{7}, {0}, {1, 4, 6}, {2, 3, 5, 7}])
@pytest.mark.parametrize("turn", ["180° about z", "90° about x"])
def test_bodies_that_are_turned_in_their_files_are_turned_back_and_named(paw, coarse_egg, turned, turn):
    matrix = {"180° about z": np.diag([-1.0, -1.0, 1.0]), "90° about x": np.eye(3)[[0, 2, 1]] * [1, -1, 1]}
    registration = register(_bodies(paw, coarse_egg, turned, matrix[turn]), GroomSettings())
    rotations = rotation_of(registration.alignments)
    rotations[list(turned)] = rotations[list(turned)] @ matrix[turn]
    lies = Rotation.from_matrix(rotations)
    assert np.degrees((lies * lies[0].inv()).magnitude()).max() < 10.0
    named = {k for k, note in enumerate(registration.notes) if note}
    assert turned <= named or {*range(8)} - turned <= named


def test_nothing_but_the_turned_body_is_named(paw, coarse_egg):
    notes = register(_bodies(paw, coarse_egg, {7}, np.diag([-1.0, -1.0, 1.0])), GroomSettings()).notes
    assert notes[:7] == (None,) * 7
    assert "rotated by 180°" in (notes[7] or "")


def test_symmetric_bodies_keep_the_rotations_of_their_files_and_each_is_named(paw, coarse_egg):
    """Ellipsoids fit as well after half a turn."""
    random = np.random.default_rng(5)
    stretched = [coarse_egg.vertices * np.exp(random.normal(scale=0.05, size=3)) for _ in range(6)]
    cohort = [replace(paw, coarse_mesh=TriangleMesh(item, coarse_egg.faces)) for item in stretched]
    registration = register(cohort, GroomSettings())
    assert np.degrees(Rotation.from_matrix(registration.alignments[:, :3, :3]).magnitude()).max() < 15.0
    assert all("symmetric" in (note or "") for note in registration.notes)


def test_where_half_of_the_shapes_are_symmetric_no_other_is_without_a_note():
    angles, ones = np.array([0.0, 5.0, 44.0, 50.0, 90.0, 180.0]), np.ones(6)
    assert all(notes_on(Findings(ones, ones, angles, odd=(), unclear={0: 180.0, 1: 180.0, 4: 90.0})))


def test_a_surface_of_few_points_can_be_bent():
    normals = np.random.default_rng(0).normal(size=(3, 12, 3))
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    units = [OrientedPoints(item - item.mean(axis=0), item, np.zeros(3)) for item in normals]
    choices = choose(units, [0, 1, 2], [candidates(unit, units[0]) for unit in units], no_tick)
    assert all(np.isfinite(choice.fit.pose).all() for choice in choices)
