"""``homolog demo``: two methods on one cohort of known truth, in numbers and pictures."""

import argparse
import shutil
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from homolog.errors import InputError
from homolog.progress import Tick, part_of
from homolog.settings import Alignment, GroomSettings, Method, OptimizeSettings, RunSettings
from homolog_app.cli.options import PROGRESS, command, option, remaining_seconds, show_progress, with_options
from homolog_app.rendering.text import aligned

if TYPE_CHECKING:
    from homolog.cohort import Cohort
    from homolog.io.project import ProjectFolder
    from homolog.surfaces.mesh import TriangleMesh

__all__ = ["ComparisonRow", "run_demo", "table_text"]

SHAPES = {"vertebrae": 12, "beans": 10}
"""Number of subjects."""
_PARTICLES = {"vertebrae": 256, "beans": 1024}
_SEED = 5
_MODES = 2  # true factors of variation of the beans: slot position and width
_METHODS = (Method.EUCLIDEAN, Method.GEODESIC_NORMALS)
_NAMES = {Method.EUCLIDEAN: "original", Method.GEODESIC_NORMALS: "proposed"}
_ENDS = (0.02, 0.42, 0.80, 0.82)
"""Fractions of the total time at which the cohort, each method and the figures are finished, about."""
_ETA_FROM = 0.08  # earlier estimates would include the compilation of kernels
_PAPER_LEAK = {"original": 0.16, "proposed": 0.04}
_DRAWS = 200

_Figures = dict[str, float]


@command(
    "Generate twelve vertebrae, run two methods on them (original: Euclidean distances; "
    "proposed: geodesic distances, normals and coherence), and compare both with the known "
    "correspondence: a table, and pictures of the errors.",
    option("--beans", action="store_true", help="the coffee beans of the paper instead, with its figures"),
    option("--out", type=Path, default=Path("homolog-demo"), help="output folder (default homolog-demo)"),
    option(
        "--particles",
        default=None,
        metavar="INT",
        help="number of particles on each shape (default 256; beans 1024)",
    ),
    PROGRESS,
)
def run_demo(arguments: argparse.Namespace) -> int:
    """Run both methods; return the exit code."""
    from homolog.io.atomic import report_os_errors

    kind = "beans" if arguments.beans else "vertebrae"
    out = arguments.out
    if arguments.particles is None:
        arguments.particles = _PARTICLES[kind]
    optimize = with_options(OptimizeSettings(), arguments)
    _check_folder(out)
    started = time.monotonic()
    with show_progress(arguments.progress) as progress:

        def tick(fraction: float, message: str) -> None:
            left = remaining_seconds(fraction, time.monotonic() - started)
            progress.show(fraction, message, left if fraction > _ETA_FROM else None)

        study = (_beans if arguments.beans else _vertebrae)(out, part_of(tick, 0.0, _ENDS[0]))
        projects: dict[str, ProjectFolder] = {}
        for method, start, end in zip(_METHODS, _ENDS, _ENDS[1:], strict=False):
            settings = RunSettings(groom=study.groom, optimize=optimize.model_copy(update={"method": method}))
            name = _NAMES[method]
            for done in projects.values():  # equal grooming, so that the second method finds it in its cache
                with report_os_errors(out / name):
                    shutil.copytree(done.groomed, out / name / done.groomed.name, dirs_exist_ok=True)
            projects[name] = _run_method(out / name, name, study.cohort, settings, part_of(tick, start, end))
        rows = _write_comparison(out, projects, study, part_of(tick, _ENDS[2], _ENDS[3]))
        study.draw(out, projects, part_of(tick, _ENDS[3], 1.0))
    sys.stdout.write(
        f"\n{study.title}, {optimize.particles} particles\n\n{table_text(rows)}\n\n{study.remark}\n\n"
        f"pictures and results: {out.resolve()}\n"
        f"  comparison.png, comparison.csv; original/ and proposed/ are projects\n"
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
    folder: Path, name: str, cohort: "Cohort", settings: RunSettings, tick: Tick
) -> "ProjectFolder":
    from homolog.io.project import ProjectFolder
    from homolog.run import Run

    project = ProjectFolder(folder)
    job = Run(project, cohort, settings)
    job.execute(lambda status: tick(status.fraction, f"{name} method: {status.message}"))
    return project


