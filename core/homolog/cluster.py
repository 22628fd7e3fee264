"""Workers for single subjects: processes of this machine, or a Dask cluster.

Subjects are groomed and fitted independently. The calling program writes each worker's result to one
file per subject. A worker, a scheduler or the program itself may therefore end at any time: only unfinished
subjects are started again.
"""

import logging
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    wait,
)
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext, suppress
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, Self, TypeVar

from homolog import __version__
from homolog.errors import InputError, NumericalError, WorkerDiedError
from homolog.progress import Tick, no_tick, part_of
from homolog.slurm import slurm_jobs
from homolog.threads import cores
from homolog.workers import main_guard_hint, worker_processes

_J = TypeVar("_J")
_T = TypeVar("_T")

__all__ = [
    "LOCAL",
    "SLURM",
    "SubjectWorkers",
    "each_in_workers",
    "each_read",
    "read_apart",
    "retried_on_workers",
    "serve_as_worker",
    "subject_executor",
]

LOCAL = "local"
"""A Dask cluster of this machine's cores."""
SLURM = "slurm"
"""A Dask cluster of jobs that this machine submits to Slurm."""

_ENDED = "the process that read it ended: it is damaged, or memory is short; export it again, or exclude it"
_PATIENCE_S = 0.1  # s between ticks
_AHEAD = 1024
"""Largest number of jobs that wait in an executor: a scheduler need not hold those of all subjects."""
_MOST_DEATHS = 3
"""Largest number of deaths of workers, in `SubjectWorkers` without a finished subject between them."""
ANSWER_S = 15
"""Time within which a scheduler must answer."""
_log = logging.getLogger(__name__)


@contextmanager
def subject_executor(
    workers: int, cluster: str | None = None, announce: Callable[[str], None] = _log.info
) -> Iterator[Executor]:
    """Yield an executor for work on single subjects; its own processes end with the block.

    Parameters
    ----------
    workers : int
        Number of processes of this machine or of a local cluster, or of Slurm jobs.
    cluster : str, optional
        ``"local"`` for a Dask cluster of this machine, ``"slurm"`` for jobs of Slurm, or the address of a
        scheduler (``tcp://HOST:PORT``). All workers must see the same files under the same paths. By default,
        plain processes.
    announce : callable, optional
        Receives a line with the addresses of the cluster and its dashboard.

    Yields
    ------
    Executor

    Raises
    ------
    InputError
        If Dask is not installed, no scheduler answers, its workers have no or another Homolog, or this
        machine can't submit jobs to Slurm.
    """
    if cluster is None:
        with worker_processes(workers) as executor:
            yield executor
        return
    distributed = _distributed()
    with ExitStack() as stack:
        where: Any = cluster
        awaited: Callable[[], str] = str
        if cluster == LOCAL:
            where = stack.enter_context(
                distributed.LocalCluster(
                    n_workers=workers,
                    threads_per_worker=1,
                    dashboard_address=":0",
                    silence_logs=logging.ERROR,
                )
            )
        elif cluster == SLURM:
            jobs = stack.enter_context(slurm_jobs(workers))
            where, awaited = jobs.cluster, jobs.awaited
        try:
            client = stack.enter_context(distributed.Client(where, timeout=ANSWER_S, set_as_default=False))
        except (OSError, ValueError) as error:
            raise InputError(
                f"{cluster}: no Dask scheduler answers there ({error}); start one with dask scheduler, or "
                "use the cluster local, or none for processes of this machine"
            ) from error
        if cluster != SLURM:  # its jobs use this installation, and may be queued
            _check_workers(client, cluster)
        announce(f"Dask cluster {client.scheduler.address}, dashboard {client.dashboard_link}")
        yield _ClusterExecutor(stack.enter_context(client.get_executor(pure=False)), awaited)


def retried_on_workers(
    work: Callable[[Executor], _T],
    doing: str,
    workers: int,
    cluster: str | None = None,
    announce: Callable[[str], None] = _log.info,
) -> _T:
    """Call a function of an executor; when a worker dies, call it again with another one.

    Parameters
    ----------
    work : callable
        Work that keeps what it has finished, such as `groom_cohort` with a cache.
    doing : str
        Verb for the log, such as ``"grooming"``.
    workers, cluster, announce
        See `subject_executor`.

    Raises
    ------
    WorkerDiedError
        If workers die three times.
    """
    deaths = 0
    while True:
        with subject_executor(workers, cluster, announce) as executor:
            try:
                return work(executor)
            except WorkerDiedError:
                deaths += 1
                if deaths >= _MOST_DEATHS:
                    raise
        _log.warning("%s: a worker died; its subject is started again", doing)


