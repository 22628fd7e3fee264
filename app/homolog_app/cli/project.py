"""Contents of a project (``homolog info``), and its input (``table``, ``import``)."""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from homolog.cohort import with_table
from homolog.errors import InputError, NumericalError
from homolog.files.project import ProjectFolder
from homolog.files.records import ProjectRecord, ResultRecord
from homolog_app.cli.options import add_progress_option, show_progress

__all__ = ["add_import", "add_info", "add_table", "describe_end", "run_import", "run_info", "run_table"]


_ENDINGS = {
    "converged": "converged after {} iterations",
    "iterations": "not converged after {} iterations",
    "cancelled": "cancelled after {} iterations",
    "imported": "imported, not optimized here",
}


def add_info(subparsers: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the command."""
    parser = subparsers.add_parser("info", description="Show what a project contains.")
    parser.add_argument("project", type=Path, help="project folder")
    parser.add_argument("--json", action="store_true", help="print the complete record as JSON")


def run_info(arguments: argparse.Namespace) -> int:
    """Print the record; return the exit code."""
    project = ProjectFolder(arguments.project)
    project.recover()
    record = project.read()
    if arguments.json:
        sys.stdout.write(record.model_dump_json(indent=2) + "\n")
    else:
        sys.stdout.write("".join(f"{name:<12} {value}\n" for name, value in _facts(project, record)))
    return 0


def describe_end(result: ResultRecord) -> str:
    """Describe why and when the optimization ended."""
    return _ENDINGS.get(result.ended, result.ended).format(result.iterations)


def _facts(project: ProjectFolder, record: ProjectRecord) -> list[tuple[str, str]]:
    facts = [
        ("project", str(project.folder)),
        ("subjects", _groups([subject.group for subject in record.subjects])),
    ]
    if record.unfinished:
        state = "interrupted" if project.checkpoint.is_file() else "interrupted before the first particles"
        facts.append(("last run", f"{state}; to continue: homolog run {project.folder} --resume"))
    if record.result is None:
        return [*facts, ("result", "none yet")]
    return [*facts, *_result_facts(record.result), *_landmarks(project, record)]


def _landmarks(project: ProjectFolder, record: ProjectRecord) -> list[tuple[str, str]]:
    if not any(subject.landmarks for subject in record.subjects):
        return []
    from homolog.exchange import project_landmark_errors
    from homolog_app.report.findings import landmark_text

    try:
        errors = project_landmark_errors(project)
    except (InputError, NumericalError) as error:
        return [("landmarks", str(error))]
    return [("landmarks", "no two subjects share a landmark" if errors is None else landmark_text(errors))]


def _result_facts(result: ResultRecord) -> list[tuple[str, str]]:
    settings = result.settings.optimize
    changed = {
        name: value
        for part in (result.settings.groom, settings)
        for name, value in part.model_dump(mode="json", exclude_defaults=True).items()
    }
    facts = [
        ("result", f"{len(result.subjects)} subjects x {result.particles} particles, {result.finished}"),
        ("method", f"{settings.method}, {result.metric} distances, seed {settings.seed}"),
        *([("source", result.source)] if result.source else []),
        ("ended", describe_end(result)),
        ("surface", result.surface_text),
        *([("mirrored", _mirrored(result))] if result.mirrored_text else []),
        ("settings", json.dumps(changed) if changed else "defaults"),
        ("device", result.device),
        *([("time", _times(result))] if result.seconds else []),
        ("versions", ", ".join(f"{name} {number}" for name, number in result.versions.items())),
        ("fingerprint", result.fingerprint),
    ]
    notes: dict[str, list[str]] = {}
    for subject in result.subjects:
        for note in subject.notes:
            notes.setdefault(note, []).append(subject.name)
    return facts + [("note", f"{', '.join(names)}: {note}") for note, names in notes.items()]


def _mirrored(result: ResultRecord) -> str:
    names = ", ".join(subject.name for subject in result.subjects if subject.is_mirrored)
    return f"{result.mirrored_text}: {names}"


def _times(result: ResultRecord) -> str:
    return ", ".join(f"{phase} {seconds:.1f} s" for phase, seconds in result.seconds.items())


def _groups(groups: list[str | None]) -> str:
    named = {name: groups.count(name) for name in groups if name is not None}
    listed = ", ".join(f"{count} {name}" for name, count in named.items())
    return f"{len(groups)} ({listed})" if listed else str(len(groups))


def add_table(subparsers: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the command."""
    parser = subparsers.add_parser(
        "table",
        description="Add or replace groups and covariates of a project from a table (CSV with commas, "
        "semicolons or tabs, or XLSX). Its column name, subject or id, or else the first column, contains "
        "the subjects' names or the names of their files. Empty cells keep the present value. Particles do "
        "not change.",
    )
    parser.add_argument("project", type=Path, help="project folder")
    parser.add_argument("table", type=Path, help="table to read")
    parser.add_argument("--dry-run", action="store_true", help="only show the changes")


def run_table(arguments: argparse.Namespace) -> int:
    """Print the changes and write them; return the exit code."""
    from homolog.files.project_table import update_table

    project = ProjectFolder(arguments.project)
    with project.locked(new=False):
        changes = with_table(project.cohort().subjects, arguments.table)
        sys.stdout.write("".join(f"{line}\n" for line in changes.lines))
        if arguments.dry_run:
            sys.stdout.write("nothing was written (--dry-run)\n")
        elif not changes.is_empty:
            update_table(project, changes.subjects)
            sys.stdout.write(f"written to {project.folder}\n")
    return 0


def add_import(subparsers: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the command."""
    parser = subparsers.add_parser(
        "import",
        description="Create a project from a ShapeWorks project (.swproj, .xlsx) or a folder of .particles "
        "files. Its result can be viewed and analyzed; nothing is optimized.",
    )
    parser.add_argument("source", type=Path, help=".swproj or .xlsx file, or folder of .particles")
    parser.add_argument("project", type=Path, help="project folder to create")
    parser.add_argument("--domain", metavar="NAME", help="anatomy to import if the project has several")
    add_progress_option(parser)


def run_import(arguments: argparse.Namespace) -> int:
    """Import the model; return the exit code."""
    from homolog.exchange import import_model

    project = ProjectFolder(arguments.project)
    with show_progress(arguments.progress) as progress:
        notes = import_model(arguments.source, project, domain=arguments.domain, tick=progress.tick)
    for note in notes:
        sys.stderr.write(f"homolog: note: {note}\n")
    result = project.read().result
    assert result is not None, "an imported project has a result"
    stream = sys.stderr if arguments.progress == "json" else sys.stdout
    stream.write(
        f"{len(result.subjects)} subjects x {result.particles} particles\nresults in {project.folder}\n"
    )
    return 0
