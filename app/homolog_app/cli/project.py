"""Projects: ``homolog info``, ``table``, ``import``. Structures of label maps: ``labels``, ``batch``."""

import argparse
import json
import sys
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

from homolog.cohort import with_table, with_values_of
from homolog.errors import InputError, NumericalError
from homolog.io.project import ProjectFolder
from homolog.io.records import ProjectRecord, ResultRecord, note_lines
from homolog.settings import GroomSettings, OptimizeSettings, RunSettings, Values
from homolog_app.cli.cohort import MISSING, cohort_of, cohort_options
from homolog_app.cli.options import (
    PROGRESS,
    PROJECT,
    Progress,
    command,
    note,
    option,
    settings,
    show_progress,
    with_all_options,
    write_lines,
)
from homolog_app.cli.run import interrupt_cancels
from homolog_app.rendering.text import aligned

if TYPE_CHECKING:
    from homolog.io.structures import Structure, Structures
    from homolog.run.batch import BatchItem
    from homolog.run.events import RunStatus

__all__ = ["run_batch", "run_import", "run_info", "run_labels", "run_table"]

_NAMES_OF_NOTE = 5


@command(
    "Show what a project contains.",
    PROJECT,
    option("--json", action="store_true", help="print the complete record as JSON"),
)
def run_info(arguments: argparse.Namespace) -> int:
    """Print the record; return the exit code."""
    project = ProjectFolder(arguments.project)
    project.recover()
    record = project.read()
    facts = (f"{name:<12} {value}" for name, value in _facts(project, record))
    write_lines(*([record.model_dump_json(indent=2)] if arguments.json else facts))
    return 0


def _facts(project: ProjectFolder, record: ProjectRecord) -> list[tuple[str, str]]:
    facts = [
        ("project", str(project.folder)),
        ("subjects", _groups([subject.group for subject in record.subjects])),
    ]
    if record.unfinished:
        state = "interrupted" if project.checkpoint.is_file() else "interrupted before the first particles"
        facts.append(("last run", f"{state}; to continue: homolog run {quote(str(project.folder))} --resume"))
    if record.result is None:
        return [*facts, ("result", "none yet")]
    return [*facts, *_result_facts(record.result), *_landmarks(project, record)]


def _landmarks(project: ProjectFolder, record: ProjectRecord) -> list[tuple[str, str]]:
    if not any(subject.landmarks for subject in record.subjects):
        return []
    from homolog.run.landmarks import project_landmark_errors
    from homolog_app.report.model_section import landmark_text

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
        ("ended", result.end_text),
        ("surface", result.surface_text),
        *([("mirrored", _mirrored(result))] if result.mirrored_text else []),
        ("settings", json.dumps(changed) if changed else "defaults"),
        ("device", result.device),
        *([("time", _times(result))] if result.seconds else []),
        ("versions", ", ".join(f"{name} {number}" for name, number in result.versions.items())),
        ("fingerprint", result.fingerprint),
    ]
    notes = {subject.name: subject.notes for subject in result.subjects}
    return facts + [("note", line) for line in note_lines(notes, _NAMES_OF_NOTE)]


def _mirrored(result: ResultRecord) -> str:
    names = ", ".join(subject.name for subject in result.subjects if subject.is_mirrored)
    return f"{result.mirrored_text}: {names}"


def _times(result: ResultRecord) -> str:
    return ", ".join(f"{phase} {seconds:.1f} s" for phase, seconds in result.seconds.items())


def _groups(groups: list[str | None]) -> str:
    named = {name: groups.count(name) for name in groups if name is not None}
    listed = ", ".join(f"{count} {name}" for name, count in named.items())
    return f"{len(groups)} ({listed})" if listed else str(len(groups))


