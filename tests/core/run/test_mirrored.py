"""Runs of left and right subjects together."""

import shutil

import numpy as np
import pytest
import SimpleITK

from homolog.cohort import read_cohort
from homolog.errors import InputError
from homolog.grooming import groom_cohort
from homolog.inspection import inspect
from homolog.io.meshes import read_mesh
from homolog.io.project import ProjectFolder
from homolog.io.records import ProjectRecord
from homolog.io.results import read_result, read_surface, read_surfaces
from homolog.io.shapeworks import read_shapeworks_file
from homolog.io.shapeworks_export import write_shapeworks
from homolog.registration import align_cohort
from homolog.run import Run
from homolog.run.repair import read_inputs, repair_result
from homolog.settings import GroomSettings, Mirror, OptimizeSettings, RunSettings

NAMES = ("a_R", "b_L", "c_R", "d_L", "e_R")
LEFT = np.array(["_L" in name for name in NAMES])
SETTINGS = RunSettings(
    groom=GroomSettings(alignment="icp", mesh_edge=2.0),
    optimize=OptimizeSettings(particles=32, split_iterations=10, anneal_iterations=40, settle_iterations=40),
    device="cpu",
    workers=1,
)
OFF = SETTINGS.model_copy(update={"groom": SETTINGS.groom.model_copy(update={"mirror": Mirror.OFF})})


def write_scan(folder, name, number, *, mirrored):
    """Write a bent, bumpy body that is unlike its mirror image; one of another side lies at negative x."""
    grid = np.stack(np.meshgrid(*[np.arange(-18.0, 19.0)] * 3, indexing="ij"))
    x, y, z = grid[0] - 0.04 * np.square(grid[2]), grid[1], grid[2]
    body = np.square(x / 6.0) + np.square(y / 5.0) + np.square(z / 14.0) <= 1.0
    bump = np.square(x - 5.0) + np.square(y - 3.0) + np.square(z - 7.0) <= (4.0 + 0.4 * number) ** 2
    foot = np.square(x) + np.square(y - 5.0) + np.square(z + 9.0) <= 9.0
    mask = (body | bump | foot).astype(np.uint8)
    image = SimpleITK.GetImageFromArray((mask[::-1] if mirrored else mask).T)
    image.SetOrigin([-58.0 if mirrored else 22.0, -18.0, -18.0])
    SimpleITK.WriteImage(image, folder / f"{name}.nrrd")


def finished(folder, cohort, settings=SETTINGS):
    project = ProjectFolder(folder)
    Run(project, read_cohort(cohort), settings).execute()
    return project


def groomed(project, folder):
    """Return a project in which nothing but the shapes of another one is groomed and registered."""
    copy = ProjectFolder(folder)
    shutil.copytree(project.groomed, copy.groomed)
    shutil.copy(project.registrations, copy.registrations)
    copy.write(ProjectRecord())
    return copy


