"""Report of one patient at several times: page, tables and the surface with its changes."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from homolog.arrays import Array, BoolArray, FloatArray
from homolog.cohort import Subject
from homolog.errors import InputError
from homolog.geometry import inverse_matrices, transform_points
from homolog.io.atomic import write_text
from homolog.io.meshes import write_mesh
from homolog.io.tables import write_table
from homolog.patient import Change, FollowUp, Reference
from homolog.progress import Tick, no_tick
from homolog_app.pictures.layout import Panel, arrange
from homolog_app.rendering.colours import LIGHT, common_limit
from homolog_app.rendering.text import signed
from homolog_app.report import NOTICE
from homolog_app.report.figures import ReportFigure
from homolog_app.report.page import Page
from homolog_app.report.patient_pages import change_pictures
from homolog_app.report.patient_texts import reference_rows, times_text
from homolog_app.report.sheets import Sheet, write_sheets

__all__ = [
    "beyond_limit",
    "change_sentence",
    "check_times",
    "error_text",
    "expected_sentence",
    "follow_up_sheets",
    "limit_text",
    "write_follow_up",
]

_METHOD = (
    "Each time was compared with the reference separately. The first surface was then registered rigidly to "
    "each later one with robust weights (Geman and McClure), and the distance to it was measured along the "
    "first one's normals, outward positive. The distance that the same registration yields for the first "
    "surface itself was subtracted.",
)
_UNKNOWN = "No control of the reference was scanned twice, so the change of healthy subjects is not known."
_EXPECTED = (
    "The change of controls who were scanned twice was measured in the same way, each with a model without "
    "that control. z is the patient's change minus their mean change, in their standard deviations; one "
    "healthy subject in twenty exceeds the limit anywhere."
)
_MAPS_A_PAGE = 3
_HIGHEST = 2.0
"""Width and height of a map on a page [inches]."""
_COLUMNS = ("time", "volume (%)", "mean (mm)", "rms (mm)", "outward (mm)", "inward (mm)", "beyond (mm²)")
_UNSIGNED = ("rms (mm)", "beyond (mm²)")


def check_times(subjects: Sequence[Subject], repeats: Sequence[Path]) -> None:
    """Raise InputError if a follow-up has too few times or a repeat is missing."""
    if len(subjects) < 2:
        raise InputError("--follow-up: needs at least two files; give the first time first")
    for path in repeats:
        if not path.exists():
            raise InputError(f"{path}: does not exist; correct the path")


def error_text(follow_up: FollowUp) -> str:
    """Describe the measurement error and the scope of its limit."""
    if follow_up.error is None:
        return (
            "No measurement error is known: no repeated segmentations were given. A difference may be "
            "due to scanning or segmenting twice."
        )
    repeats = f"{follow_up.repeats} repeated segmentation{'s' * (follow_up.repeats != 1)}"
    size = f"{float(follow_up.error.mean()):.2f} mm on average"
    if follow_up.everywhere:
        return (
            f"Measurement error from {repeats}: standard deviation {size}. The limit (|z| = "
            f"{follow_up.limit:.1f}) is exceeded anywhere on the surface in 5 % of repeated measurements."
        )
    return (
        f"Measurement error from {repeats}: standard deviation {size}. The limit (|z| = "
        f"{follow_up.limit:.2f}) applies to each position separately: some positions exceed it by chance. "
        "Three or more repeats give a limit for the whole surface."
    )


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
    rows_of_panels, scale = _pictures(follow_up)
    write_text(folder / "follow_up.html", _page(follow_up, reference, rows_of_panels, scale).html)
    write_sheets(
        folder / "follow_up.pdf", _title(follow_up), _sheets(follow_up, reference, rows_of_panels, scale)
    )
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
    return _sentences(follow_up)


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


def _title(follow_up: FollowUp) -> str:
    return f"Change of {follow_up.comparisons[0].name} over time"


def _number_rows(follow_up: FollowUp) -> list[tuple[str, ...]]:
    areas = follow_up.surface.vertex_areas
    rows = []
    for change in follow_up.changes:
        values = zip(_COLUMNS[1:], _numbers(change, areas), strict=True)
        rows.append((change.name, *(_number_text(name, value) for name, value in values)))
    return rows


def _number_text(column: str, value: float | None) -> str:
    if value is None:
        return "no limit"
    return f"{value:.2f}" if column in _UNSIGNED else signed(value)


def follow_up_sheets(follow_up: FollowUp, reference: Reference) -> list[Sheet]:
    """Return the report's pages of A4."""
    return _sheets(follow_up, reference, *_pictures(follow_up))


def _pictures(follow_up: FollowUp) -> tuple[list[tuple[Panel, ...]], float]:
    """Return a row of pictures for each later time, and the limit of their colour scale [mm]."""
    scale = common_limit([change.distance for change in follow_up.changes])
    rows = [
        change_pictures(follow_up.comparisons[0], change.distance, beyond_limit(change, follow_up), scale)
        for change in follow_up.changes
    ]
    return rows, scale