@dataclass(frozen=True, slots=True)
class _Study:
    """A cohort of known truth.

    Attributes
    ----------
    title, remark : str
        Of the table: before and after it.
    cohort : Cohort
    groom : GroomSettings
    rows : sequence of (str, str, str)
        Description, name and format of each figure.
    figures : callable
        Takes a project; returns the figures by name.
    draw : callable
        Takes the output folder and the projects by method, and draws ``comparison.png``.
    """

    title: str
    remark: str
    cohort: "Cohort"
    groom: GroomSettings
    rows: Sequence[tuple[str, str, str]]
    figures: Callable[["ProjectFolder"], _Figures]
    draw: Callable[[Path, Mapping[str, "ProjectFolder"], Tick], None]


def _vertebrae(out: Path, tick: Tick) -> _Study:
    from homolog.cohort import read_cohort
    from homolog.io.results import read_result
    from homolog.samples import make_study, write_study
    from homolog.samples.evaluate import place_errors

    study = make_study("vertebrae", SHAPES["vertebrae"], _SEED)
    write_study(out / "cohort", study, _SEED, tick)
    exact = {subject.name: subject.mesh for subject in study.subjects}

    def figures(project: "ProjectFolder") -> _Figures:
        result = read_result(project)
        errors = place_errors([exact[name] for name in result.names], result.local)
        return {
            "error_mean": float(errors.distances.mean()),
            "error_p95": float(np.percentile(errors.distances, 95)),
            "normals_over_90_pairs": errors.opposed,
        }

    return _Study(
        f"Vertebrae: {len(study.subjects)} generated shapes, seed {_SEED}",
        "Where the error is small, corresponding particles lie on the same place of the anatomy. Euclidean\n"
        "distances see through thin bone, so that particles end on its other side on some subjects.",
        read_cohort(out / "cohort"),
        GroomSettings(),
        (
            ("distance from the true place, mean [mm]", "error_mean", ".2f"),
            ("distance from the true place, 95 % [mm]", "error_p95", ".2f"),
            ("normals over 90° apart, of pairs", "normals_over_90_pairs", ".2%"),
        ),
        figures,
        lambda folder, projects, inner: _draw_errors(folder, projects, exact, inner),
    )


def _draw_errors(
    out: Path, projects: Mapping[str, "ProjectFolder"], exact: Mapping[str, "TriangleMesh"], tick: Tick
) -> None:
    """Draw the mean shape of each method with the errors of its particles."""
    from homolog.io.results import read_result
    from homolog.samples.evaluate import place_errors
    from homolog.surfaces.nearest import nearest_particles
    from homolog_app.pictures import View, write_picture
    from homolog_app.pictures.layout import Panel, arrange
    from homolog_app.rendering.camera import frame_around
    from homolog_app.rendering.colours import ColourScale, viridis
    from homolog_app.rendering.rays import Software, shaded
    from homolog_app.rendering.scene import Scene

    maps = {}
    for name, project in projects.items():
        result = read_result(project)
        errors = place_errors([exact[subject] for subject in result.names], result.local).distances
        mesh = result.mean_surface
        nearest = nearest_particles(mesh, result.world.mean(axis=0))
        maps[name] = mesh, errors.mean(axis=(0, 1))[nearest]
    limit = float(np.ceil(max(np.percentile(values, 98) for _, values in maps.values())))
    title = "Mean distance of a particle from its true place"
    scale = ColourScale(title, "mm", 0.0, limit, viridis(), "near", "far")
    views: tuple[View, ...] = (
        View((0.6, -0.7, 0.4), (0.0, 0.0, 1.0), ""),
        View((-0.2, 0.9, 0.35), (0.0, 0.0, 1.0), ""),
    )
    panels, software = [], Software()
    for index, (mesh, values) in enumerate(maps.values()):
        tick(0.5 * index, "drawing the comparison")
        scene = Scene((shaded(mesh, scale.colours(values) / 255.0),))
        frames = [frame_around([mesh.vertices], view) for view in views]
        panels += [Panel(software.draw(scene, frame, 380), "") for frame in frames]
    figure = arrange([panels], title=title, headings=[f"{name} method" for name in maps], scale=scale)
    write_picture(figure, out / "comparison.png")


