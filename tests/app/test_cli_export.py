"""``homolog export``: what it writes, read again."""

import csv
import json
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
import trimesh
from PIL import Image

from homolog.io.meshes import read_mesh, write_mesh
from homolog.io.particles import read_particles, write_particles
from homolog.io.project import ProjectFolder
from homolog.io.records import ProjectRecord, ResultRecord, ResultSubject
from homolog.io.results import mean_file, particle_file, read_result, read_surfaces, surface_file
from homolog.io.tables import write_table
from homolog.settings import RunSettings
from homolog.statistics.shape_model import ShapeModel
from homolog.surfaces.mesh import TriangleMesh
from homolog_app.cli import main

SMALL = ["--width", "480", "--height", "320", "--progress", "none"]
QUICK = ["--permutations", "99", "--progress", "none"]


VERTICES = 300
AXES = np.array([20.0, 15.0, 10.0])


@pytest.fixture(scope="module")
def project(tmp_path_factory, unit_sphere):
    """Twelve ellipsoids, ``long`` and ``short`` in turn, in files 5 mm beside where they are aligned."""
    project = ProjectFolder(tmp_path_factory.mktemp("export") / "study")
    points, faces = unit_sphere(VERTICES)
    shift = np.eye(4)
    shift[:3, 3] = [5.0, 0.0, 0.0]
    subjects = []
    for index, length in enumerate(_LENGTHS):
        shape = points * AXES * [length, 1.0, 1.0 + 0.01 * (index % 3)]
        name = f"s{index:02d}"
        subjects.append(
            ResultSubject(
                name=name,
                file=name,
                group=("short", "long")[index % 2],
                columns={"x": "1"},
                content="0",
                alignment=shift.tolist(),
            )
        )
        write_particles(particle_file(project, name, "world"), shape[::5])
        write_particles(particle_file(project, name, "local"), shape[::5] - shift[:3, 3])
        write_mesh(surface_file(project, name), TriangleMesh(shape - shift[:3, 3], faces))
    mean = points * AXES * [np.mean(_LENGTHS), 1.0, 1.01]
    write_mesh(mean_file(project), TriangleMesh(mean, faces))
    steps = [[step, -float(step), 2.0 / (step + 1), 1.0] for step in range(20)]
    write_table(project.folder / "energies.csv", ["iteration", "sampling", "ensemble", "normals"], steps)
    result = ResultRecord(
        finished="2025-01-01T00:00:00+00:00",
        ended="converged",
        iterations=20,
        particles=VERTICES // 5,
        metric="geodesic",
        folded_faces=0,
        settings=RunSettings(),
        device="cpu",
        versions={"homolog": "9.9"},
        seconds={},
        fingerprint="abc",
        subjects=subjects,
    )
    project.write(ProjectRecord(result=result))
    return project


_LENGTHS = [0.9, 1.1, 0.93, 1.15, 0.88, 1.08, 0.95, 1.12, 0.91, 1.05, 0.97, 1.16]


@pytest.fixture
def export(project, tmp_path, capsys):
    """Return a function that exports to a name in an empty folder; it returns exit code, path and words."""

    def exported(what, name, *options):
        code = main(["export", what, str(project.folder), "--out", str(tmp_path / "out" / name), *options])
        return code, tmp_path / "out" / name, capsys.readouterr().err

    return exported


