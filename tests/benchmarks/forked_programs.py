"""Programs that start at once, because they are forked from a process that has imported Homolog."""

import importlib
import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

_PRELOADED = (
    "distributed",
    "homolog.correspondence.shape_fit",
    "homolog.run.grow",
    "homolog_app.cli.analysis",
    "homolog_app.cli.run",
    "homolog_app.pictures.figures",
    "homolog.comparison.answer",
)
_TICKS = os.sysconf("SC_CLK_TCK")


class Program:
    """A command of Homolog in a process of its own.

    Parameters
    ----------
    programs : Programs
    pid : int
    pipes : (int, int)
        Reading ends of its output and of its messages.
    """

    def __init__(self, programs: "Programs", pid: int, pipes: tuple[int, int]) -> None:
        self.pid, self._programs, self._pipes = pid, programs, pipes
        self._text, self._open = ["", ""], [True, True]
        self.code: int | None = None

    @property
    def messages(self) -> str:
        """Everything written to its standard error."""
        return self._text[1]

    def cpu_s(self) -> float:
        """Return its processor time, without its workers [s]."""
        fields = Path(f"/proc/{self.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / _TICKS

    def events(self) -> list[dict[str, object]]:
        """Return the new lines of its progress."""
        for place, pipe in enumerate(self._pipes):
            while self._open[place]:
                try:
                    data = os.read(pipe, 65536)
                except BlockingIOError:
                    break
                self._text[place] += data.decode()
                if not data:
                    break  # no writer yet, or no longer
        *lines, self._text[0] = self._text[0].split("\n")
        return [json.loads(line) for line in lines if line.startswith("{")]

    def has_ended(self) -> bool:
        """Return whether it has ended; its exit code (of a signal, negative) is then known."""
        if self.code is None:
            self.code = self._programs.ask({"poll": self.pid})
        return self.code is not None

    def send(self, number: int) -> None:
        """Send a signal."""
        os.kill(self.pid, number)

    def close(self) -> None:
        """Close the pipes."""
        for place, pipe in enumerate(self._pipes):
            self._open[place] = False
            os.close(pipe)


class Programs:
    """The process that programs are forked from.

    Parameters
    ----------
    folder : Path
        Folder for pipes, and for the temporary files of the programs.
    """

    def __init__(self, folder: Path) -> None:
        self.temporary = folder / "tmp"
        self.temporary.mkdir()
        self._folder = folder
        environment = os.environ | {
            "PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), *filter(None, sys.path)]),
            "TMPDIR": str(self.temporary),
            "OPENBLAS_NUM_THREADS": "1",
        }
        self._parent = subprocess.Popen(
            [sys.executable, "-c", "import forked_programs; forked_programs.serve()"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
        )

    def start(self, *arguments: object) -> Program:
        """Start a command."""
        paths = [self._folder / name for name in ("output", "messages")]
        for path in paths:
            path.unlink(missing_ok=True)
            os.mkfifo(path)
        output, messages = (os.open(path, os.O_RDONLY | os.O_NONBLOCK) for path in paths)
        pid = self.ask({"start": [*map(str, arguments)], "pipes": [*map(str, paths)]})
        assert pid is not None
        return Program(self, pid, (output, messages))

    def ask(self, request: Mapping[str, object]) -> int | None:
        """Return the answer to a request."""
        assert self._parent.stdin is not None
        assert self._parent.stdout is not None
        self._parent.stdin.write(json.dumps(request) + "\n")
        self._parent.stdin.flush()
        answer: int | None = json.loads(self._parent.stdout.readline())
        return answer

    def end(self) -> None:
        """End the process."""
        assert self._parent.stdin is not None
        self._parent.stdin.close()
        self._parent.wait()


def serve() -> None:
    """Fork programs on request, until the standard input ends."""
    for name in _PRELOADED:
        importlib.import_module(name)
    if len(os.listdir("/proc/self/task")) > 1:
        raise RuntimeError("a process with several threads can't be forked")
    for line in sys.stdin:
        request = json.loads(line)
        if "poll" in request:
            pid, status = os.waitpid(request["poll"], os.WNOHANG)
            answer = os.waitstatus_to_exitcode(status) if pid else None
        else:
            answer = os.fork()
            if not answer:
                sys.exit(_run(request["start"], request["pipes"]))
        sys.stdout.write(json.dumps(answer) + "\n")
        sys.stdout.flush()


def _run(arguments: Sequence[str], pipes: Sequence[str]) -> int:
    from homolog_app.cli import main

    os.dup2(os.open("/dev/null", os.O_RDONLY), 0)
    for number, path in enumerate(pipes, 1):
        os.dup2(os.open(path, os.O_WRONLY), number)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    tempfile.tempdir = None
    sys.argv = ["homolog", *arguments]
    return main(arguments)
