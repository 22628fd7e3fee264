"""Planning of studies: ``homolog plan``."""

import argparse
import sys
from pathlib import Path
from typing import Any

from homolog.io.project import ProjectFolder
from homolog_app.cli.options import add_anyway_option, add_progress_option, show_progress

__all__ = ["add_plan", "run_plan"]


def add_plan(subparsers: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the command."""
    parser = subparsers.add_parser(
        "plan",
        help="plan a study of two groups from a pilot: power, needed numbers, stability",
        description="Power of studies of two groups for an effect of given size and place, simulated from a "
        "pilot; the numbers per group that are needed; and how stable modes, map and p of the pilot are over "
        "parts of its subjects, fewer particles, and seeds (those that homolog analyze --seeds stored).",
    )
    parser.add_argument("project", type=Path, help="project folder of the pilot")
    parser.add_argument(
        "--effect",
        type=float,
        required=True,
        metavar="MM",
        help="height of a smooth bump, inward if negative",
    )
    parser.add_argument(
        "--width",
        type=float,
        metavar="MM",
        help="its full width at half maximum (default: 4 spacings)",
    )
    parser.add_argument(
        "--particle", type=int, metavar="NUMBER", help="its place (default: a place of median variation)"
    )
    parser.add_argument("--group", metavar="COLUMN", default="group", help="column of groups (default group)")
    parser.add_argument(
        "--between", nargs="+", metavar="GROUP", default=[], help="groups of the pilot (default: all)"
    )
    parser.add_argument(
        "--per-group",
        nargs="+",
        type=int,
        metavar="NUMBER",
        default=[8, 12, 20, 30, 50, 80],
        help="subjects per group to simulate (default 8 12 20 30 50 80)",
    )
    parser.add_argument("--power", type=float, default=0.8, help="wanted power (default 0.8)")
    parser.add_argument(
        "--alignment",
        choices=["form", "shape", "as-it-lies"],
        default="shape",
        help="alignment of the comparison, as in homolog analyze (default shape)",
    )
    parser.add_argument(
        "--studies", type=int, default=100, help="simulated studies of each number (default 100)"
    )
    parser.add_argument("--seed", type=int, default=0, help="random seed (default 0)")
    parser.add_argument("--out", type=Path, metavar="FILE", help="also write the page (.pdf or .html)")
    add_anyway_option(parser)
    add_progress_option(parser)


def run_plan(arguments: argparse.Namespace) -> int:
    """Plan; return the exit code."""
    from homolog.comparison.plan import plan_project
    from homolog.inspection.verdict import refuse_unusable
    from homolog.io.results import read_result
    from homolog.statistics.procrustes import Alignment
    from homolog_app.report.plan import check_name, plan_lines, write_plan

    if arguments.out is not None:
        check_name(arguments.out)
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
        write_plan(arguments.out, plan)
        lines.append(str(arguments.out))
    sys.stdout.write("".join(f"{line}\n" for line in lines))
    return 0