def rows(path):
    with path.open(newline="", encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


@pytest.mark.parametrize(
    "options",
    [[], ["--mode", "1"], ["--group", "group", "short", "long"], ["--turntable"], ["--mode", "1", "2"]],
)
def test_a_film_moves_and_lies_whole_within_its_borders(export, decode, options):
    code, path, _ = export("film", "film.mp4", *options, "--fps", "10", "--seconds", "1", *SMALL)
    assert code == 0
    facts, frames = decode(path)
    assert frames.shape == (10, 320, 480, 3)
    assert " 10 fps" in facts
    assert np.abs(frames[1:] - frames[:-1]).max() > 30
    for edge in (frames[:, 0], frames[:, -1], frames[:, :, 0], frames[:, :, -1]):
        assert edge.min() > 240
    assert (frames.min(axis=-1) < 200).mean() > 0.03


def test_a_still_at_the_end_of_a_mode_is_that_frame_of_the_film(export):
    _, series, _ = export("film", "series", "--mode", "1", "--no-loop", "--seconds", "0.2", *SMALL)
    for at, name in (("-2", "1.png"), ("2", "5.png")):
        _, still, _ = export("still", f"at{at}.png", "--mode", "1", "--at", at, *SMALL)
        np.testing.assert_array_equal(np.asarray(Image.open(still)), np.asarray(Image.open(series / name)))
    _, clear, _ = export("still", "clear.png", "--transparent", *SMALL)
    assert np.asarray(Image.open(clear))[0, 0].tolist()[3] == 0


@pytest.mark.parametrize(
    ("what", "name", "options", "message"),
    [
        ("film", "film.avi", ["--mode", "1"], ".mp4 or .gif"),
        ("film", "film.mp4", ["--mode", "9"], "mode 9: the result has 2 modes; choose one from 1 to 2"),
        ("film", "film.mp4", ["--mode", "1", "1"], "--mode and --view"),
        ("film", "film.mp4", ["--mode", "1", "--width", "641"], "641: must be a multiple of 2"),
        ("film", "film.mp4", ["--mode", "1", "--fps", "0"], "--fps 0: must be "),
        ("film", "film.mp4", ["--group", "group", "long", "tall"], "in 'tall'; groups are: short, long"),
        ("film", "film.mp4", ["--group", "size", "1", "2"], "no subject is in '1'"),
        ("still", "still.png", ["--mode", "1", "--at", "3"], "--at 3: must be from -2 to 2"),
        ("still", "still.jpg", ["--mode", "1"], "written as .png"),
        ("plot", "plot.gif", [], "must end in .svg, .pdf, .png"),
        ("plot", "plot.svg", ["--kind", "discriminant"], "compares groups"),
        ("plot", "plot.svg", ["--kind", "scores", "--vertical", "7"], "mode 7: the result has 2 modes"),
        ("meshes", "meshes", ["--format", "dae"], "--format dae"),
    ],
)
def test_what_can_not_be_exported_is_refused_and_leaves_nothing(export, what, name, options, message):
    code, path, said = export(what, name, *options, "--progress", "none")
    assert code == 2
    assert message in said
    assert not path.parent.exists() or not list(path.parent.iterdir())


@pytest.mark.parametrize("what", ["film", "table", "particles"])
def test_a_project_without_a_result_is_refused(tmp_path, capsys, what, project):
    empty = type(project)(tmp_path / "empty")
    empty.write(ProjectRecord())
    arguments = ["--mode", "1"] if what == "film" else []
    out = f"--out={tmp_path / 'out.mp4' if what == 'film' else tmp_path / 'out'}"
    assert main(["export", what, str(empty.folder), *arguments, out, "--progress", "none"]) == 2
    assert "has no result yet" in capsys.readouterr().err


@pytest.mark.parametrize("suffix", ["vtp", "ply", "stl", "glb"])
def test_meshes_are_the_projects_own_surfaces_with_displacement(export, project, suffix):
    arguments = ["--modes", "1", "--subjects", "--group", "group", "short", "long", "--format", suffix]
    code, folder, said = export("meshes", "meshes", *arguments, *QUICK)
    assert code == 0, said
    listed = {row["file"]: row for row in rows(folder / "meshes.csv")}
    assert set(listed) == {item.name for item in folder.iterdir()} - {"meshes.csv"}
    assert len(listed) == 1 + 2 + 2 + 12
    assert all(row["coordinates"].startswith("LPS mm") for row in listed.values())
    result, subjects = read_result(project), read_surfaces(project)
    wanted = {"mean": result.mean_surface.vertices, "subject_s01": subjects[1].vertices}
    for name, vertices in wanted.items():
        path = folder / f"{name}.{suffix}"
        if suffix == "glb":
            (actual,) = trimesh.load(path, process=False).geometry.values()
        else:
            actual = read_mesh(path)
        assert len(actual.vertices) == len(vertices)
        ends = [actual.vertices.min(axis=0), actual.vertices.max(axis=0)]
        np.testing.assert_allclose(ends, [vertices.min(axis=0), vertices.max(axis=0)], atol=1e-4)
    held = {"mode_01_plus_2sd": "displacement_mm", "group_long_mean": "p_fwe"}
    for name, value in held.items():
        assert (value in listed[f"{name}.{suffix}"]["values_at_vertices"]) == (suffix != "stl")


def test_values_at_vertices_are_those_of_the_statistics(export, project):
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOXML import vtkXMLPolyDataReader

    _, folder, _ = export("meshes", "meshes", "--modes", "1", "--group", "group", "short", "long", *QUICK)

    def values(name):
        reader = vtkXMLPolyDataReader()
        reader.SetFileName(str(folder / f"{name}.vtp"))
        reader.Update()
        data = reader.GetOutput().GetPointData()
        return {
            data.GetArrayName(index): vtk_to_numpy(data.GetArray(index))
            for index in range(data.GetNumberOfArrays())
        }

    low, high = values("mode_01_minus_2sd"), values("mode_01_plus_2sd")
    np.testing.assert_allclose(low["displacement_mm"], -high["displacement_mm"])
    assert np.abs(high["displacement_vector_mm"]).max() > 0.5
    long = values("group_long_mean")
    assert set(long) == {"displacement_mm", "displacement_vector_mm", "p", "p_fwe", "q"}
    assert 0.0 < long["p"].min() <= long["p"].max() <= 1.0
    np.testing.assert_allclose(long["p"], values("group_short_mean")["p"])
    world = read_result(project).world
    moved = world[1::2].mean(axis=0) - world[::2].mean(axis=0)
    np.testing.assert_allclose(long["displacement_vector_mm"][::5], moved, atol=1e-6)


def test_a_mode_goes_through_where_its_particles_go(export, project):
    _, folder, _ = export("meshes", "meshes", "--modes", "1", "--deviations", "3", "--progress", "none")
    model = ShapeModel().fit(read_result(project).world)
    mesh = read_mesh(folder / "mode_01_plus_3sd.vtp")
    np.testing.assert_allclose(mesh.vertices[::5], model.instance([3.0]), atol=1e-6)


def test_glb_files_stand_upright_in_metres(export, project):
    _, folder, _ = export("meshes", "meshes", "--modes", "0", "--format", "glb", "--progress", "none")
    scene = trimesh.load(folder / "mean.glb")
    vertices = read_result(project).mean_surface.vertices / 1000.0
    np.testing.assert_allclose(np.ptp(scene.bounds, axis=0), np.ptp(vertices, axis=0)[[0, 2, 1]], atol=1e-5)
    assert scene.bounds[1][1] == pytest.approx(vertices[:, 2].max(), abs=1e-5)


def test_tables_hold_scores_modes_measures_and_a_study(export, project):
    code, folder, _ = export("table", "tables", "--group", "group", "short", "long", *QUICK)
    assert code == 0
    scores, subjects, modes = (rows(folder / f"{name}.csv") for name in ("scores", "subjects", "modes"))
    assert (
        [row["name"] for row in scores]
        == [row["name"] for row in subjects]
        == [f"s{index:02d}" for index in range(12)]
    )
    np.testing.assert_allclose(
        np.std([float(row["mode_1_rms_mm"]) for row in scores], ddof=1),
        float(modes[0]["standard_deviation_rms_mm"]),
    )
    volumes = [float(row["volume_mm3"]) for row in subjects]
    np.testing.assert_allclose(
        volumes, [read_surface.volume for read_surface in read_surfaces(project)], rtol=1e-6
    )
    assert volumes[1] == pytest.approx(4.0 / 3.0 * np.pi * AXES.prod() * 1.1 * 1.01, rel=0.03)
    assert subjects[0]["group"] == "short"
    assert subjects[0]["x"] == "1"
    (study,) = [path for path in folder.iterdir() if path.is_dir()]
    assert rows(study / "tests.csv")[0]["comparison"] == "long - short"


@pytest.mark.parametrize("kind", ["scree", "scores", "quality", "energies", "modes", "difference"])
def test_plots_are_vector_graphics_and_always_the_same(export, kind):
    arguments = (
        ["--group", "group", "short", "long", *QUICK] if kind == "difference" else ["--progress", "none"]
    )
    paths = [export("plot", name, "--kind", kind, *arguments)[1] for name in ("a.svg", "b.svg")]
    assert ElementTree.parse(paths[0]).getroot().tag.endswith("svg")
    assert paths[0].read_bytes() == paths[1].read_bytes()


def test_points_are_the_results_particles(export, project):
    result = read_result(project)
    _, folder, _ = export("particles", "local", "--coordinates", "local", "--progress", "none")
    np.testing.assert_array_equal(read_particles(folder / "s01_local.particles"), result.local[1])
    assert len(list(folder.iterdir())) == 12
    _, folder, _ = export("particles", "world", "--progress", "none")
    np.testing.assert_allclose(read_particles(folder / "mean_world.particles"), result.world.mean(axis=0))
    _, folder, _ = export("markups", "markups", "--progress", "none")
    (markup,) = json.loads((folder / "s02.mrk.json").read_text())["markups"]
    positions = [item["position"] for item in markup["controlPoints"]]
    np.testing.assert_array_equal(positions, result.world[2])
    assert markup["coordinateSystem"] == "LPS"
    _, folder, _ = export("morphometrics", "morphometrics", "--progress", "none")
    first = (folder / "particles.tps").read_text().splitlines()[1]
    assert [float(value) for value in first.split()] == result.world[0, 0].tolist()


def test_a_shapeworks_project_refers_to_its_own_files(export):
    code, folder, _ = export("shapeworks", "shapes", "--progress", "none")
    assert code == 0
    (path,) = folder.glob("*.swproj")
    for row in json.loads(path.read_text())["data"]:
        for key, value in row.items():
            if key.startswith(("local_particles", "world_particles", "groomed")):
                assert (folder / value).is_file(), value


def test_a_folder_that_holds_anything_is_not_written_to(export, tmp_path):
    (tmp_path / "out" / "mine").mkdir(parents=True)
    (tmp_path / "out" / "mine" / "notes.txt").write_text("keep")
    code, folder, said = export("particles", "mine", "--progress", "none")
    assert code == 2
    assert "already exists" in said
    assert [path.name for path in folder.iterdir()] == ["notes.txt"]


@pytest.mark.skipif(sys.platform == "win32", reason="processes can't be asked to end there")
def test_an_export_that_is_told_to_end_leaves_nothing(project, tmp_path):
    arguments = [
        "export",
        "film",
        str(project.folder),
        "--mode",
        "1",
        "--seconds",
        "600",
        "--progress",
        "json",
    ]
    out = tmp_path / "film.mp4"
    command = [sys.executable, "-m", "homolog_app", *arguments, *SMALL[:4], "--out", str(out)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        for line in process.stdout:
            if json.loads(line)["message"].startswith("frame 3"):
                break
        assert list(tmp_path.iterdir())
        process.send_signal(signal.SIGTERM)
        started = time.monotonic()
        process.communicate(timeout=60)
    assert process.returncode == 130
    assert time.monotonic() - started < 30.0
    assert not list(tmp_path.iterdir())


def test_the_help_of_every_kind_names_its_options(capsys):
    for what, options in (
        ("film", "--turntable"),
        ("still", "--transparent"),
        ("meshes", "--format"),
        ("plot", "--kind"),
    ):
        with pytest.raises(SystemExit):
            main(["export", what, "--help"])
        said = capsys.readouterr().out
        assert options in said
        assert "--out" in said
