"""``homolog info``: what a project contains."""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from homolog.errors import InputError, NumericalError
from homolog.files.project import ProjectFolder
from homolog.files.records import ProjectRecord, ResultRecord

__all__ = ["add_parser", "how_it_ended", "run"]

_ENDINGS = {
    "converged": "converged after {} iterations",
    "iterations": "not converged after {} iterations",
    "cancelled": "cancelled after {} iterations",
    "imported": "imported, not optimized here",
}


def add_parser(subparsers: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the command."""
    parser = subparsers.add_parser("info", description="Show what a project contains.")
    parser.add_argument("project", type=Path, help="project folder")
    parser.add_argument("--json", action="store_true", help="print the complete record as JSON")


def run(arguments: argparse.Namespace) -> int:
    """Print the record; returns the exit code."""
    project = ProjectFolder(arguments.project)
    project.recover()
    record = project.read()
    if arguments.json:
        sys.stdout.write(record.model_dump_json(indent=2) + "\n")
    else:
        sys.stdout.write("".join(f"{name:<12} {value}\n" for name, value in _facts(project, record)))
    return 0


def how_it_ended(result: ResultRecord) -> str:
    """Say why the optimization ended and when."""
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
    from homolog_app.report.findings import landmark_words

    try:
        errors = project_landmark_errors(project)
    except (InputError, NumericalError) as error:
        return [("landmarks", str(error))]
    return [("landmarks", "no two subjects share a landmark" if errors is None else landmark_words(errors))]


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
        ("ended", how_it_ended(result)),
        ("surface", result.surface_words),
        *([("mirrored", _mirrored(result))] if result.mirrored_words else []),
        ("settings", json.dumps(changed) if changed else "defaults"),
        ("device", result.device),
        *([("time", _times(result))] if result.seconds else []),
        ("versions", ", ".join(f"{name} {number}" for name, number in result.versions.items())),
        ("fingerprint", result.fingerprint),
    ]
    return facts + [
        ("note", f"{subject.name}: {note}") for subject in result.subjects for note in subject.notes
    ]


def _mirrored(result: ResultRecord) -> str:
    names = ", ".join(subject.name for subject in result.subjects if subject.is_mirrored)
    return f"{result.mirrored_words}: {names}"


def _times(result: ResultRecord) -> str:
    return ", ".join(f"{phase} {seconds:.1f} s" for phase, seconds in result.seconds.items())


def _groups(groups: list[str | None]) -> str:
    named = {name: groups.count(name) for name in groups if name is not None}
    listed = ", ".join(f"{count} {name}" for name, count in named.items())
    return f"{len(groups)} ({listed})" if listed else str(len(groups))
