import numpy as np
import pytest

from homolog.io.meshes import read_mesh
from homolog.io.particles import read_particles
from homolog.io.results import read_result, read_surfaces


def as_shapeworks_reads(text):
    """Return a transform as `ProjectUtils::get_transforms` of ShapeWorks reads it."""
    return np.array([float(word) for word in text.split()]).reshape(4, 4)


def test_every_value_is_text_as_its_reader_demands(content):
    def leaves(value):
        if isinstance(value, dict):
            return [leaf for item in value.values() for leaf in leaves(item)]
        return [leaf for item in value for leaf in leaves(item)] if isinstance(value, list) else [value]

    assert all(isinstance(leaf, str) for leaf in leaves(content))
    assert set(content) >= {
        "data",
        "groom",
        "optimize",
        "studio",
        "project",
        "analysis",
        "deepssm",
        "landmarks",
    }
    assert all(
        isinstance(content[key], dict) for key in ("optimize", "studio", "project", "analysis", "deepssm")
    )
    assert all(isinstance(item, dict) for item in content["groom"].values())
    assert content["project"]["version"] == "2"


def test_particles_are_where_they_were(exported, content, finished_run):
    result = read_result(finished_run)
    assert [row["name"] for row in content["data"]] == list(result.names)
    for row, world, local in zip(content["data"], result.world, result.local, strict=True):
        there = read_particles(exported.parent / row["world_particles_1"])
        assert np.array_equal(there, world)
        near = read_particles(exported.parent / row["local_particles_1"])
        assert np.array_equal(near, local)
        matrix = as_shapeworks_reads(row["procrustes_1"]) @ as_shapeworks_reads(row["alignment_1"])
        assert np.allclose(near @ matrix[:3, :3].T + matrix[:3, 3], world, rtol=0, atol=1e-4)


def test_surfaces_go_with_the_particles(exported, content, finished_run):
    for row, surface in zip(content["data"], read_surfaces(finished_run), strict=True):
        mesh = read_mesh(exported.parent / row["groomed_1"])
        matrix = as_shapeworks_reads(row["alignment_1"])
        assert np.allclose(mesh.vertices @ matrix[:3, :3].T + matrix[:3, 3], surface.vertices)
        assert row["shape_1"] == row["groomed_1"]


@pytest.mark.parametrize("key", ["number_of_particles", "use_normals", "use_geodesic_distance"])
def test_settings_say_what_was_run(content, key):
    expected = {"number_of_particles": "48", "use_normals": "true", "use_geodesic_distance": "true"}
    assert content["optimize"][key] == expected[key]
