"""``homolog check``: the places of a project's result where the correspondence may be wrong."""

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from homolog.errors import InputError
from homolog.files.project import Project
from homolog_app.cli.progress import add_progress_option, show_progress

if TYPE_CHECKING:
    from homolog.files.results import Result
    from homolog.inspection import Inspection
    from homolog.progress import Tick

__all__ = ["add_parser", "run"]


def add_parser(subparsers: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the command."""
    parser = subparsers.add_parser(
        "check",
        help="list places where the correspondence may be wrong, mend them",
        description="List the places of a project's result where the correspondence may be wrong, the most "
        "severe first: exchanged particles, swapped neighbourhoods, normals far from the other subjects', "
        "folded triangles, uncovered regions. Severity 1 is the least that is listed.",
    )
    parser.add_argument("project", type=Path, help="project folder")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the list, as FILE.csv or FILE.json")
    parser.add_argument(
        "--least", type=float, default=1.0, metavar="SEVERITY", help="list none less severe (default 1)"
    )
    parser.add_argument(
        "--mend", type=int, default=0, metavar="COUNT",
        help="first optimize the particles around so many suspects again, the most severe first, and keep "
        "what is less suspect then",
    )  # fmt: skip
    add_progress_option(parser)


def run(arguments: argparse.Namespace) -> int:
    """List the suspects; returns the exit code."""
    from homolog.progress import part_of
    from homolog_app.suspects import inspect_project, rows, write_suspects

    if arguments.mend < 0 or not arguments.least >= 0.0:
        raise InputError("--mend counts suspects and --least is a severity: neither can be negative")
    if arguments.out is not None and arguments.out.suffix.lower() not in (".csv", ".json"):
        raise InputError(f"--out {arguments.out}: the list is written as .csv or .json; name the file so")
    project = Project(arguments.project)
    project.recover()
    with show_progress(arguments.progress) as progress:
        share = 0.2 if arguments.mend else 1.0
        result, found = inspect_project(project, part_of(progress.tick, 0.0, share))
        notes: list[str] = []
        if arguments.mend:
            found, notes = _mend(project, result, found, arguments.mend, part_of(progress.tick, share, 1.0))
    table = rows(found, [one for one in found.suspects if one.severity >= arguments.least], result.names)
    if arguments.out is not None:
        write_suspects(arguments.out, table)
    lines = [f"{severity:6.2f}  {kind:<22} {name}: {words}" for kind, name, severity, *_, words in table]
    ending = f"{len(table)} suspects of {len(result.names)} subjects x {result.local.shape[1]} particles"
    stream = sys.stderr if arguments.progress == "json" else sys.stdout
    stream.write("\n".join([*notes, *lines, ending]) + "\n")
    return 0


def _mend(
    project: Project, result: "Result", found: "Inspection", count: int, tick: "Tick"
) -> "tuple[Inspection, list[str]]":
    """Mend the most severe suspects one after another; what does not get better is left as it was."""
    from homolog.progress import part_of
    from homolog.run.mend import write_mended
    from homolog_app.suspects import mended

    chosen = found.suspects[:count]
    lines: list[str] = []
    notes: dict[str, str] = {}
    for number, suspect in enumerate(chosen):
        part = part_of(tick, 0.9 * number / len(chosen), 0.9 * (number + 1) / len(chosen))
        after = mended(project, found, suspect, part)
        name = result.names[suspect.subject]
        before, now = (
            sum(s.severity for s in one.suspects if s.subject == suspect.subject) for one in (found, after)
        )
        better = now < before
        lines.append(f"{'mended' if better else 'kept as it was'}: {name}: {suspect.words}")
        if better:
            found = after
            notes[name] = "particles were optimized again where they were suspect"
    if notes:
        write_mended(project, found.places.local, notes, part_of(tick, 0.9, 1.0))
    return found, lines
