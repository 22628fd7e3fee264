"""``homolog sample``: a generated study of known truth, as files."""

import argparse
import sys
from pathlib import Path
from typing import Any

from homolog_app.cli.progress import add_progress_option, show_progress

__all__ = ["add_parser", "run"]

_KINDS = {
    "hearts": "left ventricles, healthy and after an infarct that thins a sector of the wall",
    "vertebrae": "lumbar vertebrae, healthy and with a wedge fracture",
    "femora": "upper ends of femora, left and right, cut through the shaft, healthy and with a cam deformity",
    "beans": "the coffee beans of the paper, without groups",
}


def add_parser(subparsers: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the command."""
    kinds = "\n".join(f"  {kind:<11}{text}" for kind, text in _KINDS.items())
    parser = subparsers.add_parser(
        "sample",
        description="Generate a study to try Homolog on: label maps or meshes, cohort.csv with group, age, "
        f"sex and side, and truth/ with corresponding vertices and the true effect.\n\n{kinds}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("kind", choices=list(_KINDS), help="anatomy")
    parser.add_argument("--subjects", type=int, default=20, help="number of subjects (default 20)")
    parser.add_argument("--out", type=Path, required=True, help="output folder")
    parser.add_argument("--seed", type=int, default=5, help="random seed (default 5)")
    parser.add_argument(
        "--scans", action="store_true", help="also write NAME_image.nrrd, the grey values behind label maps"
    )
    add_progress_option(parser)


def run(arguments: argparse.Namespace) -> int:
    """Write the study; returns the exit code."""
    from homolog.samples import make_study, write_study

    out, seed = arguments.out, arguments.seed
    if arguments.kind == "beans":
        from homolog_app.cli import beans

        arguments.shapes, arguments.geometry = arguments.subjects, "wide"
        return beans.run(arguments)
    with show_progress(arguments.progress) as progress:
        study = make_study(arguments.kind, arguments.subjects, seed)
        write_study(out, study, seed, progress.tick, scans=arguments.scans)
    groups = list(dict.fromkeys(subject.columns["group"] for subject in study.subjects))
    counts = [sum(subject.columns["group"] == group for subject in study.subjects) for group in groups]
    described = ", ".join(f"{count} {group}" for group, count in zip(groups, counts, strict=True))
    sys.stdout.write(
        f"{out}: {len(study.subjects)} {study.kind} ({described}), seed {seed}; truth in {out / 'truth'}\n"
        f"Next: homolog run {out} --out {out.name}-study\n"
    )
    return 0
