import json
import os
import subprocess
import sys
import threading
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from homolog.cohort import Cohort, Subject
from homolog.errors import InputError
from homolog.io.project import ProjectFolder
from homolog.io.records import ProjectRecord, ResultRecord, ResultSubject, note_lines
from homolog.settings import RunSettings


def result_of(*names, files=None):
    identity = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
    return ResultRecord(
        finished="2026-01-01T00:00:00+00:00",
        ended="converged",
        iterations=3,
        particles=8,
        metric="geodesic",
        folded_faces=0,
        settings=RunSettings(),
        device="cpu (2 cores)",
        versions={"homolog": "0.1.0"},
        seconds={"reading": 0.5},
        fingerprint="0" * 32,
        subjects=[
            ResultSubject(name=name, file=file, content="0" * 32, alignment=identity)
            for name, file in zip(names, files or names, strict=True)
        ],
    )


def test_a_record_comes_back_as_it_was(tmp_path):
    record = ProjectRecord(unfinished=True, result=result_of("a", "b"))
    ProjectFolder(tmp_path).write(record)
    assert ProjectFolder(tmp_path).read() == record


def noted(**notes):
    result = result_of(*notes)
    subjects = [item.model_copy(update={"notes": notes[item.name]}) for item in result.subjects]
    return result.model_copy(update={"subjects": subjects}).remarks


def test_notes_of_one_kind_share_a_line_with_ranges_of_their_numbers():
    pieces = "{} % of the volume was kept: {}"
    remarks = noted(
        a=[pieces.format(97.4, "1 small piece came loose")],
        b=[pieces.format(100, "12 small pieces came loose"), "its file holds what that of x-01 holds"],
        c=[pieces.format("8e-5", "2 small pieces came loose"), "its file holds what that of x-02 holds"],
    )
    assert remarks == [
        "each of 3 subjects (a, b, …): 8e-5 to 100 % of the volume was kept: 1 to 12 small pieces came loose",
        "b: its file holds what that of x-01 holds",
        "c: its file holds what that of x-02 holds",
    ]


def test_a_line_for_two_subjects_names_both_and_one_number_stays_one():
    assert noted(a=["2 mm apart", "odd"], b=["2 mm apart"]) == ["each of a, b: 2 mm apart", "a: odd"]


def test_a_line_names_as_many_subjects_as_wanted():
    notes = {name: [f"{number} mm apart"] for number, name in enumerate("abc", 2)}
    assert note_lines(notes, 3) == ["each of a, b, c: 2 to 4 mm apart"]


