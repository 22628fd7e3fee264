"""``homolog demo``: the paper's coffee-bean experiment, from volumes to the comparison of the methods."""

import argparse
import shutil
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from homolog.errors import InputError
from homolog.progress import Tick, part_of
from homolog.settings import Alignment, GroomSettings, Method, OptimizeSettings, RunSettings
from homolog_app.cli.options import with_options
from homolog_app.cli.progress import add_progress_option, remaining_seconds, show_progress

if TYPE_CHECKING:
    from homolog.cohort import Cohort
    from homolog.files.project import ProjectFolder

__all__ = ["add_parser", "run"]

_SHAPES, _SEED = 10, 5
_MODES = 2  # true factors of variation: slot position and width
_METHODS = (Method.EUCLIDEAN, Method.GEODESIC_NORMALS)
_NAMES = {Method.EUCLIDEAN: "original", Method.GEODESIC_NORMALS: "proposed"}
_ENDS = (0.01, 0.29, 0.80, 0.82)
"""Shares of the whole time after which the cohort, each method and the figures are done, measured."""
_ETA_FROM = 0.08  # before that a cold start, which compiles kernels, says nothing about the rest


def add_parser(subparsers: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
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


def run(arguments: argparse.Namespace) -> int:
    """Run the experiment; returns the exit code."""
    from homolog.beans.files import write_beans
    from homolog.beans.generate import draw_beans, draw_moments
    from homolog.files.atomic import report_os_errors
    from homolog_app.cli.demo_table import table_text, write_comparison

    out = arguments.out
    optimize = with_options(OptimizeSettings(), arguments)
    _check_folder(out)
    beans = draw_beans(_SHAPES, _SEED)
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
            for done in projects.values():  # groomed alike, so that the second method finds it in its cache
                with report_os_errors(out / name):
                    shutil.copytree(done.groomed, out / name / done.groomed.name, dirs_exist_ok=True)
            projects[name] = _run_method(out / name, name, cohort, settings, part_of(tick, start, end))
        rows = write_comparison(out, projects, beans, part_of(tick, _ENDS[2], _ENDS[3]))
        _draw(out, projects, part_of(tick, _ENDS[3], 1.0))
    position, width, correlation = draw_moments(beans)
    sys.stdout.write(
        f"\nCoffee beans: {_SHAPES} shapes, seed {_SEED} (slot position sd {position:.1f} mm, width sd "
        f"{width:.1f} mm, correlation {correlation:+.2f}), {optimize.particles} particles\n\n"
        f"{table_text(rows)}\n\npictures and results: {out.resolve()}\n"
        f"  comparison.png, comparison.csv; original/ and proposed/ are projects with figures/\n"
    )
    return 0


def _check_folder(out: Path) -> None:
    """Refuse to mix the demo's files with others; those of an earlier demo are replaced."""
    own = {"cohort", *_NAMES.values(), "comparison.png", "comparison.csv"}
    if out.exists() and not out.is_dir():
        raise InputError(f"{out}: is a file; give a folder with --out")
    if out.is_dir() and any(path.name not in own for path in out.iterdir()):
        raise InputError(f"{out}: contains other files; choose a new or empty folder with --out")


def _run_method(
    folder: Path, name: str, cohort: "Cohort", optimize: OptimizeSettings, tick: Tick
) -> "ProjectFolder":
    """Run one method on the cohort, whose shapes lie in one frame as they are."""
    from homolog.files.project import ProjectFolder
    from homolog.run import Run

    project = ProjectFolder(folder)
    settings = RunSettings(groom=GroomSettings(alignment=Alignment.NONE), optimize=optimize)
    job = Run(project, cohort, settings)
    job.execute(lambda status: tick(status.fraction, f"{name} method, {status.phase}: {status.message}"))
    return project


def _draw(out: Path, projects: dict[str, "ProjectFolder"], tick: Tick) -> None:
    from homolog.analysis.shape_model import ShapeModel
    from homolog.files.atomic import atomic_write
    from homolog.files.results import read_modes, read_result
    from homolog_app.cli.figures import draw_figures
    from homolog_app.pictures import ModeSurfaces, draw_modes, write_picture

    models: dict[str, ModeSurfaces] = {}
    reference = None
    for index, (name, project) in enumerate(projects.items()):
        draw_figures(project, part_of(tick, 0.4 * index, 0.4 * (index + 1)))
        result = read_result(project)
        model = ShapeModel.fit(result.world)
        moves = read_modes(project, result.mean_surface)[:_MODES]
        scores = model.scores[:, :_MODES]
        reference = scores if reference is None else reference
        signs = np.where((scores * reference).sum(axis=0) < 0.0, -1.0, 1.0)  # a mode's sign is arbitrary
        models[f"{name} method"] = ModeSurfaces(
            result.mean_surface, signs[:, None, None] * moves, model.explained_variance_ratio
        )
    tick(0.8, "drawing the comparison")
    with atomic_write(out / "comparison.png") as part:
        write_picture(draw_modes(models, modes=range(_MODES), width=320), part)
