"""Single patients: ``homolog reference``, ``patient`` and ``export patient``."""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from homolog.errors import InputError
from homolog.io.project import ProjectFolder
from homolog_app.cli.options import (
    ANYWAY,
    PROGRESS,
    PROJECT,
    command,
    note,
    option,
    show_progress,
    write_lines,
)

if TYPE_CHECKING:
    from homolog_app.report.patient import PatientRequest

__all__ = ["run_patient", "run_patient_report", "run_reference"]


@command(
    "Freeze the model of a finished project's controls in one file, for homolog patient. "
    "Each control is fitted as a patient to the model of the others, so that limits and percentiles "
    "hold for new subjects. The file contains no surfaces, particles or files of the controls.",
    PROJECT,
    option("--group", metavar="VALUE", help="group of the controls (default: all subjects)"),
    option("--column", default="group", help="column of the cohort's table for --group (default group)"),
    option(
        "--adjust", nargs="+", metavar="COLUMN", default=[], help="covariates to adjust for, such as age sex"
    ),
    option(
        "--pairs",
        metavar="COLUMN",
        help="column that identifies the person, if controls were scanned twice; gives the expected change",
    ),
    option(
        "--time", metavar="COLUMN", default="time", help="column that orders a person's times (default time)"
    ),
    option(
        "--out",
        type=Path,
        required=True,
        metavar="FILE",
        help="reference to write (.npz); replaced if it exists",
    ),
    option(
        "--scores",
        action="store_true",
        help="store each control's scores, so that reports give the distances of the nearest controls",
    ),
    option("--names", action="store_true", help="store scores and names of the controls"),
    option("--workers", type=int, help="number of processes (default: one per core)"),
    ANYWAY,
    PROGRESS,
)
def run_reference(arguments: argparse.Namespace) -> int:
    """Make the reference; return the exit code."""
    from homolog.inspection.verdict import refuse_unusable
    from homolog.io.results import read_result
    from homolog.patient import make_reference
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
    write_lines(*reference_text(reference), str(arguments.out))
    return 0


_OF_PATIENT = (
    option("--age", help="age of the patient, if the reference is adjusted for a column age"),
    option("--sex", help="sex of the patient, if the reference is adjusted for it; f is enough for female"),
    option(
        "--value",
        action="append",
        default=[],
        metavar="COLUMN=VALUE",
        help="any other covariate of the reference",
    ),
    option(
        "--side",
        choices=["left", "right"],
        help="side of the body; mirrored if the controls are of the other side",
    ),
    option("--label", help="label value or name of the structure, if it differs from the controls'"),
    option(
        "--cut-off",
        action="store_true",
        help="the segmentation itself is cut off at flat ends, as at the border of an image; the missing "
        "part does not count as a difference",
    ),
    option("--force", action="store_true", help="compare even an apparently different structure or side"),
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


def _request(arguments: argparse.Namespace, *files: Path) -> "PatientRequest":
    from homolog_app.report.patient import PatientRequest

    return PatientRequest(
        files,
        given_covariates(arguments),
        arguments.side or "",
        arguments.label,
        arguments.force,
        cut_off=arguments.cut_off,
    )


@command(
    "Compare patients with a reference made by homolog reference. Writes a report (HTML, "
    "PDF), tables and surfaces for each, and one table of all. For research use only; not for diagnosis.",
    option("reference", type=Path, help="file that homolog reference wrote"),
    option(
        "files",
        type=Path,
        nargs="+",
        metavar="FILE",
        help="segmentations, meshes, a folder of them or a cohort.csv; of several structures a label map, or "
        "a folder with a file for each",
    ),
    option("--out", type=Path, required=True, metavar="FOLDER", help="a new or empty folder"),
    option(
        "--against",
        type=Path,
        nargs="+",
        default=[],
        metavar="REFERENCE",
        help="references of further groups: how typical the patient is of each (not a diagnosis)",
    ),
    option(
        "--follow-up",
        action="store_true",
        help="the files are one patient at several times, in order; write maps of change",
    ),
    option(
        "--repeat",
        type=Path,
        nargs="+",
        default=[],
        metavar="FILE",
        help="further segmentations of the first time, for the measurement error (preferably three or more)",
    ),
    *_OF_PATIENT,
    PROGRESS,
)
def run_patient(arguments: argparse.Namespace) -> int:
    """Compare; return the exit code."""
    from homolog.io.atomic import replace_folder
    from homolog.patient import read_reference
    from homolog_app.report.patient import write_patients

    if arguments.repeat and not arguments.follow_up:
        raise InputError("--repeat: gives the measurement error of a follow-up; add --follow-up")
    reference = read_reference(arguments.reference)
    request = replace(
        _request(arguments, *arguments.files),
        against=tuple(arguments.against),
        follow_up=arguments.follow_up,
        repeats=tuple(arguments.repeat),
    )
    with (
        show_progress(arguments.progress) as progress,
        replace_folder(arguments.out) as folder,
    ):
        summary = write_patients(folder, reference, request, progress.tick)
    note(*summary.problems)
    write_lines(*summary.lines, str(arguments.out))
    return 2 if summary.problems else 0


@command(
    "Compare a patient with a reference made by homolog reference and write only the "
    "report, as PDF or one HTML page. homolog patient also writes tables and surfaces.",
    option("reference", type=Path, help="file that homolog reference wrote"),
    option("file", type=Path, help="segmentation or mesh of the patient, or folder of several structures"),
    option(
        "--out", type=Path, required=True, metavar="FILE", help="FILE (.pdf or .html); replaced if it exists"
    ),
    *_OF_PATIENT,
    PROGRESS,
)
def run_patient_report(arguments: argparse.Namespace) -> int:
    """Write the report; return the exit code."""
    from homolog.patient import read_reference
    from homolog_app.report.patient import write_report_file
    from homolog_app.report.sheets import check_page_name

    check_page_name(arguments.out)
    reference = read_reference(arguments.reference)
    with show_progress(arguments.progress) as progress:
        finding = write_report_file(
            arguments.out, reference, _request(arguments, arguments.file), progress.tick
        )
    write_lines(finding, str(arguments.out), aside=True)
    return 0
