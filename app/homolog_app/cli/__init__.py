"""The command line: the same pipeline as the window's.

Each command is a function of one module: ``run_NAME(arguments)``, decorated with its description and options,
does the work and returns the exit code. Only the module of the given command is
imported, and heavy packages (warp, SimpleITK, VTK, matplotlib) only inside ``run_NAME``, so that help
responds at once.
"""

import argparse
import importlib
import os
import signal
import subprocess
import sys
from collections.abc import Collection, Sequence
from contextlib import suppress
from pathlib import Path
from types import ModuleType
from typing import NoReturn

import homolog
from homolog import __version__
from homolog.errors import Cancelled, NumericalError, user_message

__all__ = ["CANCELLED", "INPUT_ERROR", "OK", "PROGRAM_ERROR", "command_parser", "main", "open_window"]

OK, PROGRAM_ERROR, INPUT_ERROR, CANCELLED = 0, 1, 2, 130
"""Exit codes; 130 is the shell's convention for a command ended by Ctrl-C."""

_COMMANDS = {
    "run": ("run", "groom a cohort, place corresponding particles, compute the shape model"),
    "cohort": ("cohort", "write a folder's subjects, files and groups as a table for editing"),
    "cut": ("cohort", "place a cutting plane on every subject, and write them as a table"),
    "labels": ("project", "list the structures in a cohort's label maps"),
    "batch": ("project", "compute a shape model of each structure of a cohort"),
    "info": ("project", "show what a project contains"),
    "table": ("project", "add or replace groups and covariates of a project"),
    "demo": ("demo", "compare two methods on generated anatomy of known truth"),
    "sample": ("samples", "generate a sample study with known truth"),
    "beans": ("samples", "generate the paper's coffee-bean cohort"),
    "analyze": ("analysis", "compare groups, regress on a variable, compare pairs"),
    "plan": ("plan", "plan a study of two groups from a pilot: power, needed numbers, stability"),
    "check": ("analysis", "list places where the correspondence may be wrong, and repair them"),
    "report": ("analysis", "write a report on a project's model and studies (HTML, PDF)"),
    "reference": ("patient", "freeze a project's controls as a reference for single patients"),
    "patient": ("patient", "compare a patient's shape with a reference: how unusual, and where"),
    "import": ("project", "import a ShapeWorks project or a folder of particles"),
    "export": ("export", "films, pictures, plots, meshes, tables and particles for other programs"),
    "geodesics": ("analysis", "compute geodesic distances on a surface"),
    "doctor": ("doctor", "show what this machine offers, and the remedy for what is missing"),
    "worker": ("run", "run a worker for a Dask scheduler (homolog run --cluster)"),
}
"""Module and purpose of each command, for ``homolog --help``, which imports none."""

_DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM")


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code.

    Parameters
    ----------
    argv : sequence of str, optional
        Arguments after the program's name; those of the process by default.
    """
    if "_ARGCOMPLETE" in os.environ:  # the shell asks what may follow; this does not return
        import argcomplete

        argcomplete.autocomplete(command_parser()[0])
    given = sys.argv[1:] if argv is None else list(argv)
    command = next((word for word in given if not word.startswith("-")), None)
    if given and given[0] not in _COMMANDS and Path(given[0]).exists():
        return open_window(given)
    try:
        parser, modules = command_parser([command] if command in _COMMANDS else [])
        arguments, more = parser.parse_known_args(given)
        if more and all(Path(item).exists() for item in more):  # as the shell expands *.nii.gz
            parser.error(f"{command} takes one folder or table; give the folder of these files: {more[0]}, …")
        if more:
            parser.error(f"unrecognized arguments: {' '.join(more)}")
        if arguments.command is None:
            return open_window([])
        from homolog_app.cli.options import handling  # its imports are those of every command

        with handling(signal.SIGTERM, signal.default_int_handler):  # clean up as for Ctrl-C
            return int(getattr(modules[arguments.command], f"run_{arguments.command}")(arguments))
    except (Cancelled, KeyboardInterrupt):
        sys.stderr.write("cancelled\n")
        return CANCELLED
    except Exception as error:
        message = user_message(error)
        if message is None:
            raise
        _print_errors(message)
        return PROGRAM_ERROR if isinstance(error, NumericalError) else INPUT_ERROR


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


def command_parser(
    commands: Collection[str] = tuple(_COMMANDS),
) -> tuple[argparse.ArgumentParser, dict[str, ModuleType]]:
    """Return the parser and the modules of the given commands; others are listed without options.

    Parameters
    ----------
    commands : collection of str
        All, if not given.
    """
    parser = argparse.ArgumentParser(
        prog="homolog",
        description="Statistical shape analysis: corresponding points on a cohort of shapes, shape models "
        "and group tests. Without a command the window opens; homolog FOLDER opens a project or cohort.",
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="show the version and exit")
    subparsers = parser.add_subparsers(dest="command", metavar="COMMAND", title="commands")
    modules = {}
    for name, (module, summary) in _COMMANDS.items():
        if name in commands:
            from homolog_app.cli.options import add_command  # the list of commands does without

            modules[name] = importlib.import_module(f"{__name__}.{module}")
            add_command(subparsers, name, getattr(modules[name], f"run_{name}"), summary)
        else:
            subparsers.add_parser(name, help=summary)
    return parser, modules


class _Version(argparse.Action):
    """Prints the version, with its commit where that is known."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        """Print and exit; git is asked only then."""
        commit = _commit()
        sys.stdout.write(f"homolog {__version__}{f' ({commit})' if commit else ''}\n")
        parser.exit()


def _commit() -> str:
    """Return the commit that was installed, or that of the checkout; empty if there is none."""
    root = Path(__file__).parents[3]
    with suppress(OSError):  # no commit was stored, or no git on this machine
        if not (root / ".git").exists():
            return Path(homolog.__file__).with_name("commit.txt").read_text("utf-8").strip()
        command = ["git", "-C", str(root), "rev-parse", "--short", "HEAD"]
        return subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()
    return ""


def _print_errors(message: str) -> None:
    """Print one line for each error."""
    for line in message.splitlines():
        sys.stderr.write(f"homolog: {line}\n")
