"""Planning of studies: ``homolog plan``."""

import argparse
from pathlib import Path

from homolog.io.project import ProjectFolder
from homolog_app.cli.options import ANYWAY, PROGRESS, command, option, show_progress, write_lines

__all__ = ["run_plan"]


@command(
    "Power of studies of two groups for an effect of given size and place, simulated from a "
    "pilot; the numbers per group that are needed; and how stable modes, map and p of the pilot are over "
    "parts of its subjects, fewer particles, and seeds (those that homolog analyze --seeds stored).",
    option("project", type=Path, help="project folder of the pilot"),
    option(
        "--effect",
        type=float,
        required=True,
        metavar="MM",
        help="height of a smooth bump, inward if negative",
    ),
    option("--width", type=float, metavar="MM", help="its full width at half maximum (default: 4 spacings)"),
    option("--particle", type=int, metavar="NUMBER", help="its place (default: a place of median variation)"),
    option("--group", metavar="COLUMN", default="group", help="column of groups (default group)"),
    option("--between", nargs="+", metavar="GROUP", default=[], help="groups of the pilot (default: all)"),
    option(
        "--per-group",
        nargs="+",
        type=int,
        metavar="NUMBER",
        default=[8, 12, 20, 30, 50, 80],
        help="subjects per group to simulate (default 8 12 20 30 50 80)",
    ),
    option("--power", type=float, default=0.8, help="wanted power (default 0.8)"),
    option(
        "--alignment",
        choices=["form", "shape", "as-it-lies"],
        default="shape",
        help="alignment of the comparison, as in homolog analyze (default shape)",
    ),
    option("--studies", type=int, default=100, help="simulated studies of each number (default 100)"),
    option("--seed", type=int, default=0, help="random seed (default 0)"),
    option("--out", type=Path, metavar="FILE", help="also write the page (.pdf or .html)"),
    ANYWAY,
    PROGRESS,
)
def run_plan(arguments: argparse.Namespace) -> int:
    """Plan; return the exit code."""
    from homolog.comparison.plan import plan_project
    from homolog.inspection.verdict import refuse_unusable
    from homolog.io.results import read_result
    from homolog.statistics.procrustes import Alignment
    from homolog_app.report.plan import plan_lines, plan_page
    from homolog_app.report.sheets import check_page_name, write_page

    if arguments.out is not None:
        check_page_name(arguments.out)
    project = ProjectFolder(arguments.project)
    with show_progress(arguments.progress) as progress:
        if not arguments.anyway:
            refuse_unusable(project, read_result(project).world)
        plan = plan_project(
            project,
            arguments.effect,
            width=arguments.width,
            column=arguments.group,
            between=arguments.between,
            particle=arguments.particle,
            per_group=tuple(arguments.per_group),
            power=arguments.power,
            alignment=Alignment(arguments.alignment),
            studies=arguments.studies,
            seed=arguments.seed,
            tick=progress.tick,
        )
    lines = plan_lines(plan)
    if arguments.out is not None:
        write_page(arguments.out, plan_page(plan))
        lines.append(str(arguments.out))
    write_lines(*lines)
    return 0
