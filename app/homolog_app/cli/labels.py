"""``homolog labels``: the structures in a cohort's files."""

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from homolog_app.cli.cohorts import cohort_of
from homolog_app.cli.progress import add_progress_option, show_progress

if TYPE_CHECKING:
    from homolog.grooming.structures import Structure, Structures

__all__ = ["add_parser", "run"]

_HEADS = ("name", "number", "subjects", "volume (ml): min", "median", "max", "at border")


def add_parser(subparsers: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the command."""
    parser = subparsers.add_parser(
        "labels",
        description="List the structures in a cohort's files: names, numbers, how many subjects have them, "
        "volumes, and in how many images they touch the border and may be cut off. Use homolog run COHORT "
        "--label NAME for one of them, homolog batch for all.",
    )
    parser.add_argument("cohort", type=Path, help="folder of label maps, cohort.csv, or project")
    parser.add_argument("--json", action="store_true", help="print all volumes as JSON")
    add_progress_option(parser)


def run(arguments: argparse.Namespace) -> int:
    """List what there is; returns the exit code."""
    from homolog.grooming.structures import list_structures
    from homolog.progress import run_in_background

    cohort = cohort_of(arguments.cohort)
    with show_progress(arguments.progress) as progress:
        listed = run_in_background(lambda tick: list_structures(cohort, tick), progress.tick, "reading")
    if arguments.json:
        sys.stdout.write(json.dumps(_record(listed), indent=2) + "\n")
    else:
        _print(listed, len(cohort.subjects))
    for message in listed.problems.values():
        sys.stderr.write(f"homolog: {message}\n")
    return 0


def _print(listed: "Structures", subjects: int) -> None:
    if not listed.structures:
        sys.stdout.write("the files contain no labelled structure\n")
        return
    rows = [_HEADS, *(_row(structure, subjects) for structure in listed.structures)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = [
            row[0].ljust(widths[0]),
            *(cell.rjust(w) for cell, w in zip(row[1:], widths[1:], strict=True)),
        ]
        sys.stdout.write("  ".join(cells) + "\n")


def _row(structure: "Structure", subjects: int) -> tuple[str, ...]:
    return (
        structure.name or "-",
        "/".join(map(str, structure.values)) or "-",
        f"{len(structure.by_subject)}/{subjects}",
        *(f"{volume:.4g}" for volume in structure.volumes),
        str(len(structure.at_border) or "-"),
    )


def _record(listed: "Structures") -> dict[str, object]:
    structures = [
        {
            "name": structure.name,
            "numbers": structure.values,
            "volumes_ml": {
                subject: round(there.volume, 6) for subject, there in structure.by_subject.items()
            },
            "at_border": structure.at_border,
        }
        for structure in listed.structures
    ]
    return {"structures": structures, "problems": dict(listed.problems)}
