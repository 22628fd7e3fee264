import json
import shutil

import numpy as np
import pytest

from homolog.errors import InputError
from homolog.io.meshes import read_mesh, write_mesh
from homolog.io.particles import read_particles, write_particles
from homolog.io.project import ProjectFolder
from homolog.io.results import read_modes, read_result, read_surfaces
from homolog.io.shapeworks_export import write_shapeworks
from homolog.run.import_model import import_model
from homolog.surfaces.mesh import TriangleMesh


@pytest.fixture
def project(tmp_path):
    return ProjectFolder(tmp_path / "imported")


@pytest.fixture
def change(exported, content):
    """Change the project file's content and write it again."""

    def write(edit):
        edit(content)
        exported.write_text(json.dumps(content, indent=4), encoding="utf-8")
        return exported

    return write


@pytest.fixture
def bare(exported, tmp_path):
    """Return a function that copies the particles of one frame, or both, to a folder of their own."""

    def copy(pattern):
        folder = tmp_path / "bare"
        folder.mkdir()
        for path in exported.parent.glob(f"*_particles/{pattern}"):
            shutil.copy(path, folder)
        return folder

    return copy


def test_a_project_comes_back_as_it_went(exported, project, finished_run):
    assert import_model(exported, project) == []
    before, after = read_result(finished_run), read_result(project)
    assert after.names == before.names
    assert np.abs(after.world - before.world).max() <= 1e-6
    assert np.abs(after.local - before.local).max() <= 1e-6
    assert np.allclose(after.alignments, before.alignments)
    for read_surface, other in zip(read_surfaces(project), read_surfaces(finished_run), strict=True):
        assert np.allclose(read_surface.vertices, other.vertices)
    assert len(read_modes(project, after.mean_surface)) == len(read_modes(finished_run, before.mean_surface))
    record = project.read().result
    assert (record.ended, record.metric, record.source) == (
        "imported",
        "geodesic",
        f"the ShapeWorks project {exported.name}",
    )


def test_what_shapeworks_wrote_again_is_read_to_its_precision(exported, project, change, finished_run):
    """ShapeWorks writes particles with six significant digits and transforms with six decimals."""

    def rewrite(content):
        for row in content["data"]:
            for key in ("local_particles_1", "world_particles_1"):
                points = read_particles(exported.parent / row[key])
                lines = (" ".join(f"{value:.6g}" for value in point) for point in points)
                (exported.parent / row[key]).write_text("\n".join(lines) + "\n")
            for key in ("alignment_1", "procrustes_1"):
                row[key] = " ".join(f"{float(word):.6f}" for word in row[key].split())

    import_model(change(rewrite), project)
    assert np.abs(read_result(project).world - read_result(finished_run).world).max() <= 1e-4


def test_groups_columns_and_unknown_keys_go_both_ways(change, project, tmp_path):
    def add(content):
        content["optimize"]["a_new_key"] = "7"
        content["future"] = {"x": "y"}
        content["landmarks"] = []
        for number, row in enumerate(content["data"]):
            row |= {
                "group_disease": "ab"[number % 2],
                "age": str(40 + number),
                "group_sex": "f",
                "image_ct": "a b",
            }

    import_model(change(add), project)
    subjects = project.read().result.subjects
    assert [subject.group for subject in subjects] == ["a", "b", "a", "b"]
    assert subjects[1].columns == {"disease": "b", "sex": "f", "age": "41"}
    again = json.loads(write_shapeworks(project, tmp_path / "again").read_text())
    assert again["optimize"]["a_new_key"] == "7"
    assert again["future"] == {"x": "y"}
    row = again["data"][1]
    assert (row["group_disease"], row["group_sex"], row["age"]) == ("b", "f", "41")
    assert row["image_ct"].endswith("a b")


def test_excluded_subjects_are_left_out_with_a_note(change, project):
    notes = import_model(change(lambda content: content["data"][2].update(excluded="yes")), project)
    assert read_result(project).names == ("a", "b", "d")
    assert notes == ["excluded in ShapeWorks: c"]