def test_paths_start_at_the_project_and_follow_it_when_both_are_moved(tmp_path):
    (tmp_path / "study" / "scans").mkdir(parents=True)
    project = ProjectFolder(tmp_path / "study" / "project")
    scans = tmp_path / "study" / "scans"
    cohort = Cohort((Subject("a", scans / "a.nrrd", "sick", {"age": "61"}),), scans)
    project.write(ProjectRecord(subjects=project.describe(cohort)))
    assert (
        json.loads((project.folder / "project.json").read_text())["subjects"][0]["path"] == "../scans/a.nrrd"
    )
    (tmp_path / "study").rename(tmp_path / "moved")
    subject = ProjectFolder(tmp_path / "moved" / "project").cohort().subjects[0]
    assert subject.path == (tmp_path / "moved" / "scans" / "a.nrrd").resolve()
    assert (subject.name, subject.group, dict(subject.columns)) == ("a", "sick", {"age": "61"})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"version": 2}, "newer Homolog"),
        ({"version": 0}, "version"),
        ({"format": "other"}, "format"),
        ({"more": 1}, "more"),
        ({"subjects": [{"name": "a"}]}, r"subjects\.0\.path"),
        ({"settings": {"optimize": {"particles": -1}}}, r"settings\.optimize\.particles"),
    ],
)
def test_a_record_that_breaks_the_schema_is_refused_with_the_place(tmp_path, change, message):
    content = json.loads(ProjectRecord().model_dump_json()) | change
    (tmp_path / "project.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match=message):
        ProjectFolder(tmp_path).read()


@pytest.mark.parametrize("stem", ["../a", "/a", "", ".hidden", "a/b", "a\\b", "a\n"])
def test_a_result_cannot_name_files_outside_its_folder(stem):
    with pytest.raises(ValueError, match="file"):
        result_of("a", "b", files=[stem, "b"])


def test_a_result_cannot_name_one_file_twice():
    with pytest.raises(ValueError, match="same file"):
        result_of("a", "b", files=["x", "X"])


@settings(
    deadline=None,  # of a busy machine
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(
    st.one_of(
        st.binary(max_size=200),
        st.recursive(st.none() | st.integers(), st.lists).map(json.dumps).map(str.encode),
    )
)
def test_any_bytes_are_read_or_refused_as_input(tmp_path, content):
    (tmp_path / "project.json").write_bytes(content)
    with suppress(InputError):
        assert ProjectFolder(tmp_path).read().version == 1


def test_deeply_nested_text_is_refused(tmp_path):
    (tmp_path / "project.json").write_text("[" * 100_000)
    with pytest.raises(InputError, match="damaged"):
        ProjectFolder(tmp_path).read()


def test_a_folder_without_project_is_named(tmp_path):
    assert not ProjectFolder(tmp_path).exists
    with pytest.raises(InputError, match="is not a project"):
        ProjectFolder(tmp_path).read()


def test_a_folder_with_other_files_is_not_free(tmp_path):
    ProjectFolder(tmp_path / "new").check_is_free()
    (tmp_path / "thesis.tex").write_text("")
    with pytest.raises(InputError, match="contains other files"):
        ProjectFolder(tmp_path).check_is_free()
    ProjectFolder(tmp_path).write(ProjectRecord())
    ProjectFolder(tmp_path).check_is_free()


def test_a_folder_with_only_groomed_subjects_is_free(tmp_path):
    project = ProjectFolder(tmp_path)
    project.groomed.mkdir()
    project.check_is_free()
    for name in ("a.npz", "a.vtp", "b.vtp", ".part-1-b.npz"):  # killed while b was written
        (project.groomed / name).write_text("")
    project.registrations.write_text("")
    project.check_is_free()


@pytest.mark.parametrize("other", ["groomed/mine.vtp", "groomed/a.stl", "groomed/a.vtp/b", "notes.txt"])
def test_a_folder_with_files_beside_groomed_subjects_is_not_free(tmp_path, other):
    (tmp_path / other).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / other).write_text("")
    with pytest.raises(InputError, match="contains other files"):
        ProjectFolder(tmp_path).check_is_free()


def test_a_second_program_is_told_that_the_project_is_in_use(tmp_path):
    project = ProjectFolder(tmp_path / "p")
    other = (
        "import sys; from pathlib import Path; from homolog.errors import InputError\n"
        "from homolog.io.project import ProjectFolder\n"
        "try:\n    with ProjectFolder(Path(sys.argv[1])).locked(): print('got it')\n"
        "except InputError as error: print(error)\n"
    )
    root = Path(__file__).parents[3] / "core"
    command = [
        sys.executable,
        "-c",
        f"import sys; sys.path.insert(0, {str(root)!r})\n{other}",
        str(project.folder),
    ]
    with project.locked():
        said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
        assert f"in use by another Homolog (process {os.getpid()}" in said
    assert not (project.folder / ".holder").exists()
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == "got it\n"


def finished(folder, text):
    """Write a small result, as a run would."""
    (folder.particles / "a_world.particles").write_text(text)
    (folder.folder / "energies.csv").write_text(text)
    folder.write(ProjectRecord())


def contents(folder):
    return {
        str(path.relative_to(folder)): path.read_text()
        for path in folder.rglob("*")
        if path.is_file() and path.name not in (".lock", "project.json")
    }


@pytest.mark.parametrize("folder", ["none", "."])
def test_what_needs_a_project_makes_no_folder_and_leaves_no_lock(tmp_path, folder):
    with (
        pytest.raises(InputError, match="is not a project"),
        ProjectFolder(tmp_path / folder).locked(new=False),
    ):
        pass
    assert not list(tmp_path.iterdir())


def test_a_new_result_takes_the_place_of_the_old_one_with_its_pictures(tmp_path):
    project = ProjectFolder(tmp_path)
    with project.locked():
        with project.replacing_result() as new:
            finished(new, "old")
        (project.figures / "mean.png").write_text("picture")
        (project.groomed).mkdir()
        (project.groomed / "a.vtp").write_text("cache")
        with project.replacing_result() as new:
            finished(new, "new")
    assert contents(tmp_path) == {
        "particles/a_world.particles": "new",
        "energies.csv": "new",
        "groomed/a.vtp": "cache",
    }


def test_a_result_that_breaks_off_leaves_the_old_one(tmp_path):
    project = ProjectFolder(tmp_path)
    with project.locked():
        with project.replacing_result() as new:
            finished(new, "old")
        with pytest.raises(FileExistsError), project.replacing_result() as new:
            new.model.mkdir()  # breaks off: the folder is there already
    assert contents(tmp_path) == {"particles/a_world.particles": "old", "energies.csv": "old"}


@pytest.mark.parametrize("moves", range(5))
def test_a_swap_that_a_crash_broke_off_is_finished_by_the_next_program(tmp_path, monkeypatch, moves):
    project = ProjectFolder(tmp_path)
    with project.locked(), project.replacing_result() as new:
        finished(new, "old")
    left = moves

    def replace(self, target, real=Path.replace):
        nonlocal left
        if ".next" in self.parts and ".part-" not in self.name:
            if left == 0:
                raise KeyboardInterrupt
            left -= 1
        return real(self, target)

    monkeypatch.setattr(Path, "replace", replace)
    with pytest.raises(KeyboardInterrupt), project.locked(), project.replacing_result() as new:
        finished(new, "new")
    monkeypatch.undo()
    project.recover()
    assert contents(tmp_path) == {"particles/a_world.particles": "new", "energies.csv": "new"}
    assert project.read() == ProjectRecord()


def test_an_incomplete_new_result_is_thrown_away_by_the_next_program(tmp_path):
    project = ProjectFolder(tmp_path)
    with project.locked(), project.replacing_result() as new:
        finished(new, "old")
    (tmp_path / ".next").mkdir()
    (tmp_path / ".next" / "energies.csv").write_text("half")
    with project.locked():
        pass
    assert contents(tmp_path) == {"particles/a_world.particles": "old", "energies.csv": "old"}


def test_a_program_may_take_its_own_lock_again_in_any_thread(tmp_path):
    project, seen = ProjectFolder(tmp_path), []

    def take():
        with ProjectFolder(tmp_path / "." / "").locked():
            seen.append(True)

    with project.locked():
        worker = threading.Thread(target=take)
        worker.start()
        worker.join(10.0)
    assert seen == [True]


def test_a_lock_taken_again_leaves_a_result_that_is_being_written_alone(tmp_path):
    project = ProjectFolder(tmp_path)
    with project.locked(), project.replacing_result() as new:
        with project.locked():
            pass
        finished(new, "new")
    assert contents(tmp_path) == {"particles/a_world.particles": "new", "energies.csv": "new"}


@pytest.mark.parametrize("name", ["groomed", "particles", "figures", ".next", "report/figures"])
def test_a_link_out_of_the_project_is_refused(tmp_path, name):
    project = tmp_path / "project"
    (tmp_path / "elsewhere").mkdir()
    (project / name).parent.mkdir(parents=True)
    (project / name).symlink_to(tmp_path / "elsewhere")
    with pytest.raises(InputError, match="link"), ProjectFolder(project).locked():
        pass
    assert list((tmp_path / "elsewhere").iterdir()) == []


def test_links_that_are_the_users_own_are_left_alone(tmp_path):
    (tmp_path / "scans").symlink_to(tmp_path)
    with ProjectFolder(tmp_path).locked():
        assert (tmp_path / "scans").is_symlink()


def test_what_a_killed_writer_left_is_removed(tmp_path):
    (tmp_path / "groomed").mkdir()
    for place in (tmp_path, tmp_path / "groomed"):
        (place / ".part-1-a.vtp").write_text("half")
        (place / "a.vtp").write_text("whole")
    with ProjectFolder(tmp_path).locked():
        pass
    assert contents(tmp_path) == {"a.vtp": "whole", "groomed/a.vtp": "whole"}


@pytest.mark.parametrize("path", ["a\0b", "a" * 300, "../" + "ä" * 200])
def test_a_path_that_no_system_takes_is_refused(tmp_path, path):
    content = {"format": "homolog-project", "version": 1, "subjects": [{"name": "a", "path": path}]}
    (tmp_path / "project.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match=r"subjects\.0\.path: Value error"):
        ProjectFolder(tmp_path).read()
