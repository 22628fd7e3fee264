import pytest

from homolog.cohort import read_cohort
from homolog_app.cli import main


@pytest.mark.parametrize(("kind", "count"), [("femora", 4), ("beans", 3)])
def test_a_sample_study_is_written_as_a_cohort(kind, count, tmp_path, capsys):
    out = tmp_path / kind
    assert main(["sample", kind, "--subjects", str(count), "--out", str(out), "--progress", "none"]) == 0
    assert str(out) in capsys.readouterr().out
    assert len(read_cohort(out).subjects) == count


def test_too_few_subjects_are_refused(tmp_path):
    assert main(["sample", "hearts", "--subjects", "1", "--out", str(tmp_path / "x")]) == 2
