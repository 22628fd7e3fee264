"""Every kind of export where files can't grow: the message names file and remedy, nothing half is left."""

import pytest

from homolog_app.cli import INPUT_ERROR, main

FILM = ("--mode", "1", "--seconds", "0.4", "--width", "480", "--height", "320")
KINDS = {
    "film as mp4": ("film", "a.mp4", *FILM),
    "film as gif": ("film", "a.gif", *FILM),
    "film as pictures": ("film", "frames", *FILM),
    "still": ("still", "a.png", "--width", "480", "--height", "320"),
    "plot as svg": ("plot", "a.svg", "--kind", "scree"),
    "plot as png": ("plot", "a.png", "--kind", "scores"),
    "plot as pdf": ("plot", "a.pdf", "--kind", "energies"),
    "meshes as vtp": ("meshes", "meshes"),
    "meshes as ply": ("meshes", "meshes", "--format", "ply"),
    "meshes as stl": ("meshes", "meshes", "--format", "stl"),
    "meshes as glb": ("meshes", "meshes", "--format", "glb"),
    "cohort": ("cohort", "a.csv"),
    "table": ("table", "tables"),
    "measures": ("measures", "a.csv", "--particles", "1", "2"),
    "particles": ("particles", "particles"),
    "markups": ("markups", "markups"),
    "shapeworks": ("shapeworks", "shapeworks"),
}


@pytest.mark.parametrize("kind", KINDS)
def test_an_export_that_cannot_grow_is_named_and_leaves_nothing(
    kind, project, contents, files_up_to, tmp_path, capsys
):
    what, name, *options = KINDS[kind]
    before, place = contents(project.folder), tmp_path / "out"
    place.mkdir()
    with files_up_to(20):
        code = main(["export", what, str(project.folder), "--out", str(place / name), *options])
    output = capsys.readouterr().err
    assert code == INPUT_ERROR
    assert f"homolog: {place / name}" in output
    assert ": can't be written: " in output
    assert "choose a writable folder" in output
    assert ".part-" not in output
    assert contents(place) == {}
    assert contents(project.folder) == before


def test_a_report_that_cannot_grow_is_named_and_the_one_before_stays(
    project, contents, files_up_to, capsys, monkeypatch
):
    monkeypatch.setattr("homolog_app.report.write.model_figures", lambda *_: [])  # the slowest part
    assert main(["report", str(project.folder)]) == 0
    before = contents(project.folder / "report")
    with files_up_to(600):
        assert main(["report", str(project.folder)]) == INPUT_ERROR
    output = capsys.readouterr().err
    assert "File too large; choose a " in output
    assert contents(project.folder / "report") == before
