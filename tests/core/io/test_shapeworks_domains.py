"""ShapeWorks projects with several domains: imported, exported, and read as cohorts, with nothing lost."""

import json

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from homolog.geometry import transform_points
from homolog.io.meshes import read_mesh, write_mesh
from homolog.io.particles import write_particles
from homolog.io.project import ProjectFolder
from homolog.io.results import read_result
from homolog.io.shapeworks import read_shapeworks_cohort, read_shapeworks_file
from homolog.io.shapeworks_export import write_shapeworks
from homolog.run.import_model import import_model
from homolog.surfaces.mesh import TriangleMesh


def written(folder, apart=False):
    """Write four knees of two solids with a transform each, or one for each bone, and return the project."""
    sphere, random, rows = trimesh.creation.icosphere(3), np.random.default_rng(2), []
    for name in "abcd":
        row = {"name": name, "fixed": "yes" if name == "b" else "no", "group_site": "north", "age": "61"}
        common = np.eye(4)
        common[:3, :3] = Rotation.from_rotvec(random.normal(scale=0.2, size=3)).as_matrix()
        common[:3, 3] = random.normal(scale=20.0, size=3)
        for domain, low, count in (("femur", 0.0, 60), ("tibia", -45.0, 40)):
            axes = np.array([20.0, 15.0, 18.0]) * np.exp(random.normal(scale=0.05, size=3))
            mesh = TriangleMesh(sphere.vertices * axes + [0.0, 0.0, low], sphere.faces)
            local = mesh.vertices[:: len(mesh.vertices) // count][:count]
            own = common.copy()
            if apart:
                own[:3, 3] = -own[:3, :3] @ local.mean(axis=0)
            write_mesh(folder / f"{name}_{domain}.ply", mesh)
            for frame, points in (("local", local), ("world", transform_points(own, local))):
                write_particles(folder / f"{name}_{domain}_{frame}.particles", points)
                row[f"{frame}_particles_{domain}"] = f"{name}_{domain}_{frame}.particles"
            row[f"shape_{domain}"] = f"{name}_{domain}.ply"
            row[f"alignment_{domain}"] = " ".join(map(str, own.ravel()))
        rows.append(row)
    optimize = {"number_of_particles": "60 40", "use_normals": "true"}
    path = folder / "knees.swproj"
    path.write_text(json.dumps({"data": rows, "optimize": optimize, "studio": {"zoom": "3"}}))
    return path


@pytest.fixture
def imported(tmp_path):
    (tmp_path / "study").mkdir()
    project = ProjectFolder(tmp_path / "joint")
    import_model(written(tmp_path / "study"), project)
    return project


def test_domains_are_imported_as_structures_where_they_lie(imported, tmp_path):
    result = read_result(imported)
    assert [(part.name, part.particles) for part in result.parts] == [
        ("femur", slice(0, 60)),
        ("tibia", slice(60, 100)),
    ]
    assert result.groups == ("north",) * 4
    gaps = result.world[:, 60:].mean(axis=1) - result.world[:, :60].mean(axis=1)
    assert np.linalg.norm(gaps, axis=1) == pytest.approx(np.full(4, 45.0), abs=3.0)
    alone = read_result(imported.structure("tibia"))
    assert np.allclose(alone.local, result.local[:, 60:])
    assert len(result.mean_surface.parts) == 2
    assert (imported.model / "pose.csv").is_file()
    assert list(imported.cohort().subjects[0].structures) == ["femur", "tibia"]


def test_a_round_trip_keeps_particles_transforms_names_and_columns(imported, tmp_path):
    before = read_shapeworks_file(tmp_path / "study" / "knees.swproj")
    path = write_shapeworks(imported, tmp_path / "out")
    after = read_shapeworks_file(path)
    assert after.domains == before.domains
    for old, new in zip(before.rows, after.rows, strict=True):
        for key in ("name", "fixed", "group_site", "age"):
            assert new[key] == old[key]
        for domain in ("femur", "tibia"):
            given, kept = (
                np.array([float(word) for word in row[f"alignment_{domain}"].split()]) for row in (old, new)
            )
            assert kept == pytest.approx(given, abs=1e-9)
            assert (path.parent / new[f"shape_{domain}"]).resolve() == tmp_path / "study" / old[
                f"shape_{domain}"
            ]
    assert after.table("optimize")["number_of_particles"] == "60 40"
    assert after.table("studio") == {"zoom": "3"}
    again = ProjectFolder(tmp_path / "again")
    import_model(path, again)
    first, second = read_result(imported), read_result(again)
    assert np.allclose(first.world, second.world)
    assert np.allclose(first.local, second.local)
    meshes = [read_mesh(path.parent / after.rows[0][f"groomed_{domain}"]) for domain in ("femur", "tibia")]
    assert meshes[1].vertices[:, 2].mean() == pytest.approx(-45.0, abs=1.0)


def test_domains_that_were_laid_on_each_other_lie_as_in_their_files(tmp_path):
    (tmp_path / "study").mkdir()
    project = ProjectFolder(tmp_path / "joint")
    notes = import_model(written(tmp_path / "study", apart=True), project)
    assert len(notes) == 1
    world = read_result(project).world
    gaps = np.linalg.norm(world[:, 60:].mean(axis=1) - world[:, :60].mean(axis=1), axis=1)
    assert gaps == pytest.approx(np.full(4, 45.0), abs=3.0)


def test_one_domain_is_imported_alone_if_asked(tmp_path):
    (tmp_path / "study").mkdir()
    project = ProjectFolder(tmp_path / "tibia")
    import_model(written(tmp_path / "study"), project, domain="tibia")
    result = read_result(project)
    assert result.world.shape == (4, 40, 3)
    assert not result.parts


def test_a_project_of_several_domains_is_a_cohort_with_structures(imported, tmp_path):
    cohort = read_shapeworks_cohort(write_shapeworks(imported, tmp_path / "out"))
    assert [list(subject.structures) for subject in cohort.subjects] == [["femur", "tibia"]] * 4