def test_a_mirrored_subject_faces_outward_in_the_common_frame(exported, change, project, finished_run):
    """ShapeWorks reflects shapes of the other side of the body by their alignment."""
    mirror = np.diag([-1.0, 1.0, 1.0, 1.0])

    def reflect(content):
        row = content["data"][0]
        points = read_particles(exported.parent / row["local_particles_1"])
        write_particles(exported.parent / row["local_particles_1"], points @ mirror[:3, :3])
        mesh = read_mesh(exported.parent / row["groomed_1"])
        turned = TriangleMesh(mesh.vertices @ mirror[:3, :3], mesh.faces[:, ::-1])
        write_mesh(exported.parent / row["groomed_1"], turned)
        matrix = np.array(row["alignment_1"].split(), float).reshape(4, 4) @ mirror
        row["alignment_1"] = " ".join(map(str, matrix.ravel()))

    assert import_model(change(reflect), project) == []
    first, before = read_surfaces(project)[0], read_surfaces(finished_run)[0]
    assert first.volume == pytest.approx(before.volume)
    assert read_result(project).mean_surface.volume > 0.0


def test_a_subject_without_a_surface_gets_a_carried_one(exported, content, project, finished_run):
    (exported.parent / content["data"][1]["groomed_1"]).unlink()
    (note,) = import_model(exported, project)
    assert note.startswith("b: its surface")
    assert "warped by the particles" in note
    assert read_surfaces(project)[1].volume == pytest.approx(read_surfaces(finished_run)[1].volume, rel=0.05)


def test_a_surface_that_the_particles_are_not_on_is_not_used(exported, content, project):
    shutil.copy(
        exported.parent / content["data"][0]["groomed_1"], exported.parent / content["data"][1]["groomed_1"]
    )
    mesh = read_mesh(exported.parent / content["data"][1]["groomed_1"])
    write_mesh(
        exported.parent / content["data"][1]["groomed_1"], TriangleMesh(mesh.vertices + 5.0, mesh.faces)
    )
    assert any("not on the surface" in item for item in import_model(exported, project))


@pytest.mark.parametrize("pattern", ["*_world.particles", "*_local.particles", "*.particles"])
def test_a_bare_folder_of_particles_is_a_model(bare, project, finished_run, pattern):
    (note,) = import_model(bare(pattern), project)
    assert "no surface" in note
    result, before = read_result(project), read_result(finished_run)
    assert result.names == before.names
    assert result.world.shape == before.world.shape
    sizes = [np.ptp(item.world, axis=1).max() for item in (result, before)]
    assert sizes[0] == pytest.approx(sizes[1], rel=0.05)
    outward = result.mean_surface.vertices[::9] - result.world.mean(axis=(0, 1))
    assert ((result.mean_surface.vertex_normals[::9] * outward).sum(axis=1) > 0.0).mean() > 0.95


def test_a_folder_of_an_older_shapeworks_is_a_model_with_both_frames(bare, project, finished_run):
    folder = bare("*.particles")
    for path in folder.iterdir():
        stem, _, frame = path.stem.rpartition("_")
        path.rename(folder / f"{stem}.{frame[0]}pts")
    import_model(folder, project)
    result, before = read_result(project), read_result(finished_run)
    assert result.names == before.names
    assert np.allclose(result.world, before.world, atol=1e-6)


def test_a_spreadsheet_project_is_read(exported, content, project, finished_run):
    import openpyxl

    book = openpyxl.Workbook()
    sheet = book.active
    sheet.title = "data"
    heads = list(content["data"][0])
    sheet.append([*heads, "age"])
    for number, row in enumerate(content["data"]):
        sheet.append([*(row[head] for head in heads), 50 + number])
    settings = book.create_sheet("optimize")
    settings.append(["parameter", "setting"])
    settings.append(["use_geodesic_distance", "false"])
    settings.append(["", ""])
    groom = book.create_sheet("groom")
    groom.append(["key", "value_1", "value_2"])
    groom.append(["fill_holes", True, "false"])
    path = exported.with_suffix(".xlsx")
    book.save(path)
    import_model(path, project)
    assert np.abs(read_result(project).world - read_result(finished_run).world).max() <= 1e-6
    assert project.read().result.subjects[3].columns == {"age": "53"}
    kept = json.loads((project.folder / "shapeworks.json").read_text())
    assert kept["others"]["groom"] == {"1": {"fill_holes": "true"}, "2": {"fill_holes": "false"}}
    assert project.read().result.metric == "euclidean"


