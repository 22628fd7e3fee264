"""Patients' reports, tables and surfaces on disk."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from homolog.arrays import Array
from homolog.cohort import Subject
from homolog.errors import InputError, NumericalError
from homolog.geometry import inverse_matrices
from homolog.io.atomic import write_text
from homolog.io.meshes import write_mesh
from homolog.io.names import file_stems
from homolog.io.particles import write_particles
from homolog.io.tables import write_table
from homolog.patient import (
    FollowUp,
    JointComparison,
    JointReference,
    PatientComparison,
    PatientPose,
    Reference,
    compare_joint_patient,
    compare_patient,
    compare_times,
)
from homolog.patient.files import patient_at, patients_of, with_label
from homolog.patient.findings import (
    GROUP_CAUTION,
    GROUP_COLUMNS,
    GroupRow,
    finding,
    findings,
    group_rows,
    group_sentence,
    joint_finding,
    measure_rows,
    nearest_controls_text,
    pairs_of,
    pose_rows,
    reference_rows,
    region_rows,
    visible_rows,
    who_text,
)
from homolog.progress import Tick, no_tick, part_of
from homolog_app.plots import percentile_rows, pose_percentile_rows
from homolog_app.report import NOTICE
from homolog_app.report.figures import ReportFigure
from homolog_app.report.follow_up import check_times, write_follow_up
from homolog_app.report.page import Page
from homolog_app.report.patient_figures import maps_figure, percentiles_figure, wall_figure
from homolog_app.report.sheets import write_page
from homolog_app.report.texts import caption, template_text

__all__ = [
    "PatientRequest",
    "PatientSummary",
    "patient_page",
    "write_joint_patient",
    "write_patient",
    "write_patients",
    "write_report_file",
    "write_times",
]

_SUMMARY = (
    "name",
    "flagged",
    "regions",
    "region_area_mm2",
    "largest_z",
    "limit",
    "largest_z_percentile",
    "largest_z_p",
    "mahalanobis",
    "mahalanobis_percentile",
    "mahalanobis_p",
    "outside_mm",
    "outside_percentile",
    "outside_p",
    "size_ratio",
    "size_percentile",
    "size_p",
    "nearest_controls",
    "remarks",
    "error",
)
_REGIONS = ("region", "area (mm²)", "mean (mm)", "peak (mm)", "wall (%)", "z at peak", "place", "particles")
_NUMBERS = ("", "value", "percentile of controls (95 % interval)", "p")
_POSES = (
    "structure",
    "against",
    "turn_degrees",
    *(f"turn_{axis}_degrees" for axis in "xyz"),
    "turn_sd",
    "turn_percentile",
    "turn_p",
    "shift_mm",
    *(f"shift_{axis}_mm" for axis in "xyz"),
    "shift_sd",
    "shift_percentile",
    "shift_p",
)


@dataclass(frozen=True, slots=True)
class PatientRequest:
    """Patients to be compared, with options.

    Attributes
    ----------
    files : tuple of Path
        Segmentations, meshes, DICOM series, folders of those, or tables.
    covariates : mapping of str to str
        Covariates of all patients, unless a table has another value.
    side : str
        ``"left"``, ``"right"``, or empty if it is not given.
    label : str or None
        Value or name of the structure, if it differs from that of the controls.
    force : bool
        Compare files even if they appear to be of another structure or side.
    against : tuple of Path
        References of further groups.
    follow_up : bool
        Whether the files are one patient at several times, the first time first.
    repeats : tuple of Path
        Further segmentations of the first time, for the measurement error of a follow-up.
    cut_off : bool
        Whether files are cut off at flat ends inside their images.
    """

    files: tuple[Path, ...]
    covariates: Mapping[str, str]
    side: str = ""
    label: str | None = None
    force: bool = False
    against: tuple[Path, ...] = ()
    follow_up: bool = False
    repeats: tuple[Path, ...] = ()
    cut_off: bool = False


@dataclass(frozen=True, slots=True)
class PatientSummary:
    """Results: one line per patient, and one per file that could not be compared."""

    lines: tuple[str, ...]
    problems: tuple[str, ...]


def write_patients(
    folder: Path, reference: Reference | JointReference, request: PatientRequest, tick: Tick = no_tick
) -> PatientSummary:
    """Compare patients and write their reports; several patients have a folder each and one table.

    Parameters
    ----------
    folder : Path
        Existing empty folder.
    reference : Reference
    request : PatientRequest
    tick : Tick

    Returns
    -------
    PatientSummary

    Raises
    ------
    InputError
        If no patient can be compared, or the folder can't be written to.
    """
    if isinstance(reference, JointReference):
        return _write_joint_patients(folder, reference, request, tick)
    subjects = patients_of(request.files)
    reference = with_label(reference, request.label)
    if request.follow_up:
        check_times(subjects, request.repeats)
    others = [with_label(Reference.load(path), request.label) for path in request.against]
    times: list[PatientComparison] = []
    whole, tick = tick, part_of(tick, 0.0, 0.7) if request.follow_up else tick
    stems = file_stems([subject.name for subject in subjects])
    rows: list[list[str | float | int | None]] = []
    lines: list[str] = []
    problems: list[str] = []
    for index, (subject, stem) in enumerate(zip(subjects, stems, strict=True)):
        part_tick = part_of(tick, index / len(subjects), (index + 1) / len(subjects))
        try:
            comparison = _compared(reference, subject, request, part_of(part_tick, 0.0, 0.7))
        except (InputError, NumericalError) as error:
            if len(subjects) == 1 or request.follow_up:
                raise
            problems.append(str(error))
            rows.append([subject.name, *[None] * (len(_SUMMARY) - 2), str(error)])
            continue
        own = folder if len(subjects) == 1 else folder / stem
        compare = partial(_compared, subject=subject, request=request, tick=part_of(part_tick, 0.7, 0.8))
        groups = group_rows(comparison, reference, others, compare)
        write_patient(own, comparison, reference, part_of(part_tick, 0.8, 1.0), groups)
        lines += [f"{subject.name}: {group_sentence(row)}" for row in groups]
        times.append(comparison)
        rows.append([*_summary(comparison, reference), None])
        lines.append(f"{subject.name}: {finding(comparison, reference)}")
        lines += [f"{subject.name}: {remark}" for remark in comparison.remarks]
    if not lines:
        raise InputError("\n".join(problems))
    write_table(folder / "patients.csv", _SUMMARY, rows)
    if request.follow_up:
        again = [
            _compared(reference, item, request, part_of(whole, 0.7, 0.8))
            for path in request.repeats
            for item in patients_of([path])
        ]
        follow_up = compare_times(times, again, part_of(whole, 0.8, 0.95), expected=reference.change)
        lines += write_follow_up(folder, follow_up, reference, part_of(whole, 0.95, 1.0))
    return PatientSummary(tuple(lines), tuple(problems))


def _write_joint_patients(
    folder: Path, reference: JointReference, request: PatientRequest, tick: Tick
) -> PatientSummary:
    """Compare patients with several structures; as `write_patients`, with a row of the table a structure."""
    _check_joint(request)
    subjects = patients_of(request.files, reference.files)
    stems = file_stems([subject.name for subject in subjects])
    rows: list[list[str | float | int | None]] = []
    lines: list[str] = []
    problems: list[str] = []
    for index, (subject, stem) in enumerate(zip(subjects, stems, strict=True)):
        part_tick = part_of(tick, index / len(subjects), (index + 1) / len(subjects))
        try:
            comparison = _compared_jointly(reference, subject, request, part_of(part_tick, 0.0, 0.7))
        except (InputError, NumericalError) as error:
            if len(subjects) == 1:
                raise
            problems += [f"{subject.name}: {line}" for line in str(error).splitlines()]
            rows.append([subject.name, *[None] * (len(_SUMMARY) - 1), str(error)])
            continue
        own = folder if len(subjects) == 1 else folder / stem
        write_joint_patient(own, comparison, reference, part_of(part_tick, 0.7, 1.0))
        for name, alone in comparison.structures.items():
            values = _summary(alone, reference.structures[name])
            rows.append([values[0], name, *values[1:], None])
        rows += [
            [subject.name, name, *[None] * (len(_SUMMARY) - 2), text]
            for name, text in comparison.problems.items()
        ]
        problems += [f"{subject.name}: {name}: {text}" for name, text in comparison.problems.items()]
        lines += [f"{subject.name}: {text}" for text in joint_finding(comparison, reference)]
        alike = pairs_of(comparison, reference)
        for cautions in (False, True):
            lines += [f"{subject.name}: {text}" for text in _remarks(alike, cautions=cautions)]
    if not lines:
        raise InputError("\n".join(problems))
    write_table(folder / "patients.csv", [_SUMMARY[0], "structure", *_SUMMARY[1:]], rows)
    return PatientSummary(tuple(lines), tuple(problems))


def _check_joint(request: PatientRequest) -> None:
    """Refuse what is for references of a single structure; raises InputError."""
    given = {
        "--label": request.label is not None,
        "--against": bool(request.against),
        "--follow-up": request.follow_up,
    }
    if unusable := [name for name, is_given in given.items() if is_given]:
        raise InputError(
            f"{', '.join(unusable)}: needs a reference of one structure; make it of its project "
            "(PROJECT/structures/NAME)"
        )


def _compared_jointly(
    reference: JointReference, subject: Subject, request: PatientRequest, tick: Tick
) -> JointComparison:
    values = _values(subject, request)
    side, cut_off, force = request.side, request.cut_off, request.force
    return compare_joint_patient(
        reference, subject, values, side=side, cut_off=cut_off, force=force, tick=tick
    )


def write_joint_patient(
    folder: Path, comparison: JointComparison, reference: JointReference, tick: Tick = no_tick
) -> None:
    """Write the report of a patient with several structures, tables, and surfaces in a folder a structure.

    Raises
    ------
    InputError
        If the folder can't be written to.
    """
    tick(0.0, "drawing the maps")
    page = patient_page(comparison, reference)
    tick(0.5, "writing the report")
    write_text(folder / "report.html", page.html)
    write_page(folder / "report.pdf", page)
    tick(0.8, "writing tables and surfaces")
    stems = file_stems(list(comparison.structures))
    for stem, (name, alone) in zip(stems, comparison.structures.items(), strict=True):
        _write_data(folder / stem, alone, reference.structures[name])
    write_table(folder / "pose.csv", _POSES, (_pose_row(pose) for pose in comparison.poses))


def _pose_row(pose: PatientPose) -> list[str | float]:
    row: list[str | float] = [pose.structure, pose.against]
    for size, vector, rank in (
        (pose.angle, pose.rotation, pose.turn),
        (pose.distance, pose.translation, pose.shift),
    ):
        row += [size, *vector.tolist(), rank.value, rank.percent, rank.p]
    return row


def write_report_file(
    path: Path, reference: Reference | JointReference, request: PatientRequest, tick: Tick = no_tick
) -> str:
    """Compare one patient and write only the report, as PDF or HTML; return the findings.

    Raises
    ------
    InputError
        If the files are not those of one patient, the patient can't be compared, or the report can't be
                written.
    """
    comparison: PatientComparison | JointComparison
    if isinstance(reference, JointReference):
        _check_joint(request)
        subject = patient_at(request.files[0], reference.files)
        comparison = _compared_jointly(reference, subject, request, part_of(tick, 0.0, 0.7))
    else:
        subject, reference = patient_at(request.files[0]), with_label(reference, request.label)
        comparison = _compared(reference, subject, request, part_of(tick, 0.0, 0.7))
    page = patient_page(comparison, reference)
    tick(0.9, "writing the report")
    write_page(path, page)
    return "\n".join(findings(comparison, reference))


def _values(subject: Subject, request: PatientRequest) -> dict[str, str]:
    """Return a patient's covariates; values of a table take precedence over those for all patients."""
    return {**request.covariates, **{key: item for key, item in subject.columns.items() if item}}


