"""A plan of a study as text, and as one page of HTML or PDF."""

from homolog.comparison.plan import Plan, Stability
from homolog.comparison.question import ALIGNED
from homolog_app.rendering.text import aligned
from homolog_app.report import NOTICE
from homolog_app.report.page import Page

__all__ = ["plan_lines", "plan_page"]

_TITLE = "Plan of a study"
_COLUMNS = ("subjects per group", "place (%)", "whole shape (%)", "size: difference found (mm)")
_STABILITY = ("over", "modes", "map", "p of the whole", "least p")


def _what(plan: Plan) -> list[str]:
    """State what was planned, from which pilot, and the answer."""
    settings, (x, y, z) = plan.settings, plan.point
    pilot = f"{plan.subjects} subjects"
    if plan.between:
        pilot += f", without the differences between {', '.join(plan.between)}"
    side = "outward" if settings.effect > 0.0 else "inward"
    needed = [
        f"{count} per group" if count is not None else "more than 1000 per group"
        for count in (plan.needed_place, plan.needed_whole)
    ]
    return [
        f"Effect: {abs(settings.effect):g} mm {side}, {settings.width:.3g} mm wide, at particle "
        f"{settings.particle} ({x:.0f} {y:.0f} {z:.0f} on the mean shape), whose standard deviation is "
        f"{plan.spread_mm:.2f} mm. Pilot: {pilot}. Compared: {ALIGNED[settings.alignment]}.",
        f"For a power of {100.0 * settings.power:.0f} % at 5 %: {needed[0]} to find the effect at its place, "
        f"{needed[1]} to show that the whole shape differs.",
    ]


def _rows(plan: Plan) -> list[tuple[str, ...]]:
    return [
        (str(row.per_group), f"{100.0 * row.place:.0f}", f"{100.0 * row.whole:.0f}", f"{row.size_mm:.2f}")
        for row in plan.rows
    ]


def _stable(item: Stability) -> tuple[str, ...]:
    modes = ", ".join(f"{median:.2f} ({least:.2f})" for median, least in item.modes)
    agreement = item.map_agreement
    map_text = "" if agreement is None else f"{agreement[0]:.2f} ({agreement[1]:.2f})"
    ranges = [
        "" if ends is None else f"{ends[0]:.2g} to {ends[1]:.2g}" for ends in (item.p_whole, item.p_place)
    ]
    return (item.over, modes, map_text, *ranges)


def _method(plan: Plan) -> str:
    settings = plan.settings
    return (
        f"Power: {settings.studies} studies of each number were drawn from a normal distribution with the "
        "covariance of the pilot, the effect was added to the second group, and each was tested as a "
        f"comparison is ({settings.permutations} randomizations); a probit function of the root of the "
        "number joins them. A small pilot knows its covariance only roughly. Stability: median agreement of "
        "each mode above chance with that of the pilot, the least in brackets (1 is equal); the map is that "
        "of the difference of the pilot's two groups."
    )


def plan_lines(plan: Plan) -> list[str]:
    """Return the plan as lines of text."""
    lines = _what(plan)
    tables = [[_COLUMNS, *_rows(plan)], [_STABILITY, *map(_stable, plan.stability)]]
    for table in tables:
        lines += ["", *aligned(table)]
    return lines


def plan_page(plan: Plan) -> Page:
    """Return the plan as a page."""
    page = Page(_TITLE, NOTICE, footer=NOTICE)
    for text in _what(plan):
        page.paragraph(text)
    page.heading("Power")
    page.table(_COLUMNS, _rows(plan))
    page.heading("Stability of the pilot")
    page.table(_STABILITY, [_stable(item) for item in plan.stability], as_text=True)
    page.paragraph(_method(plan))
    return page
