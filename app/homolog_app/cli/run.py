"""``homolog run``, from a cohort to a shape model in a project folder, and ``homolog worker``."""

import argparse
import json
import signal
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from shlex import quote
from threading import Thread
from typing import TYPE_CHECKING

from homolog.cohort import (
    IMAGE_SUFFIXES,
    MESH_SUFFIXES,
    TABLE_SUFFIXES,
    Cohort,
    Subject,
    is_series,
    proposals_text,
    read_cohort,
    structures_in,
    subject_at,
    suffix_of,
    with_values_of,
)
from homolog.errors import InputError
from homolog.io.project import ProjectFolder
from homolog.settings import GroomSettings, OptimizeSettings, RunSettings
from homolog_app.cli.cohort import as_options, cohort_of, cohort_options, read_with_notes
from homolog_app.cli.options import (
    PROGRESS,
    command,
    handling,
    note,
    option,
    settings,
    show_progress,
    with_all_options,
    write_lines,
)

if TYPE_CHECKING:
    from homolog.run import Run, RunStatus

__all__ = ["interrupt_cancels", "run_run", "run_worker"]


_SHOWN_FILES = 3
_LISTED = 12
"""Largest number of structures in a message."""


@command(
    "Groom a cohort, place corresponding particles on its surfaces and compute the shape "
    "model. Ctrl-C stops the run; --resume continues it. If the project has a result with fewer "
    "particles, particles are added to it. If it already has this result, only groups and covariates are "
    "updated.",
    *cohort_options("folder of segmentations or meshes, cohort.csv, or project"),
    option("--out", type=Path, help="project folder to create (default: COHORT, if it is a project)"),
    option("--resume", action="store_true", help="continue a run that was cancelled or killed"),
    option(
        "--fit",
        type=Path,
        nargs="+",
        metavar="FILE",
        help="fit new subjects (files, folders or a cohort.csv) to the project's result, which does not "
        "change",
    ),
    option(
        "--restart", action="store_true", help="place all particles from the start, even if there is a result"
    ),
    option("--skip-invalid", action="store_true", help="skip files that can't be used"),
    option("--no-figures", dest="figures", action="store_false", help="write no pictures"),
    PROGRESS,
    settings(OptimizeSettings),
    settings(GroomSettings),
    settings(RunSettings),
)
def run_run(arguments: argparse.Namespace) -> int:
    """Run the pipeline; return the exit code."""
    project, cohort, settings = _run_inputs(arguments)
    with show_progress(arguments.progress) as progress:
        progress.show(0.0, "starting")
        from homolog.run import FinishReason, Phase, Run  # takes a second
    _check_structure(arguments.cohort, arguments.pattern, cohort, settings.groom)
    if _has_requested_result(arguments, project, cohort, settings):
        return _update_table(arguments, project, cohort)
    from_result = bool(arguments.fit) or _adds_particles(arguments, project, cohort, settings)
    from homolog_app.cli import CANCELLED, OK

    job = Run(
        project,
        cohort,
        settings,
        resume=arguments.resume,
        from_result=from_result,
        skip_bad=arguments.skip_invalid,
    )
    with show_progress(arguments.progress) as progress, interrupt_cancels(job.cancel):
        shown = ""

        def observe(status: "RunStatus") -> None:
            nonlocal shown
            if status.cluster not in ("", shown):
                shown = status.cluster
                progress.close()
                note(f"note: {shown}")
            progress.show(status.fraction, status.message, status.eta_s, status.phase)
            if arguments.figures and status.phase is Phase.MODELING:
                _start_drawing()

        try:
            reason = job.execute(observe)
        except InputError as error:
            raise _with_remedy(error, job, len(cohort.subjects)) from error
    note(*(f"skipped: {text}" for text in job.notes))
    done = reason is FinishReason.COMPLETED
    if done:
        _report_grooming(project)
    if done and arguments.figures:
        from homolog_app.pictures.figures import draw_figures

        with show_progress(arguments.progress) as progress:
            draw_figures(project, progress.tick)
    if done or arguments.progress == "json":
        _report_end(project, arguments.progress, reason)
    if not done:
        _report_cancelled(job)
    return OK if done else CANCELLED