def _compared(
    reference: Reference, subject: Subject, request: PatientRequest, tick: Tick
) -> PatientComparison:
    """Compare a patient with a single structure."""
    values = _values(subject, request)
    side, cut_off, force = request.side, request.cut_off, request.force
    return compare_patient(reference, subject, values, side=side, cut_off=cut_off, force=force, tick=tick)


def write_patient(
    folder: Path,
    comparison: PatientComparison,
    reference: Reference,
    tick: Tick = no_tick,
    groups: Sequence[GroupRow] = (),
) -> None:
    """Write a patient's report (``report.html``, ``report.pdf``), tables and surfaces.

    Parameters
    ----------
    folder : Path
        Created if necessary.
    comparison : PatientComparison
    reference : Reference
        Reference of the comparison.
    tick : Tick
    groups : sequence of GroupRow
        Typicality for several groups; empty if there is one reference only.

    Raises
    ------
    InputError
        If the folder can't be written to.
    """
    tick(0.0, "drawing the maps")
    page = patient_page(comparison, reference, groups)
    tick(0.5, "writing the report")
    write_text(folder / "report.html", page.html)
    write_page(folder / "report.pdf", page)
    if groups:
        write_table(folder / "groups.csv", GROUP_COLUMNS, groups)
    tick(0.8, "writing tables and surfaces")
    _write_data(folder, comparison, reference)


