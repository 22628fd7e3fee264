"""Report of one patient at several times: page, tables and the surface with its changes."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from homolog.arrays import Array, FloatArray
from homolog.cohort import Subject
from homolog.errors import InputError
from homolog.geometry import inverse_matrices, transform_points
from homolog.io.atomic import write_text
from homolog.io.meshes import write_mesh
from homolog.io.tables import write_table
from homolog.patient import Change, FollowUp, Reference
from homolog.patient.findings import (
    beyond_limit,
    change_sentences,
    limit_text,
    reference_rows,
    times_text,
)
from homolog.progress import Tick, no_tick
from homolog_app.report import NOTICE
from homolog_app.report.figures import ReportFigure
from homolog_app.report.page import Page
from homolog_app.report.patient_figures import change_figure
from homolog_app.report.sheets import write_page
from homolog_app.report.texts import caption, template_text

__all__ = ["check_times", "follow_up_page", "write_follow_up"]

_COLUMNS = ("time", "volume (%)", "mean (mm)", "rms (mm)", "outward (mm)", "inward (mm)", "beyond (mm²)")
_UNSIGNED = ("rms (mm)", "beyond (mm²)")


def check_times(subjects: Sequence[Subject], repeats: Sequence[Path]) -> None:
    """Raise InputError if a follow-up has too few times or a repeat is missing."""
    if len(subjects) < 2:
        raise InputError("--follow-up: needs at least two files; give the first time first")
    for path in repeats:
        if not path.exists():
            raise InputError(f"{path}: does not exist; correct the path")


def write_follow_up(
    folder: Path, follow_up: FollowUp, reference: Reference, tick: Tick = no_tick
) -> list[str]:
    """Write ``follow_up.html`` and ``.pdf``, ``changes.csv``, ``change_regions.csv`` and ``changes.vtp``.

    Parameters
    ----------
    folder : Path
        Exists.
    follow_up : FollowUp
    reference : Reference
        Reference for all times.
    tick : Tick

    Returns
    -------
    list of str
        Findings, one line for each time.

    Raises
    ------
    InputError
        If a file can't be written.
    """
    tick(0.0, "drawing the maps")
    first = follow_up.comparisons[0]
    own = follow_up.surface.placed(inverse_matrices(first.placement))
    page = follow_up_page(follow_up, reference)
    write_text(folder / "follow_up.html", page.html)
    write_page(folder / "follow_up.pdf", page)
    _write_tables(folder, follow_up, first.placement)
    values: dict[str, Array] = {}
    for number, change in enumerate(follow_up.changes, start=2):
        values[f"change_mm_{number}"] = change.distance
        if change.z is not None:
            values[f"z_{number}"] = change.z
        if change.expected is not None:
            values[f"expected_z_{number}"] = change.expected.z
    if follow_up.error is not None:
        values["measurement_error_mm"] = follow_up.error
    write_mesh(folder / "changes.vtp", own, values)
    return change_sentences(follow_up)


def _write_tables(folder: Path, follow_up: FollowUp, placement: FloatArray) -> None:
    """Write the numbers of each time, and the regions in the frame of the first time's file."""
    areas = follow_up.surface.vertex_areas
    columns = [
        "time",
        "since",
        "volume_percent",
        "mean_mm",
        "rms_mm",
        "outward_mm",
        "inward_mm",
        "beyond_mm2",
        "largest_z",
        "limit",
        "repeats",
        "controls_twice",
        "beyond_expected_rms_mm",
        "beyond_expected_percentile",
        "volume_percentile",
        "expected_largest_z",
        "expected_limit",
        "expected_regions",
    ]
    rows = [
        [
            change.name,
            follow_up.comparisons[0].name,
            *_numbers(change, areas),
            None if change.z is None else float(np.abs(change.z).max()),
            follow_up.limit,
            follow_up.repeats,
            *_expected_numbers(change, follow_up),
        ]
        for change in follow_up.changes
    ]
    write_table(folder / "changes.csv", columns, rows)
    back = inverse_matrices(placement)
    write_table(
        folder / "change_regions.csv",
        ["time", "against", "region", "area_mm2", "mean_mm", "peak_mm", "peak_z", "x_mm", "y_mm", "z_mm"],
        (
            [
                change.name,
                against,
                number,
                region.area,
                region.mean,
                region.peak,
                region.z,
                *transform_points(back, follow_up.surface.vertices[region.centre][None])[0].tolist(),
            ]
            for change in follow_up.changes
            for against, beyond in (
                ("measurement error", change.regions),
                ("controls", () if change.expected is None else change.expected.regions),
            )
            for number, region in enumerate(beyond, start=1)
        ),
    )


def _number_rows(follow_up: FollowUp) -> list[tuple[str, ...]]:
    areas = follow_up.surface.vertex_areas
    rows = []
    for change in follow_up.changes:
        values = zip(_COLUMNS[1:], _numbers(change, areas), strict=True)
        rows.append((change.name, *(_number_text(name, value) for name, value in values)))
    return rows


def _number_text(column: str, value: float | None) -> str:
    if value is None:
        return "no limit" if column in _UNSIGNED else "open"
    return f"{value:.2f}" if column in _UNSIGNED else f"{value:+.2f}"


def follow_up_page(follow_up: FollowUp, reference: Reference) -> Page:
    """Return the report of a patient at several times."""
    context = {
        "times": times_text(follow_up.comparisons, reference),
        "sentences": change_sentences(follow_up),
        "expected": follow_up.expected is not None,
    }
    maps = []
    for change in follow_up.changes:
        faint = "" if beyond_limit(change, follow_up) is None else limit_text(follow_up)
        text = caption("change", name=change.name, faint=faint)
        maps.append(ReportFigure("changes", change_figure(follow_up, change), text))
    tables: dict[str, Mapping[str, Any]] = {
        "numbers": {"columns": _COLUMNS, "rows": _number_rows(follow_up)},
        "reference": {"columns": ("", "value"), "rows": reference_rows(reference)},
    }
    page = Page(f"Change of {follow_up.comparisons[0].name} over time", NOTICE, footer=NOTICE)
    page.write(template_text("follow_up_text.jinja", context), {"maps": maps}, tables)
    return page


def _expected_numbers(change: Change, follow_up: FollowUp) -> list[float | None]:
    against, expected = change.expected, follow_up.expected
    if against is None or expected is None:
        return [0, *[None] * 6]
    return [
        expected.pairs,
        against.beyond.value,
        against.beyond.percent,
        None if np.isnan(change.volume) else against.volume.percent,
        float(np.abs(against.z).max()),
        expected.limit,
        len(against.regions),
    ]


def _numbers(change: Change, areas: Array) -> list[float | None]:
    """Return change of volume [%], mean, rms, most outward and most inward [mm], area beyond [mm²]."""
    share = areas / areas.sum()
    return [
        None if np.isnan(change.volume) else 100.0 * (change.volume - 1.0),
        float(share @ change.distance),
        float(np.sqrt(share @ np.square(change.distance))),
        float(change.distance.max()),
        float(change.distance.min()),
        None if change.z is None else sum(region.area for region in change.regions),
    ]