@command(
    "Add or replace groups and covariates of a project from a table (CSV with commas, "
    "semicolons or tabs, or XLSX). Its column name, subject or id, or else the first column, contains "
    "the subjects' names or the names of their files. Empty cells keep the current value. Particles do "
    "not change.",
    PROJECT,
    option("table", type=Path, nargs="?", help="table to read; not needed with --missing"),
    MISSING,
    option("--dry-run", action="store_true", help="only show the changes"),
)
def run_table(arguments: argparse.Namespace) -> int:
    """Print the changes and write them; return the exit code."""
    from homolog.io.project_table import update_table

    project = ProjectFolder(arguments.project)
    if arguments.table is None and not arguments.missing:
        raise InputError(f"{project.folder}: name a table, or a value that stands for missing ones")
    with project.locked(new=False):
        subjects = project.cohort().subjects
        if arguments.table is None:
            changes = with_values_of(subjects, subjects, arguments.missing)
        else:
            changes = with_table(subjects, arguments.table, arguments.missing)
        write_lines(*changes.lines)
        if arguments.dry_run:
            write_lines("nothing was written (--dry-run)")
        elif not changes.is_empty:
            update_table(project, changes.subjects)
            write_lines(f"written to {project.folder}")
    return 0


@command(
    "Create a project from a ShapeWorks project (.swproj, .xlsx) or a folder of .particles "
    "files. Its result can be viewed and analyzed; nothing is optimized.",
    option("source", type=Path, help=".swproj or .xlsx file, or folder of .particles"),
    option("project", type=Path, help="project folder to create"),
    option("--domain", metavar="NAME", help="one anatomy of several (default: all together)"),
    PROGRESS,
)
def run_import(arguments: argparse.Namespace) -> int:
    """Import the model; return the exit code."""
    from homolog.run.import_model import import_model

    project = ProjectFolder(arguments.project)
    with show_progress(arguments.progress) as progress:
        notes = import_model(arguments.source, project, domain=arguments.domain, tick=progress.tick)
    note(*(f"note: {text}" for text in notes))
    result = project.read().result
    assert result is not None, "an imported project has a result"
    count = f"{len(result.subjects)} subjects x {result.particles} particles"
    write_lines(count, f"results in {project.folder}", aside=arguments.progress == "json")
    return 0


_HEADS = ("name", "number", "subjects", "volume (ml): min", "median", "max", "at border")


@command(
    "List the structures in a cohort's files: names, numbers, numbers of subjects, "
    "volumes, and numbers of images whose border they touch, where they may be cut off. Use homolog run "
    "COHORT --label NAME for one of them, homolog batch for all.",
    *cohort_options("folder of label maps, cohort.csv, or project"),
    option("--json", action="store_true", help="print all volumes as JSON"),
    PROGRESS,
)
def run_labels(arguments: argparse.Namespace) -> int:
    """List the structures; return the exit code."""
    from homolog.io.structures import list_structures

    cohort = cohort_of(arguments)
    with show_progress(arguments.progress) as progress:
        listed = list_structures(cohort, progress.tick)
    lines = _structure_lines(listed, len(cohort.subjects))
    write_lines(*([json.dumps(_record(listed), indent=2)] if arguments.json else lines))
    note(*listed.problems.values(), *listed.unavailable)
    return 0


def _structure_lines(listed: "Structures", subjects: int) -> list[str]:
    if not listed.structures and not listed.empty:
        return ["the files contain no labelled structure"]
    rows = [_HEADS, *(_structure_row(structure, subjects) for structure in listed.structures)]
    rows += [(name, "-", f"0/{subjects}", "-", "-", "-", "-") for name in listed.empty]
    return aligned(rows, to_right=True)


def _structure_row(structure: "Structure", subjects: int) -> tuple[str, ...]:
    return (
        structure.name or "-",
        "/".join(map(str, structure.values)) or "-",
        f"{len(structure.by_subject)}/{subjects}",
        *(f"{volume:.4g}" if volume else "" for volume in structure.volumes),
        str(len(structure.at_border) or "-"),
    )


def _record(listed: "Structures") -> dict[str, object]:
    structures = [
        {
            "name": structure.name,
            "numbers": structure.values,
            "volumes_ml": {
                subject: round(there.volume, 6) if there.volume else None
                for subject, there in structure.by_subject.items()
            },
            "at_border": structure.at_border,
        }
        for structure in listed.structures
    ]
    return {"structures": structures, "empty": listed.empty, "problems": dict(listed.problems)}


