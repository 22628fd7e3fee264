"""Cohorts with known truth: ``homolog sample``, ``beans`` and ``demo``, the paper's experiment."""

import argparse
import shutil
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any

import numpy as np

from homolog.errors import InputError
from homolog.progress import Tick, part_of
from homolog.settings import Alignment, GroomSettings, Method, OptimizeSettings, RunSettings
from homolog_app.cli.options import add_progress_option, remaining_seconds, show_progress, with_options

if TYPE_CHECKING:
    from homolog.beans.generate import Bean
    from homolog.cohort import Cohort
    from homolog.io.project import ProjectFolder

__all__ = [
    "ComparisonRow",
    "add_beans",
    "add_demo",
    "add_sample",
    "run_beans",
    "run_demo",
    "run_sample",
    "table_text",
]


_KINDS = {
    "hearts": "left ventricles, healthy and after an infarct that thins a sector of the wall",
    "vertebrae": "lumbar vertebrae, healthy and with a wedge fracture",
    "femora": "upper ends of femora, left and right, cut through the shaft, healthy and with a cam deformity",
    "beans": "the coffee beans of the paper, without groups",
}


def add_sample(subparsers: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
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


def add_beans(subparsers: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the command."""
    parser = subparsers.add_parser(
        "beans",
        description="Generate the paper's coffee-bean cohort: label volumes (NRRD) and truth.csv.",
    )
    parser.add_argument("out", type=Path, help="output folder")
    parser.add_argument("--shapes", type=int, default=10, help="number of beans (default 10)")
    parser.add_argument("--seed", type=int, default=5, help="random seed of positions and widths (default 5)")
    parser.add_argument(
        "--geometry",
        choices=_GEOMETRIES,
        default="wide",
        help="wide: slots overlap across the cohort (default); narrow: a stress test that no method passes",
    )
    add_progress_option(parser)


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


SHAPES, _SEED = 10, 5
_MODES = 2  # true factors of variation: slot position and width
_METHODS = (Method.EUCLIDEAN, Method.GEODESIC_NORMALS)
_NAMES = {Method.EUCLIDEAN: "original", Method.GEODESIC_NORMALS: "proposed"}
_ENDS = (0.01, 0.29, 0.80, 0.82)
"""Measured fractions of the total time at which the cohort, each method and the figures are finished."""
_ETA_FROM = 0.08  # earlier estimates would include the compilation of kernels


def add_demo(subparsers: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the command."""
    parser = subparsers.add_parser(
        "demo",
        description="Generate the paper's coffee-bean cohort, run two methods on it (original: Euclidean "
        "distances; proposed: geodesic distances and normals), print the comparison and draw the pictures.",
    )
    parser.add_argument(
        "--out", type=Path, default=Path("homolog-demo"), help="output folder (default homolog-demo)"
    )
    parser.add_argument(
        "--particles", default=1024, metavar="INT", help="number of particles on each bean (default 1024)"
    )
    add_progress_option(parser)


def run_demo(arguments: argparse.Namespace) -> int:
    """Run the experiment; return the exit code."""
    from homolog.beans.files import write_beans
    from homolog.beans.generate import draw_beans, draw_moments
    from homolog.io.atomic import report_os_errors

    out = arguments.out
    optimize = with_options(OptimizeSettings(), arguments)
    _check_folder(out)
    beans = draw_beans(SHAPES, _SEED)
    started = time.monotonic()
    with show_progress(arguments.progress) as progress:

        def tick(fraction: float, message: str) -> None:
            left = remaining_seconds(fraction, time.monotonic() - started)
            progress.show(fraction, message, left if fraction > _ETA_FROM else None)

        cohort = write_beans(out / "cohort", beans, _SEED, part_of(tick, 0.0, _ENDS[0]))
        projects: dict[str, ProjectFolder] = {}
        for method, start, end in zip(_METHODS, _ENDS, _ENDS[1:], strict=False):
            settings = optimize.model_copy(update={"method": method})
            name = _NAMES[method]
            for done in projects.values():  # equal grooming, so that the second method finds it in its cache
                with report_os_errors(out / name):
                    shutil.copytree(done.groomed, out / name / done.groomed.name, dirs_exist_ok=True)
            projects[name] = _run_method(out / name, name, cohort, settings, part_of(tick, start, end))
        rows = write_comparison(out, projects, beans, part_of(tick, _ENDS[2], _ENDS[3]))
        _draw(out, projects, part_of(tick, _ENDS[3], 1.0))
    position, width, correlation = draw_moments(beans)
    sys.stdout.write(
        f"\nCoffee beans: {SHAPES} shapes, seed {_SEED} (slot position sd {position:.1f} mm, width sd "
        f"{width:.1f} mm, correlation {correlation:+.2f}), {optimize.particles} particles\n\n"
        f"{table_text(rows)}\n\npictures and results: {out.resolve()}\n"
        f"  comparison.png, comparison.csv; original/ and proposed/ are projects with figures/\n"
    )
    return 0


def _check_folder(out: Path) -> None:
    """Refuse a folder with other files; files of an earlier demo are replaced."""
    own = {"cohort", *_NAMES.values(), "comparison.png", "comparison.csv"}
    if out.exists() and not out.is_dir():
        raise InputError(f"{out}: is a file; give a folder with --out")
    if out.is_dir() and any(path.name not in own for path in out.iterdir()):
        raise InputError(f"{out}: contains other files; choose a new or empty folder with --out")


def _run_method(
    folder: Path, name: str, cohort: "Cohort", optimize: OptimizeSettings, tick: Tick
) -> "ProjectFolder":
    """Run one method on the cohort, whose shapes share a frame and need no alignment."""
    from homolog.io.project import ProjectFolder
    from homolog.run import Run

    project = ProjectFolder(folder)
    settings = RunSettings(groom=GroomSettings(alignment=Alignment.NONE), optimize=optimize)
    job = Run(project, cohort, settings)
    job.execute(lambda status: tick(status.fraction, f"{name} method, {status.phase}: {status.message}"))
    return project


def _draw(out: Path, projects: dict[str, "ProjectFolder"], tick: Tick) -> None:
    from homolog.io.atomic import atomic_write
    from homolog.io.results import read_modes, read_result
    from homolog.statistics.shape_model import ShapeModel
    from homolog_app.pictures import ModeSurfaces, draw_modes, write_picture
    from homolog_app.pictures.figures import draw_figures

    models: dict[str, ModeSurfaces] = {}
    reference = None
    for index, (name, project) in enumerate(projects.items()):
        draw_figures(project, part_of(tick, 0.4 * index, 0.4 * (index + 1)))
        result = read_result(project)
        model = ShapeModel().fit(result.world)
        moves = read_modes(project, result.mean_surface)[:_MODES]
        scores = model.scores_[:, :_MODES]
        reference = scores if reference is None else reference
        signs = np.where((scores * reference).sum(axis=0) < 0.0, -1.0, 1.0)  # a mode's sign is arbitrary
        models[f"{name} method"] = ModeSurfaces(
            result.mean_surface, signs[:, None, None] * moves, model.explained_variance_ratio_
        )
    tick(0.8, "drawing the comparison")
    with atomic_write(out / "comparison.png") as part:
        write_picture(draw_modes(models, modes=range(_MODES), width=320), part)


_PAPER_LEAK = {"original": 0.16, "proposed": 0.04}
_DRAWS = 200


@dataclass(frozen=True, slots=True)
class ComparisonRow:
    """One figure of merit for every method.

    Attributes
    ----------
    figure : str
        Description.
    key : str
        Name in the CSV file.
    style : str
        Format of its values, such as ``".2%"``.
    values : mapping of str to float
        Values by method.
    paper : mapping of str to float
        Values reported in the paper, by method; mostly empty.
    """

    figure: str
    key: str
    style: str
    values: Mapping[str, float]
    paper: Mapping[str, float]


_FIGURES = (
    ("variance outside the first two modes (leakage)", "leak", ".2%"),
    ("variance explained by slot position and width", "ground_truth_r2", ".2%"),
    ("R² of slot position on the first two scores", "r2_position", ".3f"),
    ("R² of slot width on the first two scores", "r2_width", ".3f"),
    ("particles in the slot, relative to its share of the area", "slot_fill", ".0%"),
    ("normals over 90° apart, of pairs", "normals_over_90_pairs", ".2%"),
    ("opposite slot walls, of pairs in the slot", "wall_swap", ".2%"),
    ("variance per particle [mm²]", "var_per_particle", ".2f"),
    ("distance to the true surface, mean [mm]", "distance_mean", ".3f"),
    ("distance to the true surface, 95 % [mm]", "distance_p95", ".3f"),
    ("variation of nearest-neighbour distances", "nn_cv", ".3f"),
    ("largest gap, in mean spacings", "cover_max", ".2f"),
    ("share of mode 1", "mode_1", ".2%"),
    ("share of mode 2", "mode_2", ".2%"),
    ("share of mode 3", "mode_3", ".2%"),
    ("generalization with two modes [mm]", "generalization", ".3f"),
    ("specificity with two modes [mm]", "specificity", ".3f"),
    ("iterations", "iterations", ".0f"),
    ("seconds", "seconds", ".0f"),
)


def write_comparison(
    out: Path, projects: Mapping[str, "ProjectFolder"], beans: Sequence["Bean"], tick: Tick
) -> list[ComparisonRow]:
    """Evaluate the methods' results and write ``comparison.csv``.

    Parameters
    ----------
    out : Path
        Folder of the table.
    projects : mapping of str to ProjectFolder
        Finished runs by method.
    beans : sequence of Bean
        The true shapes of the cohort.
    tick : Tick
    """
    from homolog.io.tables import write_table

    by_method = {}
    for index, (name, project) in enumerate(projects.items()):
        part = part_of(tick, index / len(projects), (index + 1) / len(projects))
        by_method[name] = _figures_of(project, beans, part)
    rows = [
        ComparisonRow(
            figure,
            key,
            style,
            values={name: figures[key] for name, figures in by_method.items()},
            paper=_PAPER_LEAK if key == "leak" else {},
        )
        for figure, key, style in _FIGURES
    ]
    write_table(
        out / "comparison.csv",
        ["figure", *projects, *(f"paper_{name}" for name in projects)],
        ([row.key, *row.values.values(), *(row.paper.get(name) for name in projects)] for row in rows),
    )
    return rows


def _figures_of(project: "ProjectFolder", beans: Sequence["Bean"], tick: Tick) -> dict[str, float]:
    from homolog.beans.evaluate import evaluate
    from homolog.io.results import read_result
    from homolog.statistics.evaluation import generalization, specificity
    from homolog.statistics.shape_model import ShapeModel

    result, record = read_result(project), project.read().result
    assert record is not None
    tick(0.0, "evaluating the correspondences")
    figures = evaluate(result.local, beans)
    tick(0.4, "evaluating the shape model")
    shares = figures.mode_shares
    named = {name: getattr(figures, name) for name in figures.__dataclass_fields__ if name != "mode_shares"}
    model = ShapeModel().fit(result.world)
    return named | {
        "mode_1": shares[0],
        "mode_2": shares[1],
        "mode_3": shares[2],
        "generalization": float(generalization(result.world)[1]),
        "specificity": float(specificity(model, result.world, [2], draws=_DRAWS)[0]),
        "iterations": float(record.iterations),
        "seconds": sum(record.seconds.values()),
    }


def table_text(rows: Sequence[ComparisonRow]) -> str:
    """Return the table in columns for a terminal."""
    methods = list(rows[0].values)
    lines = [["", *methods, "in the paper"]]
    for row in rows:
        paper = " / ".join(format(row.paper[name], ".0%") for name in methods if name in row.paper)
        lines.append([row.figure, *(format(value, row.style) for value in row.values.values()), paper])
    lines = [[line[0], *(cell.replace("%", " %") for cell in line[1:])] for line in lines]
    widths = [max(len(line[column]) for line in lines) for column in range(len(lines[0]))]
    return "\n".join(
        "  ".join(
            [line[0].ljust(widths[0]), *(cell.rjust(w) for cell, w in zip(line[1:], widths[1:], strict=True))]
        ).rstrip()
        for line in lines
    )
