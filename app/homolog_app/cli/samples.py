"""Cohorts with known truth: ``homolog sample`` and ``beans``."""

import argparse
import sys
from pathlib import Path
from shlex import quote

from homolog_app.cli.options import PROGRESS, command, option, show_progress

__all__ = ["run_beans", "run_sample"]

_KINDS = {
    "hearts": "left ventricles, healthy and after an infarct that thins a sector of the wall",
    "vertebrae": "lumbar vertebrae, healthy and with a wedge fracture",
    "femora": "upper ends of femora, left and right, cut through the shaft, healthy and with a cam deformity",
    "beans": "the coffee beans of the paper, without groups",
}


_ANATOMIES = "\n".join(f"  {kind:<11}{text}" for kind, text in _KINDS.items())


@command(
    "Generate a study to try Homolog on: label maps or meshes, cohort.csv with group, age, "
    f"sex and side, and truth/ with corresponding vertices and the true effect.\n\n{_ANATOMIES}",
    option("kind", choices=list(_KINDS), help="anatomy"),
    option("--subjects", type=int, default=20, help="number of subjects (default 20)"),
    option("--out", type=Path, required=True, help="output folder"),
    option("--seed", type=int, default=5, help="random seed (default 5)"),
    option(
        "--scans", action="store_true", help="also write NAME_image.nrrd, the grey values behind label maps"
    ),
    PROGRESS,
    formatter_class=argparse.RawDescriptionHelpFormatter,
)
def run_sample(arguments: argparse.Namespace) -> int:
    """Write the study; return the exit code."""
    from homolog.samples import make_study, write_study

    out, seed = arguments.out, arguments.seed
    if arguments.kind == "beans":
        arguments.shapes, arguments.geometry = arguments.subjects, "wide"
        return run_beans(arguments)
    with show_progress(arguments.progress) as progress:
        study = make_study(arguments.kind, arguments.subjects, seed)
        write_study(out, study, seed, progress.tick, scans=arguments.scans)
    groups = list(dict.fromkeys(subject.columns["group"] for subject in study.subjects))
    counts = [sum(subject.columns["group"] == group for subject in study.subjects) for group in groups]
    described = ", ".join(f"{count} {group}" for group, count in zip(groups, counts, strict=True))
    sys.stdout.write(
        f"{out}: {len(study.subjects)} {study.kind} ({described}), seed {seed}; truth in {out / 'truth'}\n"
        f"Next: homolog run {quote(str(out))} --out {quote(out.name)}-study\n"
    )
    return 0


_GEOMETRIES = ("wide", "narrow")


@command(
    "Generate the paper's coffee-bean cohort: label volumes (NRRD) and truth.csv.",
    option("out", type=Path, help="output folder"),
    option("--shapes", type=int, default=10, help="number of beans (default 10)"),
    option("--seed", type=int, default=5, help="random seed of positions and widths (default 5)"),
    option(
        "--geometry",
        choices=_GEOMETRIES,
        default="wide",
        help="wide: slots overlap across the cohort (default); narrow: a stress test that no method passes",
    ),
    PROGRESS,
)
def run_beans(arguments: argparse.Namespace) -> int:
    """Write the cohort; return the exit code."""
    from homolog.beans.files import write_beans
    from homolog.beans.generate import NARROW, WIDE, draw_beans, draw_moments
    from homolog.errors import InputError

    if not 2 <= arguments.shapes <= 10000:
        raise InputError(f"--shapes {arguments.shapes}: must be between 2 and 10000")
    if arguments.seed < 0:
        raise InputError(f"--seed {arguments.seed}: must be 0 or more")
    geometry = {"wide": WIDE, "narrow": NARROW}[arguments.geometry]
    beans = draw_beans(arguments.shapes, arguments.seed, geometry)
    with show_progress(arguments.progress) as progress:
        write_beans(arguments.out, beans, arguments.seed, progress.tick)
    position, width, correlation = draw_moments(beans)
    sys.stdout.write(
        f"{arguments.out}: {len(beans)} {geometry.name} beans, seed {arguments.seed}; slot position "
        f"sd {position:.2f} mm, width sd {width:.2f} mm, correlation {correlation:+.2f}\n"
    )
    return 0