_BEAN_ROWS = (
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
)


def _beans(out: Path, tick: Tick) -> _Study:
    from homolog.beans.evaluate import evaluate
    from homolog.beans.files import write_beans
    from homolog.beans.generate import draw_beans, draw_moments
    from homolog.io.results import read_result
    from homolog.statistics.evaluation import generalization, specificity
    from homolog.statistics.shape_model import ShapeModel

    beans = draw_beans(SHAPES["beans"], _SEED)
    position, width, correlation = draw_moments(beans)

    def figures(project: "ProjectFolder") -> _Figures:
        result = read_result(project)
        measured = evaluate(result.local, beans)
        named = {
            name: getattr(measured, name) for name in measured.__dataclass_fields__ if name != "mode_shares"
        }
        modes = {f"mode_{number + 1}": measured.mode_shares[number] for number in range(3)}
        return (
            named
            | modes
            | {
                "generalization": float(generalization(result.world)[1]),
                "specificity": float(
                    specificity(ShapeModel().fit(result.world), result.world, [2], draws=_DRAWS)[0]
                ),
            }
        )

    return _Study(
        f"Coffee beans: {len(beans)} shapes, seed {_SEED} (slot position sd {position:.1f} mm, width sd "
        f"{width:.1f} mm, correlation {correlation:+.2f})",
        "In the paper the original method leaks more. Here both methods start from the same registration,\n"
        "which keeps the walls of the slots apart; on thin anatomy they differ: homolog demo.",
        write_beans(out / "cohort", beans, _SEED, tick),
        GroomSettings(alignment=Alignment.NONE),  # beans share a frame
        _BEAN_ROWS,
        figures,
        _draw_modes,
    )


def _draw_modes(out: Path, projects: Mapping[str, "ProjectFolder"], tick: Tick) -> None:
    """Draw the modes of both methods side by side, as figure 3 of the paper, and each project's figures."""
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
    write_picture(draw_modes(models, modes=range(_MODES), width=320), out / "comparison.png")


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


def _write_comparison(
    out: Path, projects: Mapping[str, "ProjectFolder"], study: _Study, tick: Tick
) -> list[ComparisonRow]:
    """Evaluate the methods' results and write ``comparison.csv``."""
    from homolog.io.tables import write_table

    by_method = {}
    for index, (name, project) in enumerate(projects.items()):
        tick(index / len(projects), "evaluating the correspondences")
        record = project.read().result
        assert record is not None
        by_method[name] = study.figures(project) | {
            "iterations": float(record.iterations),
            "seconds": sum(record.seconds.values()),
        }
    rows = [
        ComparisonRow(
            figure,
            key,
            style,
            values={name: figures[key] for name, figures in by_method.items()},
            paper=_PAPER_LEAK if key == "leak" else {},
        )
        for figure, key, style in (*study.rows, ("iterations",) * 2 + (".0f",), ("seconds",) * 2 + (".0f",))
    ]
    write_table(
        out / "comparison.csv",
        ["figure", *projects, *(f"paper_{name}" for name in projects)],
        ([row.key, *row.values.values(), *(row.paper.get(name) for name in projects)] for row in rows),
    )
    return rows


def table_text(rows: Sequence[ComparisonRow]) -> str:
    """Return the table in columns for a terminal."""
    methods = list(rows[0].values)
    has_paper = any(row.paper for row in rows)
    lines = [["", *methods, *(["in the paper"] if has_paper else [])]]
    for row in rows:
        paper = " / ".join(format(row.paper[name], ".0%") for name in methods if name in row.paper)
        values = [format(value, row.style) for value in row.values.values()]
        lines.append([row.figure, *values, *([paper] if has_paper else [])])
    lines = [[line[0], *(cell.replace("%", " %") for cell in line[1:])] for line in lines]
    return "\n".join(aligned(lines, to_right=True))
