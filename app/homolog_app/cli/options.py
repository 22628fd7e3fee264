"""Options of commands from settings; progress and the end of a run on the command line."""

import argparse
import json
import shutil
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any, TextIO, TypeVar

from pydantic import BaseModel, ValidationError

from homolog.errors import InputError
from homolog.parameters import Parameter, fault_text, parameters
from homolog.settings import GroomSettings, Openings, RunSettings

__all__ = [
    "ANYWAY",
    "PROGRESS",
    "PROJECT",
    "Part",
    "Progress",
    "add_command",
    "command",
    "declare",
    "handling",
    "note",
    "one_of",
    "option",
    "options_of",
    "remaining_seconds",
    "settings",
    "show_progress",
    "titled",
    "with_all_options",
    "with_options",
    "write_lines",
]

Part = Callable[[Any], object]
"""Declares an option, or several, on a parser or a group of one."""
Run = Callable[[argparse.Namespace], int]
_SomeRun = TypeVar("_SomeRun", bound=Run)
_DECLARED: dict[Run, tuple[str, tuple[Part, ...], dict[str, Any]]] = {}


def option(*names: str, **how: Any) -> Part:  # noqa: ANN401 - as argparse takes them
    """Return an option or argument; the parameters are those of `argparse.ArgumentParser.add_argument`."""
    return lambda parser: parser.add_argument(*names, **how)


def one_of(*options: Part) -> Part:
    """Return options of which at most one may be given."""
    return lambda parser: declare(parser.add_mutually_exclusive_group(), options)


def titled(title: str, *options: Part) -> Part:
    """Return options that help lists under a title."""
    return lambda parser: declare(parser.add_argument_group(title), options)


def declare(parser: Any, parts: Sequence[Part]) -> None:  # noqa: ANN401 - groups have no public type
    """Declare options on a parser."""
    for part in parts:
        part(parser)


def command(description: str, *parts: Part, **how: Any) -> Callable[[_SomeRun], _SomeRun]:  # noqa: ANN401
    """Decorate the function that runs a command.

    Parameters
    ----------
    description : str
        Shown by help.
    parts : callable
        Its options, in the order of help.
    how : object
        More for the parser.
    """

    def remember(run: _SomeRun) -> _SomeRun:
        _DECLARED[run] = description, parts, how
        return run

    return remember


def add_command(subparsers: Any, name: str, run: Run, summary: str) -> None:  # noqa: ANN401
    """Add the parser of a command that `command` describes."""
    description, parts, how = _DECLARED[run]
    declare(subparsers.add_parser(name, help=summary, description=description, **how), parts)


PROJECT = option("project", type=Path, help="project folder")
ANYWAY = option("--anyway", action="store_true", help="use the model even if its verdict is: not usable")
PROGRESS = option(
    "--progress",
    choices=["bar", "json", "none"],
    default="bar",
    help="bar (default), json (one object per line on standard output) or none",
)


def note(*lines: str) -> None:
    """Write lines that begin with the program's name to standard error."""
    write_lines(*(f"homolog: {line}" for line in lines), aside=True)


def write_lines(*lines: str, aside: bool = False) -> None:
    """Write lines to standard output, or aside, to standard error."""
    (sys.stderr if aside else sys.stdout).writelines(f"{line}\n" for line in lines)


_Model = TypeVar("_Model", bound=BaseModel)
_AUTO = "auto"
_LABEL_HELP = (
    "Number of the structure's label, or its name as homolog labels lists it. (default: all labels above 0)"
)


def settings(model: type[BaseModel], leaving_out: Sequence[str] = ()) -> Part:
    """Return an option for each setting of a model; those not given are absent from the arguments."""
    options: list[Part] = []
    for parameter in parameters(model):
        if parameter.name in leaving_out:
            continue
        how: dict[str, Any] = {"metavar": _metavar(parameter)}
        if parameter.kind is bool:
            how = {"action": argparse.BooleanOptionalAction}
        summary = _help(parameter)
        if model is GroomSettings and parameter.name == "label":
            how, summary = {"metavar": "LABEL"}, _LABEL_HELP
        options.append(option(_option(parameter), default=argparse.SUPPRESS, help=summary, **how))
        for short in (Openings.OPEN, Openings.CLOSE) if parameter.kind is Openings else ():
            how = {"action": "store_const", "const": short.value, "dest": parameter.name}
            about = f"Short for {_option(parameter)} {short}."
            options.append(option(f"--{short}", default=argparse.SUPPRESS, help=about, **how))
    return titled(_title(model), *options)


def with_options(settings: _Model, arguments: argparse.Namespace) -> _Model:
    """Return the settings, updated from the command line.

    Raises
    ------
    InputError
        With a line for each invalid value.
    """
    given = {
        parameter.name: None if value == _AUTO and parameter.default is None else value
        for parameter in parameters(type(settings))
        if (value := getattr(arguments, parameter.name, parameter)) is not parameter
    }
    try:
        return type(settings).model_validate(settings.model_dump() | given)
    except ValidationError as error:
        lines = [
            f"--{str(item['loc'][0]).replace('_', '-')} {item['input']}: {fault_text(item)}"
            for item in error.errors()
        ]
        raise InputError("\n".join(dict.fromkeys(lines))) from error


