import os
import shutil
import time
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace

import numpy as np
import pytest

from homolog.cohort import Cohort, Subject, read_cohort
from homolog.errors import Cancelled, InputError, NumericalError
from homolog.grooming import Reading, check_cohort, groom_cohort
from homolog.io.images import Segmentation
from homolog.io.meshes import read_mesh
from homolog.settings import GroomSettings
from homolog.surfaces.mesh import TriangleMesh

SETTINGS = GroomSettings(mesh_edge=2.0)


class Here(Executor):
    """Does the work at once, and counts it."""

    def __init__(self):
        self.names = []

    def submit(self, function, /, *arguments, **named):
        self.names.append(arguments[0][0].name)
        future = Future()
        try:
            future.set_result(function(*arguments, **named))
        except Exception as error:  # noqa: BLE001 - an executor hands over whatever happens
            future.set_exception(error)
        return future


@pytest.fixture
def cohort(sphere_volume, tmp_path):
    for name, radius in (("b.nrrd", 6.0), ("a.nrrd", 8.0), ("c.nii.gz", 7.0)):
        sphere_volume(name, radius)
    return read_cohort(tmp_path)


def test_results_come_in_the_cohorts_order(cohort):
    result = groom_cohort(cohort, SETTINGS, executor=Here())
    assert [item.name for item in result] == ["a", "b", "c"]
    assert result[0].mesh.volume > result[2].mesh.volume > result[1].mesh.volume


def test_fresh_processes_give_the_same_bits_as_this_one(cohort):
    fresh = groom_cohort(cohort, SETTINGS)
    for item, other in zip(fresh, groom_cohort(cohort, SETTINGS, executor=Here()), strict=True):
        assert np.array_equal(item.field.values, other.field.values)
        assert np.array_equal(item.mesh.vertices, other.mesh.vertices)
        assert not item.mesh.vertices.flags.writeable


@pytest.mark.parametrize(("rings", "noted"), [(1, ["ring0"]), (2, [])])
def test_a_shape_with_a_hole_among_shapes_without_gets_a_note(tmp_path, grid, rings, noted):
    points = grid(12.0)
    apart = np.hypot(np.hypot(points[..., 0], points[..., 1]) - 7.0, points[..., 2])
    shapes = {f"ring{i}": apart < 3.0 + 0.1 * i for i in range(rings)}
    shapes |= {f"s{i}": np.linalg.norm(points, axis=-1) < 6.0 + 0.2 * i for i in range(4 - rings)}
    sources = {name: Segmentation(mask, np.eye(3), np.ones(3), np.zeros(3)) for name, mask in shapes.items()}
    cohort = Cohort(tuple(Subject(name, tmp_path / name) for name in sources), tmp_path)
    groomed = groom_cohort(cohort, SETTINGS, executor=Here(), sources=sources)
    assert [item.name for item in groomed if any("handle" in note for note in item.report.notes)] == noted


def test_the_same_voxels_in_another_format_are_noted_on_the_second_subject(cohort, sphere_volume):
    sphere_volume("d.nii.gz", 8.0)
    sphere_volume("e.nrrd", 8.1)
    notes = [
        item.report.notes for item in groom_cohort(read_cohort(cohort.folder), SETTINGS, executor=Here())
    ]
    assert [len(item) for item in notes[:3]] == [0, 0, 0]
    assert "identical to that of a" in notes[3][0]
    assert not notes[4]


def test_a_file_that_is_there_twice_is_noted_on_the_second_subject(cohort, tmp_path):
    shutil.copy(tmp_path / "a.nrrd", tmp_path / "d.nrrd")
    for _ in range(2):  # also of what is groomed already
        groomed = groom_cohort(read_cohort(tmp_path), SETTINGS, executor=Here(), cache=tmp_path / "groomed")
        assert [[" of a;" in note for note in item.report.notes] for item in groomed] == [[], [], [], [True]]


def test_what_was_groomed_is_not_groomed_again(cohort, tmp_path):
    readings: dict[str, Reading] = {}
    check_cohort(cohort, SETTINGS, readings=readings)
    first, second = Here(), Here()
    made = groom_cohort(cohort, SETTINGS, executor=first, cache=tmp_path / "groomed")
    result = groom_cohort(cohort, SETTINGS, executor=second, cache=tmp_path / "groomed", readings=readings)
    assert first.names == ["a", "b", "c"]
    assert second.names == []
    for item, other in zip(made, result, strict=True):
        assert np.array_equal(item.field.values, other.field.values)
        assert np.array_equal(item.field.index_to_world, other.field.index_to_world)
        assert np.array_equal(item.mesh.faces, other.mesh.faces)
        assert np.array_equal(item.coarse_mesh.vertices, other.coarse_mesh.vertices)
        assert item.report == other.report