def each_in_workers(
    executor: Executor, function: Callable[[_J], _T], jobs: Mapping[str, _J], doing: str, tick: Tick
) -> Iterator[tuple[str, Future[_T]]]:
    """Call a function of each job in workers; yield the futures as they end, and cancel the others on exit.

    Local processes are ended by `worker_processes`, with the futures that are left: before Python 3.12.1, the
    thread of an executor whose processes end fails at a cancelled one.

    Parameters
    ----------
    executor : Executor
    function : callable
        Function of a job, importable by name in the workers.
    jobs : mapping of str to object
        Jobs by subject.
    doing : str
        Verb for progress messages, such as ``"fitting"``.
    tick : Tick
        Called at least every 0.1 s.

    Yields
    ------
    tuple of str and Future
        Subject and ended future, in the order of completion; of several at once, in that of the jobs.
    """
    following, names, ended = iter(jobs.items()), dict[Future[_T], str](), 0
    try:
        while ended < len(jobs):
            for name, job in islice(following, _AHEAD - len(names)):
                names[executor.submit(function, job)] = name
            awaited = executor.awaited() if isinstance(executor, _ClusterExecutor) else ""
            tick(ended / len(jobs), awaited or f"{doing} {next(iter(names.values()))}")
            done = wait(names, _PATIENCE_S, FIRST_COMPLETED).done
            for future in [item for item in names if item in done]:  # in the order of submission
                ended += 1
                yield names.pop(future), future
    finally:
        if not isinstance(executor, ProcessPoolExecutor):
            for future in names:
                future.cancel()


def each_read(
    function: Callable[[_J], _T],
    jobs: Mapping[str, _J],
    files: Mapping[str, Path],
    doing: str,
    tick: Tick,
    executor: Executor | None = None,
) -> Iterator[tuple[str, Future[_T]]]:
    """Call a function that reads the file of each job in workers, as `each_in_workers`.

    Parameters
    ----------
    function, jobs, doing, tick
        See `each_in_workers`.
    files : mapping of str to Path
        The file of each job, for messages.
    executor : Executor, optional
        By default, processes of this machine.

    Yields
    ------
    tuple of str and Future
        Subject and ended future, with an `InputError` that names the file if its own job ended the process.
    """
    if not jobs:
        return
    left = dict(jobs)
    workers = nullcontext(executor) if executor else worker_processes(min(len(jobs), cores()))
    with workers as used, suppress(BrokenExecutor):
        for name, future in each_in_workers(used, function, jobs, doing, tick):
            if isinstance(future.exception(), BrokenExecutor):
                break
            del left[name]
            yield name, future
    while left:
        with worker_processes(1) as alone:
            for name in tuple(left):
                last = {name: left.pop(name)}
                ((_, future),) = each_in_workers(alone, function, last, doing, part_of(tick, 1.0, 1.0))
                if died := isinstance(future.exception(), BrokenExecutor):
                    future = Future()
                    future.set_exception(InputError(f"{files[name]}: {_ENDED}{main_guard_hint()}"))
                yield name, future
                if died:
                    break


def read_apart(
    function: Callable[[_J], _T], job: _J, file: Path, tick: Tick = no_tick, doing: str = "reading"
) -> _T:
    """Return a function of one job, which reads a file, called in a process of its own.

    Raises
    ------
    InputError
        Also if the file ends the process.
    """
    ((_, future),) = each_read(function, {file.name: job}, {file.name: file}, doing, tick)
    return future.result()


