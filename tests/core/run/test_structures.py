"""Runs of several structures: what comes in, what is on disk, and who is left out."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

from homolog.cohort import Cohort, read_cohort
from homolog.errors import InputError
from homolog.geometry import transform_points
from homolog.io.markups import write_markups
from homolog.io.meshes import read_mesh, write_mesh
from homolog.io.project import ProjectFolder
from homolog.io.results import read_result, read_surface
from homolog.run import FinishReason, Run, adds_particles, is_result_of
from homolog.run.repair import inspect_project, repaired, write_repaired
from homolog.surfaces.mesh import TriangleMesh


def ellipsoid(ball, axes, centre):
    return TriangleMesh(ball.vertices * axes + centre, ball.faces)


@pytest.fixture(scope="module")
def folder(tmp_path_factory, ellipsoids):
    """Return a folder with a folder a subject, and a file a structure in it."""
    from homolog.samples.solids import ellipsoid as level_of
    from homolog.samples.solids import surface_of

    line = np.arange(-1.4, 1.4, 0.1)
    grid = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1)
    ball = surface_of(level_of(grid, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), np.full(3, -1.4), 0.1, 400)
    place = tmp_path_factory.mktemp("structures") / "scans"
    for k, name in enumerate("abcd"):
        (place / name).mkdir(parents=True)
        write_mesh(place / name / "long.ply", ellipsoid(ball, (9.0, 6.0, 6.0 + k), (0.0, 0.0, 0.0)))
        write_mesh(place / name / "flat.ply", ellipsoid(ball, (3.0, 6.0, 5.0), (14.0 + k, 0.0, 0.0)))
    return place


@pytest.fixture(scope="module")
def settings(short_settings):
    groom = short_settings.groom.model_copy(update={"structures": "long,flat"})
    return short_settings.model_copy(update={"groom": groom})


@pytest.fixture(scope="module")
def project(folder, settings):
    done = ProjectFolder(folder.parent / "project")
    assert Run(done, read_cohort(folder), settings).execute() is FinishReason.COMPLETED
    return done


def test_a_result_has_the_particles_of_all_structures_as_they_lie_in_the_body(project, folder):
    result = read_result(project)
    assert [(part.name, part.particles) for part in result.parts] == [
        ("long", slice(0, 48)),
        ("flat", slice(48, 96)),
    ]
    assert result.world.shape == (4, 96, 3)
    assert np.allclose(transform_points(result.alignments, result.local), result.world, atol=1e-9)
    middles = [result.local[:, part.particles].mean(axis=1)[:, 0] for part in result.parts]
    assert np.allclose(middles[1] - middles[0], [14.0, 15.0, 16.0, 17.0], atol=0.5)


def test_each_structure_is_a_project_of_its_own(project):
    result = read_result(project)
    for part in result.parts:
        own = project.structure(part.name)
        alone = read_result(own)
        assert alone.names == result.names
        assert np.array_equal(alone.local, result.local[:, part.particles])
        surface = read_surface(own, own.read().result.subjects[0])
        gaps = np.linalg.norm(alone.local[0][:, None] - surface.vertices, axis=2).min(axis=1)
        assert gaps.max() < surface.mean_edge
        assert own.cohort().subjects[0].structures[part.name].is_file()


def test_surfaces_have_a_piece_for_each_structure(project):
    result = read_result(project)
    for index, subject in enumerate(project.read().result.subjects):
        pieces = [
            read_surface(
                project.structure(part.name),
                project.structure(part.name).read().result.subjects[index],
            )
            for part in result.parts
        ]
        whole = read_surface(project, subject)
        assert np.array_equal(whole.vertices, np.concatenate([piece.vertices for piece in pieces]))
    mean = result.mean_surface
    for part in result.parts:
        faces = np.isin(mean.faces, np.arange(part.vertices.start, part.vertices.stop))
        assert np.array_equal(faces.any(axis=1), faces.all(axis=1))


def test_the_surfaces_of_a_mode_move_each_structure_with_its_own_particles(project):
    result = read_result(project)
    mode = read_mesh(project.model / "mode_01_plus_2sd.vtp")
    moved = mode.vertices - result.mean_surface.vertices
    means = [np.linalg.norm(moved[part.vertices], axis=1).mean() for part in result.parts]
    assert min(means) > 0.0


def test_a_result_of_the_same_files_and_structures_is_known(project, folder, settings):
    cohort = read_cohort(folder)
    assert is_result_of(project, cohort, settings)
    turned = settings.model_copy(
        update={"groom": settings.groom.model_copy(update={"structures": "flat,long"})}
    )
    assert not is_result_of(project, cohort, turned)


def test_a_cancelled_run_of_several_structures_goes_on(project, folder, settings, tmp_path):
    from homolog.run import Phase

    again = ProjectFolder(tmp_path / "again")
    run = Run(again, read_cohort(folder), settings)
    reason = run.execute(lambda status: run.cancel() if status.phase is Phase.OPTIMIZING else None)
    assert reason is FinishReason.CANCELLED
    assert run.keep()
    kept = read_result(again)
    assert again.read().unfinished
    assert [part.name for part in kept.parts] == ["long", "flat"]
    assert np.allclose(transform_points(kept.alignments, kept.local), kept.world, atol=1e-9)
    for part in kept.parts:
        own = read_result(again.structure(part.name))
        assert np.allclose(own.local, kept.local[:, part.particles], atol=1e-6)
        assert np.allclose(transform_points(own.alignments, own.local), own.world, atol=1e-9)
    assert Run(again, again.cohort(), settings, resume=True).execute() is FinishReason.COMPLETED
    assert np.array_equal(read_result(again).local, read_result(project).local)


def test_a_subject_without_a_structure_is_named_and_can_be_left_out(folder, settings, tmp_path):
    shutil.copytree(folder, tmp_path / "scans")
    (tmp_path / "scans" / "b" / "flat.ply").unlink()
    cohort = read_cohort(tmp_path / "scans")
    run = Run(ProjectFolder(tmp_path / "project"), cohort, settings)
    with pytest.raises(InputError) as refused:
        run.execute()
    assert len(str(refused.value).splitlines()) == 1
    assert "has no file of 'flat'" in str(refused.value)
    kept = Run(ProjectFolder(tmp_path / "project"), cohort, settings, skip_bad=True)
    assert kept.execute() is FinishReason.COMPLETED
    assert read_result(kept.project).names == ("a", "c", "d")
    structures = {name: read_result(kept.project.structure(name)) for name in ("long", "flat")}
    assert structures["long"].names == ("a", "b", "c", "d")
    assert structures["flat"].names == ("a", "c", "d")
    assert np.array_equal(structures["long"].local[[0, 2, 3]], read_result(kept.project).local[:, :48])
    assert list(kept.project.structure("flat").read().excluded) == ["b"]
    assert [item.name for item in kept.project.cohort().subjects] == ["a", "b", "c", "d"]


def test_structures_in_different_frames_are_refused_or_left_out(folder, settings, tmp_path):
    shutil.copytree(folder, tmp_path / "scans")
    place = tmp_path / "scans" / "c" / "flat.ply"
    mesh = read_mesh(place)
    write_mesh(place, TriangleMesh(mesh.vertices + np.array([300.0, 0.0, 0.0]), mesh.faces))
    project, cohort = ProjectFolder(tmp_path / "project"), read_cohort(tmp_path / "scans")
    with pytest.raises(InputError) as refused:
        Run(project, cohort, settings).execute()
    assert str(refused.value).startswith("c: its long and flat lie 316 mm apart")
    assert len(str(refused.value).splitlines()) == 1
    Run(project, cohort, settings, skip_bad=True).execute()
    assert read_result(project).names == ("a", "b", "d")
    assert list(project.read().excluded) == ["c"]


def test_an_unknown_structure_to_align_by_is_refused(folder, settings, tmp_path):
    optimize = settings.optimize.model_copy(update={"align_by": "round"})
    run = Run(
        ProjectFolder(tmp_path), read_cohort(folder), settings.model_copy(update={"optimize": optimize})
    )
    with pytest.raises(InputError, match="round: is none of the structures: long, flat"):
        run.execute()


def test_poses_of_the_structures_are_written_apart_from_their_shapes(project):
    import csv

    with (project.model / "pose.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert [(row["name"], row["structure"]) for row in rows[:2]] == [("a", "long"), ("a", "flat")]
    shifts = [float(row["translation_x_mm"]) for row in rows if row["structure"] == "flat"]
    assert np.allclose(shifts, [-1.5, -0.5, 0.5, 1.5], atol=0.4)
    with (project.model / "components.csv").open() as stream:
        whole, *components = list(csv.DictReader(stream))
    assert whole["component"] == "all"
    parts = ["pose flat", "shape long", "shape flat"]
    assert np.isclose(sum(float(whole[part]) for part in parts), 1.0)
    assert np.isclose(sum(float(row["share"]) for row in components), 1.0)


def test_a_project_opened_in_python_has_its_structures_and_their_poses(project):
    import homolog as hl

    opened = hl.Project(project.folder)
    assert list(opened.structures) == ["long", "flat"]
    assert opened.structures["flat"].particles.shape == (4, 48, 3)
    assert opened.relative_poses("flat").rotations.shape == (4, 2, 3)
    with pytest.raises(InputError, match="long, flat"):
        opened.relative_poses("round")
    with pytest.raises(InputError, match="a single structure"):
        opened.structures["flat"].relative_poses()


def changed(settings, **optimize):
    return settings.model_copy(update={"optimize": settings.optimize.model_copy(update=optimize)})


def test_a_new_subject_is_fitted_and_the_others_stay_as_they_are(folder, settings, tmp_path):
    cohort = read_cohort(folder)
    project = ProjectFolder(tmp_path / "project")
    Run(project, cohort.without({"d"}), settings).execute()
    before = read_result(project)
    Run(project, cohort, settings, from_result=True).execute()
    after = read_result(project)
    assert after.names == ("a", "b", "c", "d")
    assert np.array_equal(after.local[:3], before.local)
    assert np.array_equal(after.alignments[:3], before.alignments)
    for part in after.parts:
        own = read_result(project.structure(part.name))
        assert np.array_equal(own.local, after.local[:, part.particles])
    surface = read_surface(project, project.read().result.subjects[3])
    gaps = np.linalg.norm(after.local[3][:, None] - surface.vertices, axis=2).min(axis=1)
    assert gaps.max() < surface.mean_edge


def test_a_new_subject_without_a_structure_is_fitted_to_the_others(folder, settings, tmp_path):
    shutil.copytree(folder, tmp_path / "scans")
    (tmp_path / "scans" / "d" / "flat.ply").unlink()
    cohort = read_cohort(tmp_path / "scans")
    project = ProjectFolder(tmp_path / "project")
    Run(project, cohort.without({"d"}), settings).execute()
    before = read_result(project)
    Run(project, cohort, settings, from_result=True, skip_bad=True).execute()
    assert np.array_equal(read_result(project).local, before.local)
    assert read_result(project.structure("long")).names == ("a", "b", "c", "d")
    assert read_result(project.structure("flat")).names == ("a", "b", "c")


def test_particles_are_added_to_one_of_the_structures(folder, settings, tmp_path):
    project = ProjectFolder(tmp_path / "project")
    cohort = read_cohort(folder)
    few = changed(settings, structure_particles="flat=24")
    Run(project, cohort, few).execute()
    assert [part.particles for part in read_result(project).parts] == [slice(0, 48), slice(48, 72)]
    assert adds_particles(project.read().result, cohort, settings)
    assert not adds_particles(project.read().result, cohort, few)
    Run(project, cohort, settings, from_result=True).execute()
    assert [part.particles for part in read_result(project).parts] == [slice(0, 48), slice(48, 96)]


def test_a_core_set_of_several_structures_gives_all_subjects_particles(folder, settings, tmp_path):
    project = ProjectFolder(tmp_path / "project")
    Run(project, read_cohort(folder), changed(settings, core_set=3)).execute()
    result = read_result(project)
    assert result.names == ("a", "b", "c", "d")
    assert np.allclose(transform_points(result.alignments, result.local), result.world, atol=1e-9)
    for part in result.parts:
        own = read_result(project.structure(part.name))
        assert np.array_equal(own.local, result.local[:, part.particles])
    middles = [result.world[:, part.particles].mean(axis=1) for part in result.parts]
    assert np.allclose(np.linalg.norm(middles[1] - middles[0], axis=1), [14.0, 15.0, 16.0, 17.0], atol=0.5)
    assert np.ptp(middles[0], axis=0).max() < 2.0


def test_a_landmark_belongs_to_the_structure_on_which_it_lies(folder, settings, tmp_path):
    shutil.copytree(folder, tmp_path / "scans")
    files = {name: tmp_path / "scans" / name / f"{name}.mrk.json" for name in "abcd"}
    for k, file in enumerate(files.values()):
        write_markups(file, np.array([[9.0, 0.0, 0.0], [17.0 + k, 0.0, 0.0]]), ["tip", "side"])
    cohort = read_cohort(tmp_path / "scans")
    marked = Cohort(
        tuple(replace(item, landmarks=files[item.name]) for item in cohort.subjects), cohort.folder
    )
    project = ProjectFolder(tmp_path / "project")
    Run(project, marked, changed(settings, landmarks=True)).execute()
    result = read_result(project)
    first = {part.name: result.local[:, part.particles.start] for part in result.parts}
    assert np.allclose(first["long"], [9.0, 0.0, 0.0], atol=2.5)
    assert np.allclose(first["flat"], [[17.0 + k, 0.0, 0.0] for k in range(4)], atol=2.5)


def test_settings_of_an_unknown_structure_are_refused(folder, settings, tmp_path):
    groom = settings.groom.model_copy(update={"structure_grooming": "round:smoothing=0.5"})
    run = Run(ProjectFolder(tmp_path), read_cohort(folder), settings.model_copy(update={"groom": groom}))
    with pytest.raises(InputError, match="round: is none of the structures"):
        run.execute()


def test_suspects_of_all_structures_are_found_and_repaired_in_the_model_of_all(project, tmp_path):
    shutil.copytree(project.folder, tmp_path / "again")
    again = ProjectFolder(tmp_path / "again")
    local = {
        part.name: read_result(again.structure(part.name)).local.copy() for part in read_result(again).parts
    }
    first = np.linalg.norm(local["flat"][1] - local["flat"][1][0], axis=1)
    near = int(np.argsort(first)[1])
    local["flat"][1][[0, near]] = local["flat"][1][[near, 0]]  # exchanged in one subject
    write_repaired(again, local, {"b": "exchanged"})
    found = inspect_project(again)
    assert set(found) == {"long", "flat"}
    suspect = found["flat"][1].suspects[0]
    assert found["flat"][0].names[suspect.subject] == "b"
    assert {0, near} <= set(suspect.particles.tolist())
    better = repaired(again.structure("flat"), found["flat"][1], suspect)
    write_repaired(again, {**local, "flat": better.located.local}, {"b": "optimized again"})
    mended = read_result(again)
    gone = np.linalg.norm(mended.local[1, 48] - read_result(project).local[1, 48])
    assert gone < 0.5 * np.linalg.norm(local["flat"][1][0] - local["flat"][1][near])
    assert np.array_equal(mended.local[:, :48], read_result(project).local[:, :48])
    assert np.array_equal(mended.local[:, 48:], read_result(again.structure("flat")).local)
    assert np.allclose(transform_points(mended.alignments, mended.local), mended.world, atol=1e-9)
