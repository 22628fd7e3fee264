"""A plan of a study as text, and as one page of HTML or PDF."""

from homolog.comparison.plan import Plan, Stability
from homolog.comparison.question import ALIGNED
from homolog_app.rendering.text import aligned
from homolog_app.report import NOTICE
from homolog_app.report.page import Page
from homolog_app.report.texts import block_text

__all__ = ["plan_lines", "plan_page"]

_TITLE = "Plan of a study"
_COLUMNS = ("subjects per group", "place (%)", "whole shape (%)", "size: difference found (mm)")
_STABILITY = ("over", "modes", "map", "p of the whole", "least p")


def _text(block: str, plan: Plan) -> str:
    """Return what was planned from which pilot ("effect"), the answer ("needed"), or the method."""
    aligned_how = ALIGNED[plan.settings.alignment]
    return block_text("plan_text.jinja", block, plan=plan, settings=plan.settings, aligned=aligned_how)


def _rows(plan: Plan) -> list[tuple[str, ...]]:
    return [
        (
            str(row.per_group),
            "{:.0f} ({:.0f} to {:.0f})".format(*(100.0 * power for power in (row.place, *row.place_range))),
            f"{100.0 * row.whole:.0f}",
            f"{row.size_mm:.2f}",
        )
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


def plan_lines(plan: Plan) -> list[str]:
    """Return the plan as lines of text."""
    lines = [_text("effect", plan), _text("needed", plan)]
    tables = [[_COLUMNS, *_rows(plan)], [_STABILITY, *map(_stable, plan.stability)]]
    for table in tables:
        lines += ["", *aligned(table)]
    return lines


def plan_page(plan: Plan) -> Page:
    """Return the plan as a page."""
    page = Page(_TITLE, NOTICE, footer=NOTICE)
    page.paragraph(_text("effect", plan))
    page.paragraph(_text("needed", plan))
    page.heading("Power")
    page.table(_COLUMNS, _rows(plan))
    page.heading("Stability of the pilot")
    page.table(_STABILITY, [_stable(item) for item in plan.stability], as_text=True)
    page.paragraph(_text("method", plan))
    return page
