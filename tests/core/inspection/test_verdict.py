import json
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from homolog.errors import InputError
from homolog.geometry import transform_points
from homolog.inspection import Word, judge, read_verdict, refuse_unusable, write_verdict
from homolog.inspection.verdict import Agreement, agreement
from homolog.io.project import ProjectFolder
from homolog.io.records import ProjectRecord
from homolog.surfaces.mesh import TriangleMesh


@pytest.fixture(scope="module")
def shapes(known):
    """Return the six ellipsoids in aligned coordinates: three modes and perfect correspondence."""
    pairs = list(zip(known.alignments, known.local, known.meshes, strict=True))
    return SimpleNamespace(
        particles=np.array([transform_points(matrix, local) for matrix, local, _ in pairs]),
        surfaces=[mesh.placed(matrix) for matrix, _, mesh in pairs],
        directions=known.directions,
        spacing=np.sqrt(4.0 * np.pi * 15.0**2 / 160),
    )


def exchanged(particles, generator):
    """Each particle exchanged with a random one of its neighbours, on each subject separately."""
    result = particles.copy()
    for own in result:
        near = KDTree(own).query(own, 7)[1]
        order = np.arange(len(own))
        for index in generator.permutation(len(own)):
            other = generator.choice(near[index])
            order[[index, other]] = order[[other, index]]
        own[:] = own[order]
    return result


def test_ellipsoids_with_known_correspondence_are_sound(shapes):
    verdict = judge(shapes.particles, shapes.surfaces)
    assert verdict.word is Word.SOUND
    assert (verdict.cause, verdict.remedy) == ("", "")
    assert verdict.reproducible > 0.99 > 0.5 > verdict.chance
    assert verdict.residual < 1e-6 * verdict.spread
    assert verdict.surface < 0.2 * verdict.surface_spread
    assert verdict.landmark < 0.1 * verdict.spacing < verdict.exchanged
    assert abs(verdict.unevenness) < 0.2


@pytest.mark.parametrize("kind", ["in any order", "exchanged with neighbours", "among the subjects"])
def test_permuted_particles_are_not_usable(shapes, kind):
    generator = np.random.default_rng(3)
    particles = shapes.particles.copy()
    if kind == "in any order":
        particles = generator.permuted(np.tile(np.arange(160), (6, 1)), axis=1)
        particles = np.take_along_axis(shapes.particles, particles[..., None], axis=1)
    elif kind == "exchanged with neighbours":
        particles = exchanged(particles, generator)
    else:
        order = generator.permuted(np.tile(np.arange(6), (160, 1)), axis=1).T
        particles = np.take_along_axis(particles, order[..., None], axis=0)
    verdict = judge(particles, seed=1)
    assert verdict.word is Word.UNUSABLE
    assert verdict.remedy


def test_noise_beyond_half_the_spacing_is_doubtful_and_names_landmarks(shapes):
    generator = np.random.default_rng(4)
    verdict = judge(shapes.particles + generator.normal(0, 0.35 * shapes.spacing, shapes.particles.shape))
    assert verdict.word is Word.DOUBTFUL
    assert 0.5 * verdict.spacing < verdict.landmark < verdict.exchanged
    assert "half the distance" in verdict.cause
    assert "landmarks" in verdict.remedy


def test_particles_that_leave_half_of_the_surface_are_doubtful(shapes):
    half = np.flatnonzero(shapes.directions[:, 2] > 0.0)
    verdict = judge(shapes.particles[:, half], shapes.surfaces)
    assert verdict.word is Word.DOUBTFUL
    assert verdict.unevenness > 1.0
    assert "less evenly" in verdict.cause


def test_subjects_that_differ_each_in_its_own_way_ask_for_more_subjects(shapes):
    generator = np.random.default_rng(5)
    ways = generator.normal(size=(6, 3, 9))  # smooth displacements, of another kind for each subject
    x, y, z = shapes.directions.T
    waves = [x * y, y * z, z * x, x * x - y * y, 3 * z * z - 1]
    waves += [x * y * z * 2, x * x * x - 3 * x * y * y, 3 * x * x * y - y * y * y, z * (x * x - y * y) * 2]
    verdict = judge(shapes.particles.mean(axis=0) + np.einsum("mjk,kn->mnj", ways, waves))
    assert verdict.word is Word.DOUBTFUL
    assert verdict.landmark < 0.5 * verdict.spacing
    assert verdict.remedy.startswith("Add subjects")