def _write_data(folder: Path, comparison: PatientComparison, reference: Reference) -> None:
    """Write the regions, the maps on the expected and the own surface, and the particles."""
    write_table(
        folder / "regions.csv",
        [
            "region",
            "area_mm2",
            "mean_mm",
            "peak_mm",
            "peak_wall",
            "peak_z",
            "x_mm",
            "y_mm",
            "z_mm",
            "place",
            "missing_share",
        ],
        (
            [
                number,
                region.area,
                region.mean,
                region.peak,
                region.thicker,
                region.z,
                *comparison.position(region).tolist(),
                comparison.place(region),
                region.missing,
            ]
            for number, region in enumerate(comparison.regions, start=1)
        ),
    )
    back = inverse_matrices(comparison.placement)
    numbers = np.zeros(len(comparison.z), dtype=np.int32)
    for number, region in enumerate(comparison.regions, start=1):
        numbers[region.vertices] = number
    values: dict[str, Array] = {
        "difference_mm": comparison.residual,
        "z": comparison.z,
        "region": numbers,
        "difference_from_mean_mm": comparison.total,
        "z_from_mean": comparison.total_z,
        "detectable_mm": reference.detectable[0],
        "wall_difference": comparison.thicker,
        "cut_off": comparison.missing.astype(np.int32),
    }
    write_mesh(folder / "map.vtp", comparison.expected.placed(back), values)
    vertices = len(comparison.mesh.vertices)
    mapped = ("difference_mm", "wall_difference", "z", "difference_from_mean_mm", "z_from_mean")
    carried = {name: comparison.own.carried(values[name])[:vertices] for name in mapped}
    write_mesh(folder / "patient.vtp", comparison.mesh, carried)
    write_particles(folder / "patient_local.particles", comparison.particles)


