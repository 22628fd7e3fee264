from dataclasses import replace

from homolog.cohort import Cohort
from homolog.io.project import ProjectFolder
from homolog.settings import RunSettings
from homolog_app.window.jobs import RunJob


def test_the_addresses_of_a_runs_cluster_are_logged_once(tmp_path, caplog, monkeypatch):
    from homolog.run import FinishReason, Run

    def execute(run, observer):
        for cluster in ("", "Dask cluster tcp://a:1", "Dask cluster tcp://a:1", "Dask cluster tcp://b:2"):
            observer(replace(run.status, cluster=cluster))
        return FinishReason.COMPLETED

    monkeypatch.setattr(Run, "execute", execute)
    monkeypatch.setattr(RunJob, "_finished", lambda job: None)
    caplog.set_level("INFO")
    RunJob(ProjectFolder(tmp_path), Cohort((), tmp_path), RunSettings(), resume=False).execute()
    assert caplog.messages == ["Dask cluster tcp://a:1", "Dask cluster tcp://b:2"]