def test_the_surfaces_are_there_for_other_programs(cohort, tmp_path):
    made = groom_cohort(cohort, SETTINGS, executor=Here(), cache=tmp_path / "groomed")
    for item in made:
        assert np.allclose(read_mesh(tmp_path / "groomed" / f"{item.name}.vtp").vertices, item.mesh.vertices)


def test_only_what_changed_is_groomed_again(cohort, tmp_path, sphere_volume):
    groom_cohort(cohort, SETTINGS, executor=Here(), cache=tmp_path / "groomed")
    sphere_volume("b.nrrd", 5.0)
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "groomed").glob("*.npz")}
    result = groom_cohort(cohort, SETTINGS, executor=Here(), cache=tmp_path / "groomed")
    assert [path.stem for path, time in before.items() if path.stat().st_mtime_ns != time] == ["b"]
    assert result[1].mesh.volume == pytest.approx(4 / 3 * np.pi * 5.0**3, rel=0.2)


def test_a_file_that_changed_since_it_was_groomed_gets_a_note(cohort, tmp_path, sphere_volume, caplog):
    groom_cohort(cohort, SETTINGS, executor=Here(), cache=tmp_path / "groomed")
    sphere_volume("b.nrrd", 5.0)
    result = groom_cohort(cohort, SETTINGS, executor=Here(), cache=tmp_path / "groomed")
    assert ["has changed" in " ".join(item.report.notes) for item in result] == [False, True, False]
    assert caplog.messages == [f"b: {result[1].report.notes[-1]}"]
    other = SETTINGS.model_copy(update={"smoothing": 0.5})
    result = groom_cohort(cohort, other, executor=Here(), cache=tmp_path / "groomed")
    assert not any("has changed" in " ".join(item.report.notes) for item in result)


def test_what_was_read_in_the_check_is_groomed_though_the_file_is_gone(cohort, tmp_path):
    expected = groom_cohort(cohort, SETTINGS, executor=Here())
    readings = {}
    assert check_cohort(cohort, SETTINGS, readings=readings) == []
    for subject in cohort.subjects:
        subject.path.unlink()
    cache = tmp_path / "groomed"
    for _ in range(2):  # the second time from the cache
        groomed = groom_cohort(cohort, SETTINGS, executor=Here(), cache=cache, readings=readings)
        for first, second in zip(expected, groomed, strict=True):
            assert np.array_equal(first.mesh.vertices, second.mesh.vertices)
            assert first.report == second.report


def test_a_damaged_entry_of_the_cache_is_groomed_again(cohort, tmp_path):
    cache = tmp_path / "groomed"
    groom_cohort(cohort, SETTINGS, executor=Here(), cache=cache)
    stored = dict(np.load(cache / "b.npz"))
    del stored["faces"]
    np.savez(cache / "b.npz", **stored)
    groomed = groom_cohort(cohort, SETTINGS, executor=Here(), cache=cache)
    assert [item.name for item in groomed] == ["a", "b", "c"]
    assert "faces" in np.load(cache / "b.npz")


def test_what_cannot_be_groomed_is_raised_or_left_out_by_name(cohort):
    class Failing(Here):
        def submit(self, function, /, *arguments, **named):
            if arguments[0][0].name != "b":
                return super().submit(function, *arguments, **named)
            future = Future()
            future.set_exception(NumericalError("b: is too small"))
            return future

    problems = []
    with pytest.raises(NumericalError, match="b: is too small"):
        groom_cohort(cohort, SETTINGS, executor=Failing())
    groomed = groom_cohort(cohort, SETTINGS, executor=Failing(), left_out=problems)
    assert [item.name for item in groomed] == ["a", "c"]
    assert [(problem.subject, problem.message) for problem in problems] == [("b", "b: is too small")]


def test_names_do_not_lead_out_of_the_cache(cohort, tmp_path):
    evil = Cohort((replace(cohort.subjects[0], name="../../evil"),), cohort.folder)
    for _ in range(2):
        (groomed,) = groom_cohort(evil, SETTINGS, executor=Here(), cache=tmp_path / "deep" / "groomed")
        assert groomed.name == "../../evil"
    made = [path.parent.name for path in tmp_path.rglob("*evil*")]
    assert made == ["groomed"] * 2


