import pytest

from homolog_app.cli import main


def test_beans_are_written_and_their_moments_told(tmp_path, capsys):
    assert main(["beans", str(tmp_path / "cohort"), "--shapes", "3", "--progress", "none"]) == 0
    assert sorted(path.name for path in (tmp_path / "cohort").iterdir()) == [
        "bean_01.nrrd",
        "bean_02.nrrd",
        "bean_03.nrrd",
        "truth.csv",
    ]
    assert "3 wide beans, seed 5" in capsys.readouterr().out


@pytest.mark.parametrize("options", [["--shapes", "1"], ["--seed", "-2"]])
def test_impossible_cohorts_are_refused_before_anything_is_written(tmp_path, capsys, options):
    assert main(["beans", str(tmp_path / "cohort"), *options]) == 2
    assert f"homolog: {options[0]} {options[1]}: must be" in capsys.readouterr().err
    assert not (tmp_path / "cohort").exists()