@pytest.fixture(scope="module")
def scans(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sides")
    for kind in ("both", "one"):
        (folder / kind).mkdir()
        for number, name in enumerate(NAMES):
            write_scan(folder / kind, name, number, mirrored=kind == "both" and "_L" in name)
        sides = [f"{name},{name[-1]}" for name in (*NAMES, "f_L")]
        (folder / kind / "cohort.csv").write_text("\n".join(["name,side", *sides]))
    return folder


@pytest.fixture(scope="module")
def both(scans):
    """Return a finished run of left and right bodies, as their table says."""
    return finished(scans / "p_both", scans / "both")


@pytest.fixture(scope="module")
def one_side(scans):
    """Return a finished run of the same bodies, all of one side."""
    return finished(scans / "p_one", scans / "one", OFF)


@pytest.fixture(scope="module")
def result(both):
    return read_result(both)


def record_of(project):
    record = project.read().result
    assert record is not None
    return record


def test_the_rarer_side_is_mirrored_and_every_alignment_is_true(result):
    assert np.array_equal(np.linalg.det(result.alignments[:, :3, :3]) < 0.0, LEFT)
    turned = np.einsum("mij,mnj->mni", result.alignments[:, :3, :3], result.local)
    assert np.allclose(turned + result.alignments[:, None, :3, 3], result.world, atol=1e-6)


def test_local_particles_lie_on_the_surface_of_the_file(result):
    assert (result.local[LEFT, :, 0] < -20.0).all()
    assert (result.local[~LEFT, :, 0] > 20.0).all()


def test_left_and_right_give_the_model_that_one_side_gives(both, result, one_side):
    usual = read_result(one_side)
    there = np.where(LEFT[:, None, None], result.local * [-1.0, 1.0, 1.0], result.local)
    # Voxels are the same, but meshes of mirror images are triangulated otherwise.
    away = np.linalg.norm(there - usual.local, axis=2)
    spacing = np.sqrt(read_surfaces(both)[0].area / away.shape[1])
    assert np.median(away) < 0.25 * spacing
    spread = [np.var(item.world, axis=0).sum() for item in (result, usual)]
    assert spread[0] == pytest.approx(spread[1], rel=0.25)


def test_without_mirroring_left_and_right_are_mixed_up(scans, both, result):
    mixed = finished(groomed(both, scans / "p_mixed").folder, scans / "both", OFF)
    assert record_of(mixed).mirrored_text == ""
    assert np.var(read_result(mixed).world, axis=0).sum() > 2.0 * np.var(result.world, axis=0).sum()


def test_the_record_says_who_was_mirrored(both):
    record = record_of(both)
    assert record.mirrored_text.startswith("2 left")
    assert [
        subject.name for subject in record.subjects if any("mirrored" in note for note in subject.notes)
    ] == [
        "b_L",
        "d_L",
    ]


def test_surfaces_face_outward_in_both_frames(both, result):
    assert all(surface.volume > 0.0 for surface in read_surfaces(both))
    assert all(read_surface(both, subject).volume > 0.0 for subject in record_of(both).subjects)
    assert read_mesh(both.model / "mean.vtp").volume > 0.0


def test_nothing_is_suspect_about_mirrored_subjects(both, result):
    meshes = [read_surface(both, subject) for subject in record_of(both).subjects]
    actual = inspect(result.local, meshes, result.alignments, names=result.names)
    outward = [
        np.einsum("ni,ni->n", normals, points - points.mean(axis=0)).mean()
        for normals, points in zip(actual.located.normals, result.world, strict=True)
    ]
    assert min(outward) > 0.0
    assert not [suspect for suspect in actual.suspects if suspect.kind.value != "uncovered"]


def test_particles_that_are_optimized_again_keep_their_frame(both, result, tmp_path):
    movable = np.zeros(result.local.shape[:2], dtype=bool)
    movable[1, :4] = True
    local = repair_result(read_inputs(both), result.local, movable, np.zeros_like(movable))
    assert np.array_equal(local[~movable], result.local[~movable])
    assert np.abs(local[1] - result.local[1]).max() < 6.0


def test_shapeworks_gets_the_reflection_and_local_particles(both, result, tmp_path):
    rows = read_shapeworks_file(write_shapeworks(both, tmp_path)).rows
    matrices = np.array([np.array(row["alignment_1"].split(), float).reshape(4, 4) for row in rows])
    assert np.allclose(matrices, result.alignments)


@pytest.fixture
def grown(scans, both, tmp_path):
    """Return a copy of the project, and its cohort with a new left subject."""
    shutil.copytree(scans / "both", tmp_path / "both")
    shutil.copytree(both.folder, tmp_path / "p_both")
    write_scan(tmp_path / "both", "f_L", 2, mirrored=True)
    return ProjectFolder(tmp_path / "p_both"), read_cohort(tmp_path / "both")


def test_a_new_left_subject_is_fitted_to_the_right_ones(grown, result):
    project, cohort = grown
    Run(project, cohort, SETTINGS, from_result=True).execute()
    fitted = read_result(project)
    assert np.array_equal(fitted.local[:5], result.local)
    assert np.linalg.det(fitted.alignments[5, :3, :3]) < 0.0
    assert (fitted.local[5, :, 0] < -20.0).all()
    mean = result.world.mean(axis=0)
    assert np.linalg.norm(fitted.world[5] - mean, axis=1).mean() < 3.0


def test_a_core_set_may_be_of_both_sides(scans, both, result, tmp_path):
    project = groomed(both, tmp_path / "p")
    core = SETTINGS.model_copy(update={"optimize": SETTINGS.optimize.model_copy(update={"core_set": 4})})
    Run(project, read_cohort(scans / "both"), core).execute()
    actual = read_result(project)
    assert np.array_equal(np.linalg.det(actual.alignments[:, :3, :3]) < 0.0, LEFT)
    assert (actual.local[LEFT, :, 0] < -20.0).all()
    spread = [np.var(item.world, axis=0).sum() for item in (actual, result)]
    assert spread[0] == pytest.approx(spread[1], rel=0.3)


def test_particles_are_added_to_mirrored_subjects(grown, scans):
    project, _ = grown
    more = SETTINGS.model_copy(update={"optimize": SETTINGS.optimize.model_copy(update={"particles": 48})})
    Run(project, project.cohort(), more, from_result=True).execute()
    result = read_result(project)
    assert result.local.shape[1] == 48
    assert np.array_equal(np.linalg.det(result.alignments[:, :3, :3]) < 0.0, LEFT)


def test_a_cancelled_run_of_both_sides_is_resumed(scans, both, tmp_path):
    project = groomed(both, tmp_path / "p")
    first = Run(project, read_cohort(scans / "both"), SETTINGS)
    first.execute(lambda status: first.cancel() if status.phase == "optimizing" else None)
    assert first.keep()
    assert np.array_equal(np.linalg.det(read_result(project).alignments[:, :3, :3]) < 0.0, LEFT)
    Run(project, project.cohort(), SETTINGS, resume=True).execute()
    assert record_of(project).ended != "cancelled"


def test_a_wrong_side_in_the_table_is_noted(scans, both, tmp_path):
    rows = [f"{name},{scans / 'both' / name}.nrrd,{'R' if name == 'b_L' else name[-1]}" for name in NAMES]
    table = tmp_path / "cohort.csv"
    table.write_text("\n".join(["name,path,side", *rows]) + "\n", encoding="utf-8")
    cohort = read_cohort(table)
    shapes = groom_cohort(cohort, SETTINGS.groom, cache=both.groomed)
    aligned, _ = align_cohort(cohort, shapes, SETTINGS.groom, cache=both.registrations)
    assert [item.name for item in aligned if any("far better" in note for note in item.report.notes)] == [
        "b_L"
    ]


def test_half_of_the_subjects_are_noted_where_nothing_tells_their_side(tmp_path):
    names = "abcdef"
    for number, name in enumerate(names):
        write_scan(tmp_path, name, 0.6 * number, mirrored=number % 2 == 1)
    cohort = read_cohort(tmp_path)
    aligned, alignments = align_cohort(cohort, groom_cohort(cohort, SETTINGS.groom), SETTINGS.groom)
    noted = {item.name for item in aligned if any("far better" in note for note in item.report.notes)}
    assert noted in ({*names[::2]}, {*names[1::2]})
    assert (np.linalg.det(alignments[:, :3, :3]) > 0.0).all()


def test_an_unknown_side_is_refused_before_any_work(scans, tmp_path):
    table = tmp_path / "cohort.csv"
    table.write_text(
        f"name,path,side\na,{scans / 'both' / 'a_R.nrrd'},left\nb,{scans / 'both' / 'b_L.nrrd'},up\n",
        encoding="utf-8",
    )
    with pytest.raises(InputError, match="left or right"):
        finished(tmp_path / "p", table)
    assert not (tmp_path / "p" / "groomed").exists()


def test_projects_without_sides_are_still_read(both):
    old = record_of(both).model_dump(mode="json")
    for subject in old["subjects"]:
        del subject["side"]
    del old["settings"]["groom"]["mirror"]
    assert ProjectRecord.model_validate({"result": old}).result.mirrored_text == "2 subjects were mirrored"
