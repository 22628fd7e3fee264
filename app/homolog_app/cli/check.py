"""``homolog check``: places where the correspondence of a result may be wrong."""

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from homolog.errors import InputError
from homolog.files.project import ProjectFolder
from homolog_app.cli.options import add_former_name
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
        description="List places where the correspondence may be wrong, the most severe first: exchanged "
        "particles, swapped neighbourhoods, normals that disagree with the other subjects, folded triangles, "
        "uncovered regions.",
    )
    parser.add_argument("project", type=Path, help="project folder")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the list to FILE.csv or FILE.json")
    least = parser.add_argument(
        "--min-severity",
        type=float,
        default=1.0,
        metavar="SEVERITY",
        help="lowest severity to list (default 1)",
    )
    repair = parser.add_argument(
        "--repair", type=int, default=0, metavar="COUNT",
        help="optimize the particles around the COUNT most severe suspects again, and keep what improves",
    )  # fmt: skip
    add_former_name(parser, "--least", least)
    add_former_name(parser, "--mend", repair)
    add_progress_option(parser)


def run(arguments: argparse.Namespace) -> int:
    """List the suspects; returns the exit code."""
    from homolog.progress import part_of
    from homolog_app.suspects import inspect_project, rows, write_suspects

    if arguments.repair < 0 or not arguments.min_severity >= 0.0:
        raise InputError("--repair and --min-severity must be 0 or more")
    if arguments.out is not None and arguments.out.suffix.lower() not in (".csv", ".json"):
        raise InputError(
            f"--out {arguments.out}: the list can be written as .csv or .json; use one of these suffixes"
        )
    project = ProjectFolder(arguments.project)
    project.recover()
    with show_progress(arguments.progress) as progress:
        share = 0.2 if arguments.repair else 1.0
        result, inspection = inspect_project(project, part_of(progress.tick, 0.0, share))
        notes: list[str] = []
        if arguments.repair:
            rest = part_of(progress.tick, share, 1.0)
            inspection, notes = _repair(project, result, inspection, arguments.repair, rest)
    table = rows(
        inspection,
        [suspect for suspect in inspection.suspects if suspect.severity >= arguments.min_severity],
        result.names,
    )
    if arguments.out is not None:
        write_suspects(arguments.out, table)
    lines = [
        f"{severity:6.2f}  {kind:<22} {name}: {description}"
        for kind, name, severity, *_, description in table
    ]
    suspects = "1 suspect" if len(table) == 1 else f"{len(table)} suspects"
    ending = f"{suspects} of {len(result.names)} subjects x {result.local.shape[1]} particles"
    stream = sys.stderr if arguments.progress == "json" else sys.stdout
    stream.write("\n".join([*notes, *lines, ending]) + "\n")
    return 0


def _repair(
    project: ProjectFolder, result: "Result", inspection: "Inspection", count: int, tick: "Tick"
) -> "tuple[Inspection, list[str]]":
    """Repair the most severe suspects one after another; keep what gets better."""
    from homolog.progress import part_of
    from homolog.run.repair import write_repaired
    from homolog_app.suspects import mended

    chosen = inspection.suspects[:count]
    lines: list[str] = []
    notes: dict[str, str] = {}
    for number, suspect in enumerate(chosen):
        part = part_of(tick, 0.9 * number / len(chosen), 0.9 * (number + 1) / len(chosen))
        after = mended(project, inspection, suspect, part)
        name = result.names[suspect.subject]
        before, now = (
            sum(s.severity for s in item.suspects if s.subject == suspect.subject)
            for item in (inspection, after)
        )
        better = now < before
        lines.append(f"{'repaired' if better else 'unchanged'}: {name}: {suspect.description}")
        if better:
            inspection = after
            notes[name] = "particles of suspects were optimized again"
    if notes:
        write_repaired(project, inspection.located.local, notes, part_of(tick, 0.9, 1.0))
    return inspection, lines