def patient_page(
    comparison: PatientComparison | JointComparison,
    reference: Reference | JointReference,
    groups: Sequence[GroupRow] = (),
) -> Page:
    """Return a patient's report, of one or several structures."""
    alone = pairs_of(comparison, reference)
    figures: dict[str, list[ReportFigure]] = {}
    tables: dict[str, Mapping[str, Any]] = {}
    items = []
    for name, (own, against) in alone.items():
        items.append(
            {
                "title": name,
                "key": name and f"_{name}",
                "regions": own.regions,
                "nearest": nearest_controls_text(own, against),
            }
        )
        key = items[-1]["key"]
        maps = caption("patient", is_cut_off=bool(own.missing.any()))
        bars = percentiles_figure(percentile_rows(own, against))
        figures |= {
            f"maps{key}": [
                ReportFigure(f"maps{key}", maps_figure(own), maps),
                ReportFigure(f"wall{key}", wall_figure(own), caption("wall")),
            ],
            f"percentiles{key}": [ReportFigure(f"percentiles{key}", bars, caption("percentiles"))],
        }
        visible = visible_rows(against)
        tables |= {
            f"regions{key}": {"columns": _REGIONS, "rows": region_rows(own, against)},
            f"visible{key}": {"columns": visible[0], "rows": visible[1:]},
            f"numbers{key}": {"columns": _NUMBERS, "rows": measure_rows(own, against)},
            f"reference{key}": {"columns": (name, "value"), "rows": reference_rows(against)},
        }
    if isinstance(comparison, JointComparison) and isinstance(reference, JointReference):
        tables["poses"] = {"columns": _NUMBERS, "rows": pose_rows(comparison)}
        if ranks := pose_percentile_rows(comparison, reference):
            figures["poses"] = [ReportFigure("poses", percentiles_figure(ranks), caption("percentiles"))]
    first, about = next(iter(alone.values()))
    context = {
        "who": who_text(first, about),
        "findings": findings(comparison, reference),
        "cautions": _remarks(alone, cautions=True),
        "remarks": _remarks(alone, cautions=False),
        "items": items,
        "poses": isinstance(comparison, JointComparison),
        "groups": [group_sentence(row) for row in groups],
        "group_caution": GROUP_CAUTION,
    }
    page = Page(f"Shape of {comparison.name} against a reference", NOTICE, footer=NOTICE)
    page.write(template_text("patient_text.jinja", context), figures, tables)
    return page