@command(
    "Compute a shape model of each structure in a cohort's label maps, each in its own "
    "project, and an index.html that lists them. A model contains the subjects that have the structure. "
    "If one structure fails, the others continue. After Ctrl-C the same command continues.",
    *cohort_options("folder of label maps, cohort.csv, or project"),
    option("--out", type=Path, required=True, help="folder for the projects and the index"),
    option(
        "--labels",
        default="all",
        metavar="NAME,NAME",
        help="names or numbers of structures, separated by commas, as homolog labels lists them (default: "
        "all)",
    ),
    option(
        "--min-subjects",
        type=int,
        default=3,
        metavar="N",
        help="skip structures with fewer subjects (2 or more, default 3)",
    ),
    option("--restart", action="store_true", help="compute finished structures again"),
    option("--no-figures", dest="figures", action="store_false", help="write no pictures"),
    PROGRESS,
    settings(OptimizeSettings, leaving_out=("label", "segment")),
    settings(GroomSettings, leaving_out=("label", "segment")),
    settings(RunSettings, leaving_out=("label", "segment")),
)
def run_batch(arguments: argparse.Namespace) -> int:
    """Run the batch; return the exit code."""
    from homolog.io.structures import chosen_structures, list_structures
    from homolog.run.batch import Batch, ItemState
    from homolog.run.events import FinishReason
    from homolog_app.cli import CANCELLED, OK, PROGRAM_ERROR
    from homolog_app.report.page import write_index

    names = [part.strip() for part in arguments.labels.split(",") if part.strip()]
    settings = with_all_options(RunSettings(), arguments)
    cohort, values = cohort_of(arguments), settings.groom.values or Values.LABELS
    with show_progress(arguments.progress) as progress:
        listed = list_structures(cohort, progress.tick, values)
    note(*(f"skipped: {text}" for text in (*listed.problems.values(), *listed.unavailable)))
    if not listed.structures and not listed.empty:
        raise InputError(
            f"{arguments.cohort}: its files contain no labelled structure; use homolog run for surfaces"
        )
    structures = chosen_structures(listed.structures, names, listed.empty)
    if not structures:
        raise InputError(
            f"{arguments.cohort}: the masks of all subjects are empty: {', '.join(listed.empty)}"
        )
    for name in listed.empty:
        _print_state(name, "empty", "the masks of all subjects are empty", arguments.progress)
    batch = Batch(
        cohort.without(set(listed.problems)),
        structures,
        arguments.out,
        settings,
        fewest=arguments.min_subjects,
        anew=arguments.restart,
    )
    with show_progress(arguments.progress) as progress, interrupt_cancels(batch.cancel):

        def observe(item: "BatchItem", fraction: float, status: "RunStatus") -> None:
            progress.show(fraction, f"{item.structure.title}: {status.message}")

        def ended(item: "BatchItem") -> None:
            progress.close()
            if arguments.figures and item.state is ItemState.FINISHED and not item.was_there:
                _draw(item, progress)
            _print_item(item, arguments.progress)
            write_index(batch, cohort, listed.problems, listed.empty)

        reason = batch.execute(observe, ended)
    failed = [entry for entry in batch.items if entry.state is ItemState.FAILED]
    if reason is FinishReason.CANCELLED:
        write_lines("cancelled; the same command continues the batch", aside=True)
        return CANCELLED
    if arguments.progress != "json":
        write_lines(str(arguments.out / "index.html"))
    return PROGRAM_ERROR if failed else OK


def _draw(item: "BatchItem", progress: Progress) -> None:
    from homolog_app.pictures.figures import draw_figures

    try:
        draw_figures(item.project, progress.tick)
    except (InputError, NumericalError) as error:
        note(f"{item.structure.title}: no pictures: {error}")


def _print_state(name: str, state: str, message: str, mode: str, more: str = "") -> None:
    """Print a line for a structure."""
    record = {"structure": name, "state": state, "message": message}
    text = f"{name}: {state}{f': {message}' if message else ''}{more}"
    write_lines(json.dumps(record) if mode == "json" else text)
    sys.stdout.flush()


def _print_item(item: "BatchItem", mode: str) -> None:
    """Print a line for a structure, and for each subject that was skipped."""
    counts = f"{len(item.structure.by_subject)} subjects" + (
        f", absent in {len(item.absent)}" if item.absent else ""
    )
    state = f"{item.state} before" if item.was_there and mode != "json" else item.state
    _print_state(item.structure.title, state, item.message, mode, f" ({counts})")
    note(*(f"{item.structure.title}: skipped: {line}" for line in item.left_out))