def _check_structure(source: Path, pattern: str | None, cohort: Cohort, settings: GroomSettings) -> None:
    """Refuse files of several structures if none is chosen, in one message for all subjects."""
    if settings.label is not None or settings.segment is not None or settings.structures is not None:
        return
    from homolog.io.structures import structures_of_files

    if structures := structures_of_files(cohort):
        more = f" and {len(structures) - _LISTED} more" if len(structures) > _LISTED else ""
        listed = ", ".join(f"{item.name} ({len(item.by_subject)})" for item in structures[:_LISTED])
        name = quote(str(source)) + (f" --pattern {quote(pattern)}" if pattern else "")
        may_be_others = source.is_dir() and not pattern and len(structures) > len(cohort.subjects)
        others = as_options(proposals_text(source)) if may_be_others else ""
        raise InputError(
            f"{source}: contains one file per structure: {listed}{more} (number of files); choose "
            f"one: homolog run {name} --label {quote(structures[0].name)} …, several that are "
            f"modelled together: --structures {','.join(item.name for item in structures[:2])} …, or each by "
            f"itself: homolog batch {name} --labels all …{others}"
        )


@cache
def _start_drawing() -> None:
    """Import what draws while the result is computed and written, because it takes seconds."""

    def start() -> None:
        from homolog_app.pictures import figures  # noqa: F401

    Thread(target=start, name="homolog-drawing").start()


def _with_remedy(error: InputError, job: "Run", count: int) -> InputError:
    """Return an error about some of a cohort's files, extended by the option that skips them."""
    if not 0 < len(job.notes) < count - 1 or str(error) != job.refusal:
        return error
    return InputError(f"{error}\n{len(job.notes)} of {count} files can't be used; --skip-invalid skips them")


def _has_requested_result(
    arguments: argparse.Namespace, project: ProjectFolder, cohort: Cohort, settings: RunSettings
) -> bool:
    """Whether the project already has the requested result of a folder or table."""
    is_explicit = arguments.restart or arguments.resume or arguments.fit or project.folder == arguments.cohort
    if is_explicit or not project.exists:
        return False
    from homolog.run import is_result_of

    with show_progress(arguments.progress) as progress:
        return is_result_of(project, cohort, settings, progress.tick)


def _update_table(arguments: argparse.Namespace, project: ProjectFolder, cohort: Cohort) -> int:
    """Update groups and columns of the project that has the result; return the exit code."""
    from homolog.io.project_table import update_table

    with project.locked(new=False):
        changes = with_values_of(project.cohort().subjects, cohort.subjects, arguments.missing)
        if not changes.is_empty:
            update_table(project, changes.subjects)
    note("this project already has the result of these files and settings; --restart computes it again")
    note(*(f"table: {line}" for line in (() if changes.is_empty else changes.lines[1:])))
    _report_end(project, arguments.progress, "completed")
    return 0


def _report_end(project: ProjectFolder, mode: str, reason: str) -> None:
    """Print what the project has now, or why the run ended."""
    if mode == "json":
        write_lines(json.dumps({"reason": reason, "project": str(project.folder)}))
    else:
        write_lines(_summary(project), _verdict(project), f"results in {project.folder}")


def _report_grooming(project: ProjectFolder) -> None:
    """Print the notes of grooming."""
    result = project.read().result
    if result is None:
        return
    note(*(f"note: {remark}" for remark in filter(None, [result.mirrored_text, *result.remarks])))


def _report_cancelled(job: "Run") -> None:
    """After a cancelled run: keep its particles if there is no better result, and print how to continue."""
    project = job.project
    if not project.exists:
        write_lines("cancelled", aside=True)
        return
    if project.read().result is None and job.keep():
        write_lines("the particles placed so far are saved as a result", aside=True)
    write_lines(f"cancelled; to continue: homolog run {quote(str(project.folder))} --resume", aside=True)


def _summary(project: ProjectFolder) -> str:
    result = project.read().result
    assert result is not None, "a completed run has a result"
    folds = f"; {result.folded_faces} folded faces on the mean" if result.folded_faces else ""
    counts = [f"{item.particles} particles of {item.name}" for item in result.structures]
    size = f"{len(result.subjects)} subjects x {' + '.join(counts) or f'{result.particles} particles'}"
    return f"{size}, {result.end_text}{folds}"


def _verdict(project: ProjectFolder) -> str:
    from homolog.inspection.verdict import read_verdict
    from homolog.io.results import read_result

    return read_verdict(project, read_result(project).world).line