def _remarks(alone: Mapping[str, tuple[PatientComparison, Reference]], *, cautions: bool) -> list[str]:
    """Return the cautions or the other remarks on each structure."""
    return [
        f"{name}: {text}" if name else text
        for name, (own, _) in alone.items()
        for text in own.remarks
        if (text in own.cautions) is cautions
    ]


def _summary(comparison: PatientComparison, reference: Reference) -> list[str | float | int | None]:
    numbers: list[str | float | int | None] = [
        comparison.name,
        int(bool(comparison.regions)),
        len(comparison.regions),
        sum(region.area for region in comparison.regions),
        comparison.local.value,
        reference.limit,
        comparison.local.percent,
        comparison.local.p,
    ]
    for item in (comparison.mahalanobis, comparison.outside, comparison.size):
        numbers += [item.value, item.percent, item.p]
    nearest = "; ".join(
        f"{name} {apart:.2f}".strip() for name, apart in reference.nearest(comparison.fit.scores)
    )
    return [*numbers, nearest, "; ".join(comparison.remarks)]


def write_times(
    folder: Path,
    follow_up: FollowUp,
    reference: Reference,
    tick: Tick = no_tick,
    groups: Sequence[GroupRow] = (),
) -> None:
    """Write the results of a patient at several times: a folder for each time, and the report of the change.

    Parameters
    ----------
    folder : Path
        Existing folder.
    follow_up, reference, tick
    groups : sequence of GroupRow
        Typicality of the first time for several groups.
    """
    times = follow_up.comparisons
    stems = file_stems([item.name for item in times])
    for number, (item, stem) in enumerate(zip(times, stems, strict=True)):
        part_tick = part_of(tick, 0.8 * number / len(times), 0.8 * (number + 1) / len(times))
        write_patient(folder / stem, item, reference, part_tick, () if number else groups)
    write_follow_up(folder, follow_up, reference, part_of(tick, 0.8, 1.0))