def test_round_subjects_are_doubtful_unless_their_files_tell_how_they_are_turned():
    generator = np.random.default_rng(7)
    sphere = trimesh.creation.icosphere(subdivisions=4)
    directions = np.asarray(sphere.vertices)
    common, rows = generator.normal(size=(2, 3)), []
    for _ in range(8):
        centres = generator.normal(size=(12, 3))
        centres /= np.linalg.norm(centres, axis=1, keepdims=True)
        bumps = np.exp(-8.0 * (1.0 - directions @ centres.T)) @ generator.normal(0.0, 0.01, 12)
        waves = 0.1 * generator.normal(size=2) @ np.square(directions @ common.T).T
        rows.append(20.0 * (1.0 + bumps + waves)[:, None] * directions)
    surfaces = [TriangleMesh(row, sphere.faces) for row in rows]
    particles = np.array(rows)[:, :162]
    alone = judge(particles, surfaces)
    told = judge(particles, surfaces, alignments=np.tile(np.eye(4), (8, 1, 1)))
    assert told.turning < 0.3 * alone.turning
    assert told.landmark < alone.landmark
    assert alone.word is Word.DOUBTFUL
    assert "turned" in alone.cause


def test_symmetric_subjects_are_doubtful_if_their_files_lie_in_any_way(shapes):
    turned = np.tile(np.eye(4), (6, 1, 1))
    agreed = judge(shapes.particles, shapes.surfaces, alignments=turned)
    turned[:, :3, :3] = Rotation.random(6, random_state=1).as_matrix()
    verdict = judge(shapes.particles, shapes.surfaces, alignments=turned)
    assert (agreed.word, agreed.uncertain) == (Word.SOUND, 0.0)
    assert (verdict.word, verdict.uncertain) == (Word.DOUBTFUL, 1.0)
    assert "orientation" in verdict.remedy


def test_two_subjects_are_doubtful_and_few_particles_are_judged_without_landmarks(shapes):
    assert judge(shapes.particles[:2], shapes.surfaces[:2]).word is Word.DOUBTFUL
    few = judge(shapes.particles[:, :8], shapes.surfaces)
    assert np.isnan(few.landmark)
    assert "Landmark" not in few.line


def test_a_verdict_names_the_number_of_particles_for_thin_walls(shapes):
    shells = [mesh.placed(np.diag([1.0, 1.0, 0.05, 1.0])) for mesh in shapes.surfaces]
    flat = shapes.particles * [1.0, 1.0, 0.05]
    noisy = flat + np.random.default_rng(6).normal(0, 3.0, flat.shape) * [1, 1, 0.0]
    verdict = judge(noisy, shells)
    assert verdict.thin > 0.9
    assert "thinner" in verdict.cause
    assert "more particles (about" in verdict.remedy


def test_a_stored_verdict_is_read_again_until_the_particles_change(shapes, tmp_path):
    project = ProjectFolder(tmp_path)
    project.model.mkdir()
    project.write(ProjectRecord())
    verdict = judge(shapes.particles)
    write_verdict(project, verdict, shapes.particles)
    stored = json.loads((project.model / "verdict.json").read_text())
    assert stored["surface"] is None
    stored["cause"] = "as stored"
    (project.model / "verdict.json").write_text(json.dumps(stored))
    assert read_verdict(project, shapes.particles).cause == "as stored"
    moved = shapes.particles + np.arange(6.0)[:, None, None]
    assert read_verdict(project, moved).cause != "as stored"


def test_models_that_are_not_usable_are_refused_with_their_reason(shapes, tmp_path):
    project = ProjectFolder(tmp_path)
    project.model.mkdir()
    particles = exchanged(shapes.particles, np.random.default_rng(8))
    write_verdict(project, judge(particles), particles)
    with pytest.raises(InputError, match=r"not usable.*exchanged at random.*landmarks.*option anyway"):
        refuse_unusable(project, particles)
    write_verdict(project, judge(shapes.particles), shapes.particles)
    refuse_unusable(project, shapes.particles)


def test_particles_between_those_of_the_model_agree_with_it_and_exchanged_ones_do_not(shapes):
    again = 0.5 * (
        shapes.particles
        + shapes.particles[:, KDTree(shapes.particles[0]).query(shapes.particles[0], 2)[1][:, 1]]
    )
    close = agreement(shapes.particles, again)
    assert close.seeds < 0.1 * close.seeds_spacing
    generator = np.random.default_rng(2)
    far = agreement(shapes.particles, exchanged(exchanged(again, generator), generator))
    assert far.seeds > 0.4 * far.seeds_spacing


def test_a_model_from_which_another_seed_differs_is_doubtful_and_stays_so_when_read(shapes, tmp_path):
    verdict = judge(shapes.particles, again=Agreement(3.0, 5.0))
    assert verdict.word is Word.DOUBTFUL
    assert "seed" in verdict.cause
    assert judge(shapes.particles, again=Agreement(1.0, 5.0)).word is Word.SOUND
