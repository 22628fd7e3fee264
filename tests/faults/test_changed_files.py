"""Files that change or vanish between grooming and run."""

import shutil

import pytest

from homolog.errors import InputError
from homolog.run import FinishReason, Phase, Run


def test_a_file_that_changed_is_groomed_again_and_told(project, run_of, results, caplog):
    before, scans = results(project.folder), project.folder.parent / "scans"
    shutil.copy(scans / "c.nrrd", scans / "b.nrrd")
    run_of(project).execute()
    assert caplog.messages == ["b: its file has changed since it was last groomed; it was groomed again"]
    notes = {subject.name: subject.notes for subject in project.read().result.subjects}
    assert [name for name, lines in notes.items() if any("has changed" in line for line in lines)] == ["b"]
    assert results(project.folder) != before


def test_a_run_is_not_resumed_with_another_file(project, run_of, results):
    before, run = results(project.folder), run_of(project)

    def cancel(status):
        if status.phase is Phase.SPLITTING:
            run.cancel()

    assert run.execute(cancel) is FinishReason.CANCELLED
    scans = project.folder.parent / "scans"
    shutil.copy(scans / "c.nrrd", scans / "b.nrrd")
    with pytest.raises(InputError, match="interrupted run; start a new"):
        run_of(project, resume=True).execute()
    assert results(project.folder) == before
    assert project.checkpoint.is_file()


def test_a_file_that_is_gone_is_named(project, short_settings, results):
    before, cohort = results(project.folder), project.cohort()
    cohort.subjects[1].path.unlink()
    with pytest.raises(InputError, match=r"b\.nrrd: does not exist"):
        Run(project, cohort, short_settings).execute()
    assert results(project.folder) == before