class SubjectWorkers:
    """Workers that are reused between steps; one that dies is replaced.

    A context manager; its exit ends the workers. They are started on first use.

    Parameters
    ----------
    workers, cluster, announce
        See `subject_executor`.
    in_process : bool
        Whether to work in a thread of this process, on one subject at a time.
    """

    def __init__(
        self,
        workers: int,
        cluster: str | None = None,
        announce: Callable[[str], None] = _log.info,
        *,
        in_process: bool = False,
    ) -> None:
        self._start: Callable[[], AbstractContextManager[Executor]] = (
            partial(ThreadPoolExecutor, 1)
            if in_process
            else partial(subject_executor, workers, cluster, announce)
        )
        self._stack = ExitStack()
        self._executor: Executor | None = None

    def __enter__(self) -> Self:
        """Begin."""
        return self

    def __exit__(self, *error: object) -> None:
        """Terminate the workers."""
        self._stack.close()

    def each(
        self, function: Callable[[_J], _T], jobs: Mapping[str, _J], doing: str, tick: Tick = no_tick
    ) -> Iterator[tuple[str, _T]]:
        """Call a function for every subject in the workers; yield the results as they arrive.

        When a worker dies, only its subjects are started again, in new processes. A function that raises
        is not called again.

        Parameters
        ----------
        function, jobs, doing, tick
            See `each_in_workers`.

        Yields
        ------
        tuple of str and object
            Subject and result, in the order of completion.

        Raises
        ------
        NumericalError
            If workers die repeatedly without a finished subject.
        """
        left, deaths = dict(jobs), 0
        while left:
            try:
                if self._executor is None:
                    self._executor = self._stack.enter_context(self._start())
                begun = part_of(tick, 1.0 - len(left) / len(jobs), 1.0)
                for name, future in each_in_workers(self._executor, function, dict(left), doing, begun):
                    result = future.result()
                    del left[name]
                    deaths = 0
                    yield name, result
            except BrokenExecutor as error:
                self._executor = None
                self._stack.close()
                deaths += 1
                if deaths >= _MOST_DEATHS:
                    raise NumericalError(
                        f"{doing}: workers died {deaths} times in a row, probably for lack of memory; use "
                        "fewer workers"
                    ) from error
                _log.warning("%s: a worker died; its subject is started again", doing)


class _ClusterExecutor(Executor):
    """Dask's executor; a lost cluster breaks it like a dead process breaks a process pool.

    Parameters
    ----------
    dask : Executor
    awaited : callable
        Returns what the work waits for, or raises `InputError`.
    """

    def __init__(self, dask: Executor, awaited: Callable[[], str]) -> None:
        self._dask, self.awaited = dask, awaited

    def submit(self, function: Callable[..., _T], /, *args: Any, **kwargs: Any) -> Future[_T]:  # noqa: ANN401
        """Submit a call; Dask repeats it on another worker if one dies."""
        result: Future[_T] = Future()

        def done(inner: Future[_T]) -> None:
            if not result.set_running_or_notify_cancel():
                return
            if inner.cancelled():
                result.set_exception(BrokenExecutor("the cluster's scheduler ended"))
                return
            error = inner.exception()
            if error is None:
                result.set_result(inner.result())
            elif type(error).__name__ in ("KilledWorker", "CommClosedError"):
                result.set_exception(BrokenExecutor(str(error)))
            else:
                result.set_exception(error)

        inner = self._dask.submit(function, *args, **kwargs)
        result.add_done_callback(lambda outer: inner.cancel() if outer.cancelled() else None)
        inner.add_done_callback(done)
        return result


def serve_as_worker(address: str) -> None:
    """Run a Dask worker until its scheduler ends or the process is interrupted.

    Parameters
    ----------
    address : str
        Address of the scheduler, ``tcp://HOST:PORT``.

    Raises
    ------
    InputError
        If Dask is not installed, no scheduler answers, or the address is invalid.
    """
    import asyncio

    distributed = _distributed()
    for part in ("nanny", "worker", "core"):
        logging.getLogger(f"distributed.{part}").setLevel(logging.WARNING)

    async def serve() -> None:
        async with distributed.Nanny(address, nthreads=1, death_timeout=ANSWER_S) as nanny:
            await nanny.finished()

    try:
        asyncio.run(serve())
    except (OSError, ValueError) as error:
        raise InputError(
            f"{address}: no Dask scheduler answers there; give its address, such as tcp://node1:8786"
        ) from error


def _distributed() -> Any:  # noqa: ANN401 - an optional library without types
    try:
        import distributed
    except ImportError as error:
        raise InputError(
            'clusters need Dask, which is not installed; install it with: pip install "homolog[cluster]"'
        ) from error
    logging.getLogger("distributed").setLevel(logging.ERROR)  # its reports would fill the window's log
    for name in ("distributed.client", "tornado.application", "asyncio"):  # errors that Dask raises as well
        logging.getLogger(name).setLevel(logging.CRITICAL)
    return distributed


def _check_workers(client: Any, cluster: str) -> None:  # noqa: ANN401
    answers: dict[str, object] = client.run(_version, on_error="return")
    if not answers:
        raise InputError(f"{cluster}: its scheduler has no workers; start some with: homolog worker ADDRESS")
    for worker, answer in answers.items():
        if isinstance(answer, ModuleNotFoundError):
            raise InputError(
                f"{cluster}: its workers lack Homolog; install version {__version__} there"
            ) from answer
        if isinstance(answer, OSError):  # it died; its replacement has the same installation
            continue
        if isinstance(answer, Exception):
            raise answer
        if answer != __version__:
            raise InputError(f"{worker}: has Homolog {answer}, not {__version__}; install the same there")


def _version() -> str:
    return __version__