def with_all_options(settings: RunSettings, arguments: argparse.Namespace) -> RunSettings:
    """Return a run's settings, updated from the command line; ``--label`` accepts a name, too.

    Raises
    ------
    InputError
        See `with_options`.
    """
    structure = getattr(arguments, "label", None)
    if structure is not None:  # a new structure replaces the previous choice
        named = structure != _AUTO and not structure.strip().lstrip("+-").isdecimal()
        defaults = {"label": _AUTO, "segment": structure} if named else {"segment": _AUTO} | vars(arguments)
        arguments = argparse.Namespace(**(vars(arguments) | defaults))
    groom, optimize = with_options(settings.groom, arguments), with_options(settings.optimize, arguments)
    return with_options(settings, arguments).model_copy(update={"groom": groom, "optimize": optimize})


def options_of(settings: BaseModel) -> list[str]:
    """Return the command-line options for these settings, without defaults."""
    line: list[str] = []
    for parameter in parameters(type(settings)):
        value = getattr(settings, parameter.name)
        if value == parameter.default:
            continue
        if parameter.kind is bool:
            line.append(_option(parameter) if value else _option(parameter).replace("--", "--no-", 1))
        else:
            line += [
                f"{_option(parameter)}={_AUTO if value is None else value}"
            ]  # with =, since numbers may begin with -
    return line


def _option(parameter: Parameter) -> str:
    return f"--{parameter.name.replace('_', '-')}"


def _title(model: type[BaseModel]) -> str:
    return (model.__doc__ or model.__name__).split("\n")[0].rstrip(".").lower()


def _metavar(parameter: Parameter) -> str:
    return "{" + ",".join(parameter.choices) + "}" if parameter.choices else parameter.kind.__name__.upper()


def _help(parameter: Parameter) -> str:
    default = parameter.default
    if parameter.kind is bool:
        default = "on" if default else "off"
    facts = [parameter.bounds, parameter.unit, "" if default in ("", None) else f"default {default}"]
    brackets = ", ".join(fact for fact in facts if fact)
    return f"{parameter.help} ({brackets})".replace(" ()", "").replace("%", "%%")


_WIDTH = 28
_REDRAW_S = 0.1
_LINE_S = 10.0


def remaining_seconds(fraction: float, elapsed: float) -> float | None:
    """Return the estimated seconds left at the mean speed; None while unknown."""
    return elapsed * (1.0 - fraction) / fraction if fraction > 0.01 and elapsed > 1.0 else None


class Progress:
    """Progress output. `tick` is a `homolog.progress.Tick`."""

    def __init__(self, mode: str, stream: TextIO) -> None:
        self._mode = mode
        self._stream = stream
        self._moves = mode == "bar" and stream.isatty()
        self._started = time.monotonic()
        self._drawn = 0.0
        self._said: str | None = ""

    def tick(self, fraction: float, message: str) -> None:
        """Show the progress of a task without phases."""
        self.show(fraction, message, remaining_seconds(fraction, time.monotonic() - self._started))

    def show(
        self, fraction: float, message: str, eta_s: float | None = None, phase: str | None = None
    ) -> None:
        """Show the fraction done [0, 1], the current step and the seconds left, if known."""
        now = time.monotonic()
        pause = _LINE_S if self._mode == "bar" and not self._moves else _REDRAW_S
        if self._mode == "none" or (now - self._drawn < pause and phase == self._said and fraction < 1.0):
            return
        self._drawn, self._said = now, phase
        if self._mode == "json":
            eta = None if eta_s is None else round(eta_s, 1)
            record = {"phase": phase, "fraction": round(fraction, 4), "message": message, "eta_s": eta}
            self._stream.write(json.dumps(record) + "\n")
        else:
            named = phase is None or message.startswith(phase)
            line = _line(fraction, message if named else f"{phase}: {message}", eta_s)
            width = shutil.get_terminal_size().columns - 1
            self._stream.write(f"\r\x1b[2K{line[:width]}" if self._moves else f"{line}\n")
        self._stream.flush()

    def close(self) -> None:
        """Clear the bar."""
        if self._moves:
            self._stream.write("\r\x1b[2K")
            self._stream.flush()


def _line(fraction: float, message: str, eta_s: float | None) -> str:
    done = round(_WIDTH * fraction)
    left = "" if eta_s is None else f" {int(eta_s) // 60}:{int(eta_s) % 60:02d} left"
    return f"[{'#' * done}{'.' * (_WIDTH - done)}] {100 * fraction:3.0f} %{left}  {message}"


@contextmanager
def show_progress(mode: str) -> Iterator[Progress]:
    """Yield the `Progress` of a command and clean up after it.

    JSON lines go to standard output, the bar to standard error (a line every ten seconds if this is not a
    terminal).
    """
    progress = Progress(mode, sys.stdout if mode == "json" else sys.stderr)
    try:
        yield progress
    finally:
        progress.close()


@contextmanager
def handling(number: int, handle: Callable[[int, FrameType | None], object]) -> Iterator[None]:
    """Handle a signal within the block; only in the main thread."""
    before = signal.signal(number, handle)
    try:
        yield
    finally:
        signal.signal(number, before)