def test_a_damaged_archive_is_made_anew(cohort, tmp_path):
    groom_cohort(cohort, SETTINGS, executor=Here(), cache=tmp_path / "groomed")
    for name, damage in (("a", b""), ("b", b"PK\x03\x04 nonsense")):
        (tmp_path / "groomed" / f"{name}.npz").write_bytes(damage)
    whole = (tmp_path / "groomed" / "c.npz").read_bytes()
    (tmp_path / "groomed" / "c.npz").write_bytes(whole[: len(whole) // 2])
    again = Here()
    groom_cohort(cohort, SETTINGS, executor=again, cache=tmp_path / "groomed")
    assert again.names == ["a", "b", "c"]


def test_every_bad_file_is_listed_before_any_work(cohort, tmp_path, save):
    save(np.zeros((4, 4, 4), np.uint8), "empty.nrrd")
    (tmp_path / "a.nrrd").write_text("NRRD0004\n")
    (tmp_path / "points.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n")
    (tmp_path / "text.stl").write_text("no mesh at all")
    problems = check_cohort(read_cohort(tmp_path), SETTINGS)
    assert [item.subject for item in problems] == ["a", "empty", "points", "text"]
    for problem, file in zip(problems, ("a.nrrd", "empty.nrrd", "points.obj", "text.stl"), strict=True):
        assert str(tmp_path / file) in problem.message
        assert "\n" not in problem.message


class Mine(TriangleMesh):
    """A surface that ends the process that unpacks it, as a reader of files may."""

    def __reduce__(self):
        return os._exit, (1,)


def test_a_file_that_ends_the_process_that_reads_it_is_a_problem_of_its_own(cohort):
    mesh = TriangleMesh(np.eye(3), np.array([[0, 1, 2]]))
    (problem,) = check_cohort(cohort, SETTINGS, sources={"b": Mine(mesh.vertices, mesh.faces)})
    assert problem.subject == "b"
    assert "the process that read it ended" in problem.message


def test_a_good_cohort_has_no_problem(cohort):
    assert check_cohort(cohort, SETTINGS) == []


def test_the_first_error_ends_the_work_and_names_the_subject(cohort):
    with pytest.raises(InputError, match="a: needs a grid"):
        groom_cohort(cohort, GroomSettings(spacing=0.005), executor=Here())


def test_cancelling_ends_the_wait_at_once_and_writes_nothing_more(cohort, tmp_path):
    class Slow(ThreadPoolExecutor):
        def submit(self, function, /, *arguments, **named):
            return super().submit(time.sleep, 2.0)

    started = time.monotonic()

    def tick(fraction, message):
        if time.monotonic() > started + 0.3:
            raise Cancelled

    with Slow(1) as slow:
        with pytest.raises(Cancelled):
            groom_cohort(cohort, SETTINGS, executor=slow, cache=tmp_path / "groomed", tick=tick)
        assert time.monotonic() - started < 1.5
    assert not (tmp_path / "groomed").exists()


def test_ticks_rise_from_zero_to_one_and_name_a_subject(cohort):
    seen = []
    groom_cohort(
        cohort, SETTINGS, executor=Here(), tick=lambda fraction, message: seen.append((fraction, message))
    )
    fractions = [fraction for fraction, _ in seen]
    assert fractions == sorted(fractions)
    assert 0.0 <= fractions[0] <= fractions[-1] <= 1.0
    assert seen[0][1] == "grooming a"


def test_a_worker_that_dies_is_explained(cohort):
    class Dying(Executor):
        def submit(self, function, /, *arguments, **named):
            future = Future()
            future.set_exception(BrokenProcessPool("gone"))
            return future

    with pytest.raises(NumericalError, match="fewer workers"):
        groom_cohort(cohort, SETTINGS, executor=Dying())


def test_a_subject_in_another_unit_is_left_out_like_one_that_cannot_be_groomed(cohort):
    problems = []
    subject = groom_cohort(cohort, SETTINGS, executor=Here())[0]
    huge = replace(subject.report, volume_after=1e7 * subject.report.volume_after)

    def enlarged(item):
        return replace(item, report=huge) if item.name == "b" else item

    groomed = groom_cohort(cohort, SETTINGS, executor=Here(), left_out=problems, reduced=enlarged)
    assert [item.name for item in groomed] == ["a", "c"]
    assert [problem.subject for problem in problems] == ["b"]


@pytest.mark.parametrize(("pairs", "refused"), [(1, []), (2, ["a", "b"])])
def test_two_organs_under_one_label_are_refused_where_most_subjects_have_them(cohort, pairs, refused):
    mask = np.zeros((20, 8, 8), bool)
    mask[2:9, 2:6, 2:6] = mask[11:17, 2:6, 2:6] = True
    pair = Segmentation(mask, np.eye(3), np.ones(3), np.zeros(3))
    sources = dict.fromkeys("ab"[:pairs], pair)
    assert [problem.subject for problem in check_cohort(cohort, SETTINGS, sources=sources)] == refused
