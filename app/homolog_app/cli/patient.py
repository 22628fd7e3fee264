"""Single patients: ``homolog reference``, ``patient`` and ``export patient``."""

import argparse
import sys
from pathlib import Path
from typing import Any

from homolog.errors import InputError
from homolog.io.project import ProjectFolder
from homolog.progress import Tick
from homolog_app.cli.options import add_anyway_option, add_progress_option, show_progress

__all__ = [
    "add_patient",
    "add_patient_report",
    "add_reference",
    "run_patient",
    "run_reference",
    "write_patient_report",
]


def add_reference(subparsers: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the command."""
    parser = subparsers.add_parser(
        "reference",
        help="freeze a project's controls as a reference for single patients",
        description="Freeze the model of a finished project's controls in one file, for homolog patient. "
        "Each control is fitted as a patient to the model of the others, so that limits and percentiles "
        "hold for new subjects. The file contains no surfaces, particles or files of the controls.",
    )
    parser.add_argument("project", type=Path, help="project folder")
    parser.add_argument("--group", metavar="VALUE", help="group of the controls (default: all subjects)")
    parser.add_argument(
        "--column", default="group", help="column of the cohort's table for --group (default group)"
    )
    parser.add_argument(
        "--adjust", nargs="+", metavar="COLUMN", default=[], help="covariates to adjust for, such as age sex"
    )
    parser.add_argument(
        "--pairs",
        metavar="COLUMN",
        help="column that identifies the person, if controls were scanned twice; gives the expected change",
    )
    parser.add_argument(
        "--time", metavar="COLUMN", default="time", help="column that orders a person's times (default time)"
    )
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="FILE",
        help="reference to write (.npz); replaced if it exists",
    )
    parser.add_argument(
        "--scores",
        action="store_true",
        help="store each control's scores, so that reports give the distances of the nearest controls",
    )
    parser.add_argument("--names", action="store_true", help="store scores and names of the controls")
    parser.add_argument("--workers", type=int, help="number of processes (default: one per core)")
    add_anyway_option(parser)
    add_progress_option(parser)


def run_reference(arguments: argparse.Namespace) -> int:
    """Make the reference; return the exit code."""
    from homolog.inspection.verdict import refuse_unusable
    from homolog.io.results import read_result
    from homolog.patient.build import make_reference
    from homolog.patient.findings import reference_text
    from homolog.patient.reference import check_name

    check_name(arguments.out)
    project = ProjectFolder(arguments.project)
    with show_progress(arguments.progress) as progress:
        if not arguments.anyway:
            refuse_unusable(project, read_result(project).world)
        reference = make_reference(
            project,
            group=arguments.group,
            column=arguments.column,
            adjust=arguments.adjust,
            pairs=arguments.pairs,
            time=arguments.time,
            scores=arguments.scores,
            names=arguments.names,
            workers=arguments.workers,
            tick=progress.tick,
        )
        reference.save(arguments.out)
    sys.stdout.write("".join(f"{line}\n" for line in [*reference_text(reference), str(arguments.out)]))
    return 0


def add_patient(subparsers: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the command."""
    parser = subparsers.add_parser(
        "patient",
        help="compare a patient's shape with a reference: how unusual, and where",
        description="Compare patients with a reference made by homolog reference. Writes a report (HTML, "
        "PDF), tables and surfaces for each, and one table of all. For research use only; not for diagnosis.",
    )
    parser.add_argument("reference", type=Path, help="file that homolog reference wrote")
    parser.add_argument(
        "files",
        type=Path,
        nargs="+",
        metavar="FILE",
        help="segmentations, meshes, a folder of them or a cohort.csv",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="FOLDER", help="a new or empty folder")
    parser.add_argument(
        "--against",
        type=Path,
        nargs="+",
        default=[],
        metavar="REFERENCE",
        help="references of further groups: how typical the patient is of each (not a diagnosis)",
    )
    parser.add_argument(
        "--follow-up",
        action="store_true",
        help="the files are one patient at several times, in order; write maps of change",
    )
    parser.add_argument(
        "--repeat",
        type=Path,
        nargs="+",
        default=[],
        metavar="FILE",
        help="further segmentations of the first time, for the measurement error (preferably three or more)",
    )
    add_patient_options(parser)
    add_progress_option(parser)


def add_patient_options(parser: argparse.ArgumentParser) -> None:
    """Declare covariates, side and label of a patient."""
    parser.add_argument("--age", help="age of the patient, if the reference is adjusted for a column age")
    parser.add_argument(
        "--sex", help="sex of the patient, if the reference is adjusted for it; f is enough for female"
    )
    parser.add_argument(
        "--value",
        action="append",
        default=[],
        metavar="COLUMN=VALUE",
        help="any other covariate of the reference",
    )
    parser.add_argument(
        "--side",
        choices=["left", "right"],
        help="side of the body; mirrored if the controls are of the other side",
    )
    parser.add_argument(
        "--label", help="label value or name of the structure, if it differs from the controls'"
    )
    parser.add_argument(
        "--cut-off",
        action="store_true",
        help="the segmentation itself is cut off at flat ends, as at the border of an image; the missing "
        "part does not count as a difference",
    )
    parser.add_argument(
        "--force", action="store_true", help="compare even an apparently different structure or side"
    )


def given_covariates(arguments: argparse.Namespace) -> dict[str, str]:
    """Return the covariates on the command line, by column."""
    given = {name: value for name in ("age", "sex") if (value := getattr(arguments, name)) is not None}
    for item in arguments.value:
        name, sign, value = item.partition("=")
        if not (sign and name and value):
            raise InputError(f"--value {item}: must be COLUMN=VALUE")
        given[name] = value
    return given


def run_patient(arguments: argparse.Namespace) -> int:
    """Compare; return the exit code."""
    from homolog.io.atomic import replace_folder
    from homolog.patient.reference import Reference
    from homolog_app.report.patient import PatientRequest, write_patients

    if arguments.repeat and not arguments.follow_up:
        raise InputError("--repeat: gives the measurement error of a follow-up; add --follow-up")
    reference = Reference.load(arguments.reference)
    request = PatientRequest(
        tuple(arguments.files),
        given_covariates(arguments),
        arguments.side or "",
        arguments.label,
        arguments.force,
        tuple(arguments.against),
        arguments.follow_up,
        tuple(arguments.repeat),
        arguments.cut_off,
    )
    with (
        show_progress(arguments.progress) as progress,
        replace_folder(arguments.out) as folder,
    ):
        summary = write_patients(folder, reference, request, progress.tick)
    sys.stdout.write("".join(f"{line}\n" for line in summary.lines))
    for line in summary.problems:
        sys.stderr.write(f"homolog: {line}\n")
    sys.stdout.write(f"{arguments.out}\n")
    return 2 if summary.problems else 0


_SUFFIXES = (".pdf", ".html")


def add_patient_report(kinds: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the kind."""
    parser = kinds.add_parser(
        "patient",
        help="report of one patient against a reference as PDF or HTML",
        description="Compare a patient with a reference made by homolog reference and write only the "
        "report, as PDF or one HTML page. homolog patient also writes tables and surfaces.",
    )
    parser.add_argument("reference", type=Path, help="file that homolog reference wrote")
    parser.add_argument("file", type=Path, help="segmentation or mesh of the patient")
    parser.add_argument(
        "--out", type=Path, required=True, metavar="FILE", help="FILE (.pdf or .html); replaced if it exists"
    )
    add_patient_options(parser)
    add_progress_option(parser)


def write_patient_report(arguments: argparse.Namespace, tick: Tick) -> str:
    """Write the report; return the findings."""
    if arguments.out.suffix.lower() not in _SUFFIXES:
        raise InputError(f"{arguments.out}: the report is written as .pdf or .html; choose such a name")
    from homolog.patient.reference import Reference
    from homolog_app.report.patient import PatientRequest, write_report_file

    request = PatientRequest(
        (arguments.file,),
        given_covariates(arguments),
        arguments.side or "",
        arguments.label,
        arguments.force,
        cut_off=arguments.cut_off,
    )
    return write_report_file(arguments.out, Reference.load(arguments.reference), request, tick)
