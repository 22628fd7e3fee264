"""Jobs of Slurm as the workers of a Dask cluster."""

import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from homolog.errors import InputError

__all__ = ["SlurmJobs", "slurm_jobs"]

_MEMORY = "8 GB"
"""Memory of a job, unless Dask's configuration sets another."""


@dataclass(slots=True)
class SlurmJobs:
    """A Dask cluster of jobs that this machine submits to Slurm.

    Attributes
    ----------
    cluster : dask_jobqueue.SLURMCluster or None
    refusals : list of str
        Reasons why ``sbatch`` refused jobs.
    """

    cluster: Any = None
    refusals: list[str] = field(default_factory=list)

    def awaited(self) -> str:
        """Return what the work waits for; empty if a job runs.

        Raises
        ------
        InputError
            If no job runs and Slurm refuses them.
        """
        if self.cluster.scheduler.workers:
            self.refusals.clear()
            return ""
        if self.refusals:
            raise InputError(
                f"cluster slurm: sbatch refused the jobs ({self.refusals[-1]}); set queue, account, time and "
                "memory in Dask's configuration (jobqueue.slurm), or start dask scheduler and homolog worker "
                "in jobs of your own and give the scheduler's address"
            )
        return "waiting for Slurm to start a job"


@contextmanager
def slurm_jobs(number: int) -> Iterator[SlurmJobs]:
    """Yield a cluster with this number of Slurm jobs as workers; jobs that end are submitted again.

    Queue, account, time and memory are those of Dask's configuration (jobqueue.slurm).

    Raises
    ------
    InputError
        If dask-jobqueue is not installed, or this machine has no command ``sbatch``.
    """
    if shutil.which("sbatch") is None:
        raise InputError(
            "cluster slurm: this machine has no command sbatch; run on a node that submits jobs, or start "
            "dask scheduler and homolog worker in jobs of your own and give the scheduler's address"
        )
    try:
        import dask
        from dask_jobqueue import SLURMCluster
        from dask_jobqueue.slurm import SLURMJob
        from distributed import Status
    except ImportError as error:
        raise InputError(
            "cluster slurm needs dask-jobqueue, which is not installed; install it with: "
            'pip install "homolog[cluster]"'
        ) from error
    jobs = SlurmJobs()

    class RecordedJob(SLURMJob):  # type: ignore[misc]  # a library without types
        async def _submit_job(self, script_filename: str) -> object:
            try:
                return await super()._submit_job(script_filename)
            except RuntimeError as error:
                reasons = re.findall(r"sbatch: (?:error: )?(.+)", str(error)) or str(error).split("\n")
                jobs.refusals.append(reasons[0].strip())
                self.status = Status.failed  # otherwise the cluster can't be closed
                raise

    memory = dask.config.get("jobqueue.slurm.memory", None) or _MEMORY
    scheduler = {"dashboard_address": ":0"}
    with SLURMCluster(
        cores=1, processes=1, memory=memory, scheduler_options=scheduler, job_cls=RecordedJob
    ) as cluster:
        jobs.cluster = cluster
        cluster.adapt(minimum_jobs=number, maximum_jobs=number)
        yield jobs
