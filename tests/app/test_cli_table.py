"""``homolog table``, and runs of a result that is there."""

import shutil

import pytest

from homolog.io.project import ProjectFolder
from homolog.io.results import particle_file, read_result
from homolog_app.cli import main

QUIET = ["--progress", "none", "--no-figures", "--workers", "1", "--device", "cpu"]


@pytest.fixture
def project(finished_run, ellipsoids, tmp_path):
    """Return a copy of the finished project, beside its scans."""
    shutil.copytree(ellipsoids, tmp_path / "scans")
    return ProjectFolder(shutil.copytree(finished_run.folder, tmp_path / "project"))


@pytest.fixture
def table(tmp_path):
    path = tmp_path / "subjects.csv"
    path.write_text("subject;group;age\na.nrrd;case;61\nb;control;48\nc;case;\nx;case;1\n", encoding="utf-8")
    return path


@pytest.fixture
def options(short_settings):
    """Return the options that give the finished project's settings."""
    from homolog_app.cli.options import options_of

    return [*options_of(short_settings.groom), *options_of(short_settings.optimize), *QUIET]


def test_a_row_of_types_declares_categories_for_the_command_line_the_api_and_the_window(
    project, tmp_path, capsys
):
    import homolog as hl
    from homolog.comparison.choices import covariates_of
    from homolog.comparison.sample import column_of
    from homolog_app.window.study import Member, Study

    path = tmp_path / "types.csv"
    path.write_text("name,site,age\ntype,category,number\na,1,60\nb,2,50\nc,1,55\nd,2,48\n", encoding="utf-8")
    assert main(["table", str(project.folder), str(path)]) == 0
    assert column_of(read_result(project), "site") == column_of(read_result(project), "site:c")
    assert hl.Project(project.folder).covariates["site:c"] == ("1", "2", "1", "2")
    study = Study(tuple(Member(subject) for subject in project.cohort().subjects))
    assert {"site:c", "age"} <= set(covariates_of(study.cohort, "group"))
    assert "site" not in covariates_of(study.cohort, "group")
    path.write_text("name,age\ntype,number\na,60 y\n", encoding="utf-8")
    assert main(["table", str(project.folder), str(path)]) == 2
    assert "'60 y'" in capsys.readouterr().err


def bytes_of(project):
    """Return all particles of a project, as they are on the disk."""
    stems = [subject.file for subject in project.read().result.subjects]
    return [
        particle_file(project, stem, frame).read_bytes() for stem in stems for frame in ("local", "world")
    ]


def manifest(tmp_path, names, **columns):
    path = tmp_path / "cohort.csv"
    rows = [
        ",".join([name, f"scans/{name}.nrrd", *(values[name] for values in columns.values())])
        for name in names
    ]
    path.write_text("\n".join([",".join(["name", "path", *columns]), *rows]) + "\n", encoding="utf-8")
    return path


def test_a_table_changes_groups_and_covariates_but_no_particle(project, table, capsys):
    before = bytes_of(project)
    assert main(["table", str(project.folder), str(table)]) == 0
    result = read_result(project)
    assert result.groups == ("case", "control", "case", None)
    assert result.columns[0] == {"age": "61"}
    assert bytes_of(project) == before
    output = capsys.readouterr().out
    assert "3 of 4" in output
    assert "without a row: d" in output
    assert "name no subject: x" in output


def test_everything_that_reads_groups_sees_the_new_ones(project, table, capsys):
    main(["table", str(project.folder), str(table)])
    assert [subject.group for subject in project.read().result.subjects] == ["case", "control", "case", None]
    lines = (project.model / "scores.csv").read_text(encoding="utf-8").splitlines()
    assert [line.split(",")[1] for line in lines[1:]] == ["case", "control", "case", ""]
    capsys.readouterr()
    main(["info", str(project.folder)])
    assert "2 case, 1 control" in capsys.readouterr().out


def test_a_dry_run_says_the_same_and_writes_nothing(project, table, capsys):
    before = (project.folder / "project.json").read_bytes()
    assert main(["table", str(project.folder), str(table), "--dry-run"]) == 0
    assert "3 of 4" in capsys.readouterr().out
    assert (project.folder / "project.json").read_bytes() == before


def test_a_second_time_nothing_changes(project, table, capsys):
    main(["table", str(project.folder), str(table)])
    before = (project.folder / "project.json").read_bytes()
    main(["table", str(project.folder), str(table)])
    assert "nothing changes" in capsys.readouterr().out
    assert (project.folder / "project.json").read_bytes() == before


def test_a_folder_that_is_no_project_is_refused(table, tmp_path, capsys):
    assert main(["table", str(tmp_path), str(table)]) == 2
    assert "is not a project" in capsys.readouterr().err


def test_the_same_subjects_in_another_order_with_new_columns_use_the_result(
    project, tmp_path, options, capsys
):
    before = bytes_of(project), project.read().result.finished
    cohort = manifest(tmp_path, "dbca", group=dict(zip("abcd", "xyxy", strict=True)))
    assert main(["run", str(cohort), "--out", str(project.folder), *options]) == 0
    assert (bytes_of(project), project.read().result.finished) == before
    assert read_result(project).groups == ("x", "y", "x", "y")
    assert "already has the result" in capsys.readouterr().err


def test_a_folder_without_columns_keeps_those_that_are_there(project, table, options, tmp_path):
    main(["table", str(project.folder), str(table)])
    main(["run", str(tmp_path / "scans"), "--out", str(project.folder), *options])
    assert read_result(project).groups == ("case", "control", "case", None)


def ran_again(project, text):
    before = project.folder / "energies.csv"
    stamp = before.stat().st_mtime_ns
    assert main(["run", *text]) == 0
    return before.stat().st_mtime_ns != stamp


def test_other_settings_other_subjects_and_wishes_run_as_before(project, tmp_path, options):
    out = ["--out", str(project.folder), *options]
    assert ran_again(project, [str(tmp_path / "scans"), *out, "--seed", "3"])
    assert ran_again(project, [str(tmp_path / "scans"), *out, "--seed", "3", "--restart"])
    assert ran_again(project, [str(manifest(tmp_path, "abc")), *out])


def test_a_file_of_other_content_is_run_anew(project, tmp_path, options):
    shutil.copy(tmp_path / "scans" / "b.nrrd", tmp_path / "scans" / "a.nrrd")
    assert ran_again(project, [str(tmp_path / "scans"), "--out", str(project.folder), *options])


def test_sides_that_are_said_later_are_heeded(project, tmp_path, options):
    sides = dict(zip("abcd", ("left", "right", "right", "right"), strict=True))
    cohort = manifest(tmp_path, "abcd", side=sides)
    assert ran_again(project, [str(cohort), "--out", str(project.folder), *options])
    assert project.read().result.mirrored_text.startswith("1 left")


def test_scans_come_from_the_table_and_stay_with_later_tables(project, tmp_path):
    scans = tmp_path / "grey" / "scans.csv"
    scans.parent.mkdir()
    scans.write_text("name,image\na,a.nrrd\nb,deeper/b.nrrd\n", encoding="utf-8")
    assert main(["table", str(project.folder), str(scans)]) == 0
    assert project.read().subjects[0].image == "../grey/a.nrrd"
    (tmp_path / "ages.csv").write_text("name,age\na,50\n", encoding="utf-8")
    assert main(["table", str(project.folder), str(tmp_path / "ages.csv")]) == 0
    images = {subject.name: subject.image for subject in project.cohort().subjects}
    assert (images["a"], images["b"]) == (scans.parent / "a.nrrd", scans.parent / "deeper" / "b.nrrd")
