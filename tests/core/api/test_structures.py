"""Several structures of each subject from Python."""

import numpy as np
import pytest

import homolog as hl
from homolog.errors import InputError
from homolog.io.meshes import read_mesh, write_mesh
from homolog.samples.solids import ellipsoid, surface_of
from homolog.surfaces.mesh import TriangleMesh

SHORT = {"mesh_edge": 2.0, "split_iterations": 5, "anneal_iterations": 20, "settle_iterations": 20}
COUNTS = {"long": 48, "flat": 24}


@pytest.fixture(scope="module")
def shapes():
    """Return two structures of four subjects, of which the last lacks the second one."""
    line = np.arange(-1.4, 1.4, 0.1)
    grid = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1)
    ball = surface_of(ellipsoid(grid, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), np.full(3, -1.4), 0.1, 400)

    def solid(axes, place):
        return TriangleMesh(ball.vertices * axes + np.array([place, 0.0, 0.0]), ball.faces)

    return {
        "long": {name: solid((9.0, 6.0, 6.0 + k), 0.0) for k, name in enumerate("abcd")},
        "flat": {name: solid((3.0, 6.0, 5.0), 14.0 + k) for k, name in enumerate("abc")},
    }


@pytest.fixture(scope="module")
def result(shapes):
    return hl.correspond(shapes, COUNTS, device="cpu", **SHORT)


def test_subjects_take_part_with_the_structures_that_they_have(result):
    assert result.names == ("a", "b", "c")
    assert result.particles.shape == (3, 72, 3)
    assert list(result.structures) == ["long", "flat"]
    assert result.structures["long"].names == ("a", "b", "c", "d")
    assert result.structures["flat"].particles.shape == (3, 24, 3)
    assert np.array_equal(result.structures["long"].particles[:3], result.particles[:, :48])


def test_poses_are_those_in_which_the_structures_lie(result):
    poses = result.relative_poses("long")
    assert np.allclose(poses.translations[:, 1, 0], [-1.0, 0.0, 1.0], atol=0.3)
    with pytest.raises(InputError, match="long, flat"):
        result.relative_poses("round")


def test_lists_with_none_are_the_same_as_names(shapes, result):
    lists = {name: [own.get(subject) for subject in "abcd"] for name, own in shapes.items()}
    again = hl.correspond(lists, COUNTS, device="cpu", **SHORT)
    assert again.names == ("shape_1", "shape_2", "shape_3")
    assert np.array_equal(again.particles, result.particles)


def test_the_mean_surface_has_a_piece_for_each_structure_that_follows_its_own_particles(result):
    mean = result.surface()
    moved = np.mean(result.aligned, axis=0)
    moved[48:] += [5.0, 0.0, 0.0]
    shift = result.surface(moved).vertices - mean.vertices
    still = np.linalg.norm(shift, axis=1) < 1e-6
    assert 0 < still.sum() < len(still)
    assert np.allclose(shift[~still], [5.0, 0.0, 0.0], atol=1e-6)


def test_what_was_saved_is_a_project_of_all_and_of_each(result, tmp_path):
    project = result.save(tmp_path / "project")
    assert np.array_equal(project.particles, result.particles)
    assert np.array_equal(project.structures["long"].particles, result.structures["long"].particles)
    assert np.allclose(project.relative_poses().translations, result.relative_poses().translations, atol=1e-9)
    assert project.verdict.word is result.verdict.word


def test_a_structure_alone_is_saved_as_a_project_of_one(result, tmp_path):
    project = result.structures["flat"].save(tmp_path / "flat")
    assert project.structures == {}
    assert np.array_equal(project.particles, result.structures["flat"].particles)


def test_a_folder_gives_the_particles_of_its_meshes(shapes, tmp_path):
    for structure, own in shapes.items():
        for name in "abc":
            place = tmp_path / name / f"{structure}.ply"
            place.parent.mkdir(exist_ok=True)
            write_mesh(place, own[name])
    read = {
        name: {subject: read_mesh(tmp_path / subject / f"{name}.ply") for subject in "abc"} for name in shapes
    }
    meant = {"n_particles": 24, "device": "cpu", **SHORT}
    files, meshes = hl.correspond(tmp_path, structures="long,flat", **meant), hl.correspond(read, **meant)
    assert np.array_equal(files.particles, meshes.particles)


def test_what_does_not_fit_together_is_refused(shapes):
    with pytest.raises(InputError, match="of all structures, not 0"):
        hl.correspond({"long": shapes["long"], "flat": {"e": shapes["flat"]["a"]}}, **SHORT)
    with pytest.raises(InputError, match="round: is none of the structures"):
        hl.correspond(shapes, {"round": 24}, **SHORT)
    with pytest.raises(InputError, match="a single structure"):
        hl.correspond(shapes["long"], COUNTS, **SHORT)
    with pytest.raises(InputError, match="leave it out"):
        hl.correspond(shapes, structures="long,flat", **SHORT)
