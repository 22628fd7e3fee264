import os
import signal
import sys

import numpy as np
import pytest

from homolog.cluster import each_in_workers, serve_as_worker, subject_executor
from homolog.cohort import read_cohort
from homolog.errors import InputError
from homolog.grooming import groom_cohort
from homolog.settings import GroomSettings, RunSettings

SETTINGS = GroomSettings(mesh_edge=2.0)


@pytest.mark.filterwarnings("ignore")  # of Dask's own
def test_a_cluster_grooms_as_plain_processes_do_and_a_killed_worker_loses_nothing(sphere_volume, tmp_path):
    for name, radius in (("a.nrrd", 6.0), ("b.nrrd", 8.0), ("c.nrrd", 7.0)):
        sphere_volume(name, radius)
    cohort = read_cohort(tmp_path)
    with subject_executor(2, "local") as executor:
        doomed = [executor.submit(os.getpid).result(60)]

        def kill_one(fraction, message):
            if message.startswith("grooming") and doomed:
                os.kill(doomed.pop(), signal.SIGKILL)

        on_cluster = groom_cohort(
            cohort, SETTINGS, executor=executor, cache=tmp_path / "groomed", tick=kill_one
        )
    assert not doomed
    assert len(list((tmp_path / "groomed").glob("*.npz"))) == 3
    for item, other in zip(on_cluster, groom_cohort(cohort, SETTINGS), strict=True):
        np.testing.assert_array_equal(item.mesh.vertices, other.mesh.vertices)
        np.testing.assert_array_equal(item.field.values, other.field.values)


@pytest.mark.filterwarnings("ignore")
def test_a_scheduler_that_does_not_answer_is_named(monkeypatch):
    monkeypatch.setattr("homolog.cluster.ANSWER_S", 1)
    with (
        pytest.raises(InputError, match=r"tcp://127\.0\.0\.1:9: no Dask scheduler"),
        subject_executor(1, "tcp://127.0.0.1:9"),
    ):
        pass


def test_without_dask_a_cluster_is_refused_with_the_command_that_installs_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"homolog\[cluster\]"), subject_executor(1, "local"):
        pass


def test_slurm_is_refused_where_no_jobs_can_be_submitted(monkeypatch):
    monkeypatch.setenv("PATH", "")
    with pytest.raises(InputError, match="no command sbatch"), subject_executor(1, "slurm"):
        pass


@pytest.mark.filterwarnings("ignore")
def test_jobs_of_slurm_are_submitted_and_cancelled(monkeypatch, tmp_path):
    pytest.importorskip("dask_jobqueue")
    sbatch = 'cp "${@: -1}" "$0.job"; setsid bash "$0.job" >/dev/null 2>&1 </dev/null & echo job $!'
    for name, script in (("sbatch", sbatch), ("scancel", 'touch "$0.$1"; kill -- "-$1"')):
        (tmp_path / name).write_text(f"#!/bin/bash\n{script}\n")
        (tmp_path / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    lines = []
    with subject_executor(1, "slurm", lines.append) as executor:
        assert executor.submit(os.getpid).result(60) != os.getpid()
    assert "dashboard http" in lines[0]
    assert list(tmp_path.glob("scancel.*"))
    assert "--mem=8G" in (tmp_path / "sbatch.job").read_text()


@pytest.mark.filterwarnings("ignore")
def test_jobs_that_slurm_refuses_end_the_work_with_its_reason(monkeypatch, tmp_path):
    pytest.importorskip("dask_jobqueue")
    (tmp_path / "sbatch").write_text("#!/bin/bash\necho 'sbatch: error: invalid partition' >&2; exit 1\n")
    (tmp_path / "sbatch").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    messages = set()
    with (
        pytest.raises(InputError, match=r"refused the jobs \(invalid partition\)"),
        subject_executor(1, "slurm") as executor,
    ):
        list(each_in_workers(executor, str, {"one": 1}, "grooming", lambda _, message: messages.add(message)))
    assert "waiting for Slurm to start a job" in messages


@pytest.mark.filterwarnings("ignore")
def test_a_worker_is_refused_an_address_that_is_none():
    with pytest.raises(InputError, match="foo: no Dask scheduler"):
        serve_as_worker("foo")


@pytest.mark.parametrize("address", ["node1:8786", "http://x", "", "local "])
def test_addresses_of_clusters_are_checked_with_the_settings(address):
    with pytest.raises(ValueError, match="cluster"):
        RunSettings(cluster=address)


def test_a_run_that_was_begun_on_a_cluster_can_go_on_without_one():
    assert RunSettings(cluster="none").cluster is None
