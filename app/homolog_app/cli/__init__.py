"""The command line: the same pipeline as the window's.

Each command is one module here with two functions: ``add_parser(subparsers)`` declares its options and
``run(arguments)`` does the work and returns the exit code. What is slow to import (warp, SimpleITK, VTK,
matplotlib) is imported inside ``run``, so that ``homolog --help`` answers at once.
"""

import argparse
import importlib
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

from homolog import __version__
from homolog.errors import Cancelled, InputError, NumericalError, user_message

__all__ = ["CANCELLED", "INPUT_ERROR", "OK", "PROGRAM_ERROR", "main", "open_window"]

OK, PROGRAM_ERROR, INPUT_ERROR, CANCELLED = 0, 1, 2, 130
"""Exit codes; 130 is the shell's own for a command ended by Ctrl-C."""

_COMMANDS = (
    "run",
    "labels",
    "batch",
    "info",
    "table",
    "demo",
    "sample",
    "beans",
    "analyze",
    "check",
    "report",
    "import",
    "export",
    "geodesics",
)

_MODULES = {"import": "import_model"}  # a keyword of Python

_DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM")


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code.

    Parameters
    ----------
    argv : sequence of str, optional
        Arguments after the program's name; those of the process by default.
    """
    parser, modules = _parser()
    given = sys.argv[1:] if argv is None else list(argv)
    if given and given[0] not in modules and Path(given[0]).exists():
        return open_window(given)
    arguments = parser.parse_args(given)
    try:
        if arguments.command is None:
            return open_window([])
        return int(modules[arguments.command].run(arguments))
    except (InputError, NumericalError, OSError) as error:
        words = user_message(error)
        if words is None:
            raise
        _complain(words)
        return PROGRAM_ERROR if isinstance(error, NumericalError) else INPUT_ERROR
    except (Cancelled, KeyboardInterrupt):
        sys.stderr.write("cancelled\n")
        return CANCELLED


def open_window(paths: Sequence[str] | None = None) -> int:
    """Open the window and return its exit code once it is closed.

    Parameters
    ----------
    paths : sequence of str, optional
        A project, folder or files to open; the arguments of the process by default.
    """
    if sys.platform.startswith("linux") and not any(map(os.environ.get, _DISPLAYS)):
        sys.stderr.write("homolog: no display found; homolog --help lists the commands that need none\n")
        return INPUT_ERROR
    from homolog_app.window import main as start_window

    return start_window(sys.argv[1:] if paths is None else paths)


def _parser() -> tuple[argparse.ArgumentParser, dict[str, ModuleType]]:
    parser = argparse.ArgumentParser(
        prog="homolog",
        description="Statistical shape analysis: corresponding points on a cohort of shapes, shape models "
        "and group tests. Without a command the window opens; homolog FOLDER opens it on a project.",
    )
    parser.add_argument("--version", action="version", version=f"homolog {__version__}")
    subparsers = parser.add_subparsers(dest="command", metavar="COMMAND", title="commands")
    modules = {name: importlib.import_module(f"{__name__}.{_MODULES.get(name, name)}") for name in _COMMANDS}
    for module in modules.values():
        module.add_parser(subparsers)
    return parser, modules


def _complain(words: str) -> None:
    """Print one line for each thing that is wrong."""
    for line in words.splitlines():
        sys.stderr.write(f"homolog: {line}\n")