def _run_inputs(arguments: argparse.Namespace) -> tuple[ProjectFolder, Cohort, RunSettings]:
    source = ProjectFolder(arguments.cohort)
    if source.exists:
        project = ProjectFolder(arguments.out or arguments.cohort)
        record, cohort = source.read(), cohort_of(arguments)
        settings = record.settings
        if arguments.resume and not record.unfinished:
            raise InputError(f"{source.folder}: its last run has finished; there is nothing to resume")
    elif arguments.resume:
        raise InputError(f"{source.folder}: is not a project, so there is nothing to resume")
    elif arguments.fit:
        raise InputError(f"{source.folder}: is not a project with a result to which subjects can be fitted")
    elif arguments.out is None:
        raise InputError(
            f"name a folder for the results: homolog run {quote(str(arguments.cohort))} --out PROJECT"
        )
    else:
        project, settings = ProjectFolder(arguments.out), with_all_options(RunSettings(), arguments)
        cohort = read_with_notes(arguments)
    project.check_is_free()
    settings = with_all_options(settings, arguments)
    if arguments.fit:
        if arguments.resume or project.folder != source.folder:
            raise InputError("--fit changes the project itself; don't combine it with --out or --resume")
        cohort = _with_new(cohort, arguments.fit)
    return project, cohort, settings


def _with_new(cohort: Cohort, paths: Sequence[Path]) -> Cohort:
    """Return the cohort with the subjects of further files, folders or tables at its end.

    Subjects that it already has from a refused or interrupted fit are not added twice.
    """
    known = {(subject.name, subject.path.resolve()) for subject in cohort.subjects}
    structures = {name for subject in cohort.subjects for name in subject.structures}
    given = [item for path in paths for item in _subjects_of(path, structures)]
    new = [item for item in given if (item.name, item.path.resolve()) not in known]
    names = Counter(subject.name for subject in (*cohort.subjects, *new))
    repeated = [name for name, count in names.items() if count > 1]
    if repeated:
        raise InputError(f"several subjects are named {', '.join(repeated)}; rename the new files")
    return Cohort((*cohort.subjects, *new), cohort.folder)


def _subjects_of(path: Path, structures: Collection[str]) -> tuple[Subject, ...]:
    """Return the subjects of a file, table or folder; one with the result's structures is one subject."""
    if structures and path.is_dir() and not structures_in(path).keys().isdisjoint(structures):
        return (subject_at(path.resolve()),)
    if path.suffix.lower() in TABLE_SUFFIXES or (path.is_dir() and not is_series(path)):
        return read_cohort(path).subjects
    if not path.is_dir() and (not path.is_file() or suffix_of(path) not in IMAGE_SUFFIXES + MESH_SUFFIXES):
        raise InputError(f"{path}: is not a segmentation or mesh; correct the path")
    return (subject_at(path.resolve()),)


def _adds_particles(
    arguments: argparse.Namespace, project: ProjectFolder, cohort: Cohort, settings: RunSettings
) -> bool:
    """Whether the project's result has the same cohort and settings, but fewer particles.

    Prints what happens to an existing result.
    """
    if arguments.resume or not project.exists:
        return False
    from homolog.run import adds_particles, new_subjects

    result = project.read().result
    if result is None:
        return False
    if arguments.restart or not adds_particles(result, cohort, settings):
        note(
            f"this run will replace the result of {len(result.subjects)} subjects x "
            f"{result.particles} particles when it ends; cancel it to keep that result"
        )
        new = new_subjects(result, cohort, settings)
        if new and not arguments.restart:
            files = " ".join(quote(str(subject.path)) for subject in new[:_SHOWN_FILES])
            rest = " …" if len(new) > _SHOWN_FILES else ""
            note(
                f"to keep it and only add the {len(new)} new: homolog run "
                f"{quote(str(project.folder))} --fit {files}{rest}"
            )
        return False
    more = settings.optimize.particles - result.particles
    note(
        f"adding {more} particles to the {result.particles} of the result; --restart places all "
        "particles from the start"
    )
    return True


@contextmanager
def interrupt_cancels(cancel: Callable[[], None]) -> Iterator[None]:
    """Let the first Ctrl-C or SIGTERM cancel cleanly and a second one abort."""

    def handle(number: int, frame: object) -> None:
        signal.signal(number, signal.default_int_handler)
        cancel()

    with handling(signal.SIGINT, handle), handling(signal.SIGTERM, handle):
        yield


@command(
    "Process subjects for a Dask scheduler until the scheduler ends or Ctrl-C is pressed. "
    "Start one worker per core, on any machine with the same file paths, and use homolog run --cluster.",
    option("address", help="address of the scheduler, such as tcp://node1:8786"),
)
def run_worker(arguments: argparse.Namespace) -> int:
    """Run the worker; return the exit code."""
    from homolog.cluster import serve_as_worker

    write_lines(f"working for {arguments.address}; press Ctrl-C to stop", aside=True)
    serve_as_worker(arguments.address)
    return 0