def _sheets(
    follow_up: FollowUp, reference: Reference, panels: Sequence[Sequence[Panel]], limit: float
) -> list[Sheet]:
    """Return pages of A4: findings with maps of three times a page, then numbers and method."""
    parts = [panels[start : start + _MAPS_A_PAGE] for start in range(0, len(panels), _MAPS_A_PAGE)]
    names = [change.name for change in follow_up.changes]
    sheets = []
    for number, part in enumerate(parts, start=1):
        sheet = Sheet(_title(follow_up))
        if number == 1:
            sheet.text(times_text(follow_up.comparisons, reference))
            sheet.heading("Finding")
            for sentence in _sentences(follow_up):
                sheet.text(sentence, 9.0)
        for row, name in zip(part, names[_MAPS_A_PAGE * (number - 1) :], strict=False):
            sheet.heading(f"{name}: change (mm)")
            sheet.panels(row, limit, _HIGHEST)
        sheets.append(sheet)
    last = Sheet(_title(follow_up))
    last.heading("Numbers")
    last.rows([_COLUMNS, *_number_rows(follow_up)], (0.0, 1.5, 2.4, 3.3, 4.1, 5.1, 6.05))
    last.heading("Method")
    for text in _method(follow_up):
        last.text(text, 8.0)
    last.heading("Reference")
    last.rows(reference_rows(reference), (0.0, 1.6), has_header=False)
    return [*sheets, last]


def _page(follow_up: FollowUp, reference: Reference, panels: Sequence[Sequence[Panel]], limit: float) -> Page:
    page = Page(_title(follow_up), NOTICE, footer=NOTICE)
    page.paragraph(times_text(follow_up.comparisons, reference))
    page.heading("Finding")
    *changes, error = _sentences(follow_up)
    for sentence in changes:
        page.paragraph(sentence)
    page.caution(error)
    labels = [change.name for change in follow_up.changes]
    figure = arrange(panels, row_labels=labels, limit=limit, theme=LIGHT)
    known = beyond_limit(follow_up.changes[0], follow_up) is not None
    faint = f", faint within the limit of {limit_text(follow_up)}" if known else ""
    caption = f"Change in mm on the first surface: blue outward, yellow inward{faint}."
    page.figures([ReportFigure("changes", figure, caption)])
    page.heading("Numbers")
    page.table(_COLUMNS, _number_rows(follow_up))
    page.heading("Method")
    for text in _method(follow_up):
        page.paragraph(text)
    return page


def beyond_limit(change: Change, follow_up: FollowUp) -> BoolArray | None:
    """Return the vertices (V,) beyond the controls' limit or, without one, beyond the measurement error.

    None if neither is known.
    """
    if change.expected is not None and follow_up.expected is not None:
        return np.abs(change.expected.z) > follow_up.expected.limit
    if change.z is not None and follow_up.limit is not None:
        return np.abs(change.z) > follow_up.limit
    return None


def limit_text(follow_up: FollowUp) -> str:
    """Name the source of the limit in the maps."""
    return "controls' change" if follow_up.expected is not None else "measuring"


def expected_sentence(change: Change, follow_up: FollowUp) -> str:
    """Compare a change with those of the controls; empty if these are not known."""
    against, expected = change.expected, follow_up.expected
    if against is None or expected is None:
        return ""
    rms, volume = against.beyond, against.volume
    local = "no part of the surface is beyond their limit"
    if against.regions:
        most, count = against.regions[0], len(against.regions)
        local = (
            f"{count} region{'s' * (count != 1)} beyond their limit, the most extreme by "
            f"{signed(most.peak, 1)} mm (|z| {abs(most.z):.1f}, limit {expected.limit:.1f})"
        )
    return (
        f"Against {expected.pairs} controls scanned twice ({expected.between}): {rms.value:.2f} mm (rms) "
        f"from their mean change, percentile {rms.percent:.0f} ({rms.low:.0f} to {rms.high:.0f}); volume "
        f"percentile {volume.percent:.0f} ({volume.low:.0f} to {volume.high:.0f}); {local}."
    )


def _sentences(follow_up: FollowUp) -> list[str]:
    """Return the findings, followed by the measurement error."""
    sentences = []
    for change in follow_up.changes:
        sentences += [change_sentence(change, follow_up), expected_sentence(change, follow_up)]
    return [*filter(None, sentences), error_text(follow_up)]


def _method(follow_up: FollowUp) -> list[str]:
    return [*_METHOD, _UNKNOWN if follow_up.expected is None else _EXPECTED]


def _expected_numbers(change: Change, follow_up: FollowUp) -> list[float | None]:
    against, expected = change.expected, follow_up.expected
    if against is None or expected is None:
        return [0, *[None] * 6]
    return [
        expected.pairs,
        against.beyond.value,
        against.beyond.percent,
        against.volume.percent,
        float(np.abs(against.z).max()),
        expected.limit,
        len(against.regions),
    ]


def _numbers(change: Change, areas: Array) -> list[float | None]:
    """Return change of volume [%], mean, rms, most outward and most inward [mm], area beyond [mm²]."""
    share = areas / areas.sum()
    return [
        100.0 * (change.volume - 1.0),
        float(share @ change.distance),
        float(np.sqrt(share @ np.square(change.distance))),
        float(change.distance.max()),
        float(change.distance.min()),
        None if change.z is None else sum(region.area for region in change.regions),
    ]


def change_sentence(change: Change, follow_up: FollowUp) -> str:
    """Describe the change from the first time to a later one."""
    since = f"{change.name} since {follow_up.comparisons[0].name}"
    volume = f"volume {signed(100.0 * (change.volume - 1.0), 1)} %"
    if change.z is None:
        return (
            f"{since}: {volume}; surface {signed(change.distance.min(), 1)} to "
            f"{signed(change.distance.max(), 1)} mm, without a limit."
        )
    if not change.regions:
        return f"{since}: {volume}; no part of the surface changed by more than the limit."
    most = change.regions[0]
    count = len(change.regions)
    return (
        f"{since}: {volume}; {count} region{'s' * (count != 1)} beyond the limit, the most extreme by "
        f"{signed(most.peak, 1)} mm (|z| {abs(most.z):.1f}, limit {follow_up.limit:.1f})."
    )