def test_one_anatomy_of_several_is_chosen_by_name(change, project):
    def double(content):
        for row in content["data"]:
            row |= {key.replace("_1", "_2"): value for key, value in row.items() if key.endswith("_1")}

    path = change(double)
    with pytest.raises(InputError, match="1, 2"):
        import_model(path, project, domain="3")
    import_model(path, project, domain="2")
    assert len(read_result(project).names) == 4


def test_landmarks_come_with_their_names(exported, change, project):
    def mark(content):
        content["landmarks"] = [{"domain": "1", "name": name} for name in ("tip", "base")]
        for row in content["data"]:
            write_particles(
                exported.parent / f"{row['name']}.txt", np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
            )
            row["landmarks_file_1"] = f"{row['name']}.txt"

    from homolog.io.markups import read_markups

    import_model(change(mark), project)
    result = read_markups(project.cohort().subjects[2].landmarks)
    assert result.names == ("tip", "base")
    assert result.points.tolist() == [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda c: c["data"].clear(), "lists no subject"),
        (lambda c: c["data"].__delitem__(slice(1, None)), "two or more"),
        (lambda c: c.update(data=3), "is not a ShapeWorks project"),
        (lambda c: c["data"][1].update(name="a"), "several subjects are named a"),
        (
            lambda c: c["data"][1].update(world_particles_1="gone.particles"),
            "gone.particles: does not exist",
        ),
        (
            lambda c: [c["data"][1].pop(f"{item}_particles_1") for item in ("local", "world")],
            "b has no particles",
        ),
        (lambda c: c["data"][1].update(alignment_1="1 2 3"), "3 numbers in place of 16"),
        (lambda c: c["data"][1].update(alignment_1="one"), "a transform is damaged"),
        (lambda c: c["data"][1].update(world_particles_1="a\0b"), "can't be a path"),
        (
            lambda c: (
                c["data"][1].update(name=None, optimize=[]) or c.update(optimize=[], landmarks=3, data=[3])
            ),
            "data",
        ),
        (
            lambda c: c["data"][1].update(local_particles_1=c["data"][0]["local_particles_1"]),
            "b: its local and world particles differ in shape",
        ),
    ],
)
def test_a_faulty_project_is_refused_by_name(change, project, edit, message):
    with pytest.raises(InputError, match=message):
        import_model(change(edit), project)
    assert not project.exists


def test_other_files_and_existing_projects_are_refused(exported, project, finished_run, tmp_path):
    with pytest.raises(InputError, match="is neither a ShapeWorks project"):
        import_model(tmp_path / "a.nrrd", project)
    with pytest.raises(InputError, match="is already a project"):
        import_model(exported, finished_run)
    with pytest.raises(InputError, match=f"no particles .* {exported.name}"):
        import_model(exported.parent, project)


def test_particles_in_one_plane_are_no_model(bare, project):
    folder = bare("*_world.particles")
    for path in folder.iterdir():
        write_particles(path, read_particles(path) * [1.0, 1.0, 0.0])
    with pytest.raises(InputError, match="is not a shape model"):
        import_model(folder, project)


def test_subjects_with_other_numbers_of_particles_are_refused(bare, project):
    folder = bare("*_world.particles")
    path = folder / "b_world.particles"
    path.write_text("".join(path.read_text().splitlines(keepends=True)[:-1]))
    with pytest.raises(InputError, match="b: has 47 particles, and a has 48"):
        import_model(folder, project)
