"""``homolog export``: a project's result for presentations, papers and other programs.

The window's exports are this command in a child process, so that both give the same files.
"""

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from homolog.io.project import ProjectFolder
from homolog.progress import Tick
from homolog_app.cli.analysis import run_report
from homolog_app.cli.export_pictures import (
    COLOUR_BY,
    MOTION,
    SCENE,
    export_film,
    export_plot,
    export_screenshot,
    export_still,
)
from homolog_app.cli.options import (
    PROGRESS,
    PROJECT,
    Part,
    add_command,
    command,
    declare,
    option,
    settings,
    show_progress,
    with_options,
    write_lines,
)
from homolog_app.cli.patient import run_patient_report
from homolog_app.exports.settings import (
    FilmSettings,
    MeshSettings,
    ParticleSettings,
    PlotSettings,
    ScreenshotSettings,
    StillSettings,
    TableSettings,
)

__all__ = ["run_export"]


@dataclass(frozen=True, slots=True)
class _Kind:
    """A kind of export.

    Attributes
    ----------
    write : callable
        Writes to ``arguments.out``, or to the new folder given instead, and returns facts for the last line.
    summary, description : str
        Help.
    out : str
        What is written: ``"FOLDER"``, or ``"FILE"`` with remarks on its suffix.
    settings : type of BaseModel or None
        Settings whose options it has.
    options : tuple
        Further options.
    """

    write: Callable[[argparse.Namespace, Any, Path, Tick], str]
    summary: str
    description: str
    out: str
    settings: type[BaseModel] | None = None
    options: tuple[Part, ...] = ()

    def add(self, name: str, kinds: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
        """Declare the kind."""
        what = "a new or empty folder" if self.out == "FOLDER" else f"{self.out}; replaced if it exists"
        out = option("--out", type=Path, required=True, metavar=self.out.partition(" ")[0], help=what)
        given = () if self.settings is None else (settings(self.settings),)
        parser = kinds.add_parser(name, help=self.summary, description=self.description)
        declare(parser, (PROJECT, out, PROGRESS, *self.options, *given))

    def run(self, arguments: argparse.Namespace) -> int:
        """Export, and print where to; return the exit code."""
        from homolog.io.atomic import replace_folder

        chosen = None if self.settings is None else with_options(self.settings(), arguments)
        is_folder = self.out == "FOLDER"
        place = replace_folder(arguments.out) if is_folder else nullcontext(arguments.out)
        with _exporting(arguments) as tick, place as out:
            facts = self.write(arguments, chosen, out, tick)
        write_lines(f"{arguments.out}{f': {facts}' if facts else ''}", aside=True)
        return 0


def _of_groups(what: str) -> Part:
    return option("--group", nargs=3, metavar=("COLUMN", "A", "B"), help=what)


@contextmanager
def _exporting(arguments: argparse.Namespace) -> Iterator[Tick]:
    """Yield the tick of an export; report completion at the end."""
    with show_progress(arguments.progress) as progress:
        progress.tick(0.0, "preparing")
        yield progress.tick
        progress.tick(1.0, "done")


def _groups(arguments: argparse.Namespace) -> tuple[str, str, str] | None:
    if not arguments.group:
        return None
    column, first, second = arguments.group
    return column, first, second


def _write_cohort(arguments: argparse.Namespace, _: None, out: Path, tick: Tick) -> str:
    from homolog_app.exports.tables import write_cohort

    write_cohort(out, ProjectFolder(arguments.project).cohort())
    return ""


def _write_tables(arguments: argparse.Namespace, settings: TableSettings, out: Path, tick: Tick) -> str:
    from homolog_app.exports.tables import write_tables

    write_tables(ProjectFolder(arguments.project), out, settings, _groups(arguments), tick)
    return ""


_PARTICLES = (
    option(
        "--particles",
        nargs=2,
        type=int,
        required=True,
        metavar=("P", "Q"),
        help="numbers of two particles, from 0",
    ),
)


def _write_measures(arguments: argparse.Namespace, _: None, out: Path, tick: Tick) -> str:
    from homolog.io.results import read_result, read_whole_surface
    from homolog_app.exports.tables import distances_from_mean, group_lines, measure_meshes, write_measures

    project = ProjectFolder(arguments.project)
    result, record = read_result(project), project.read().result
    assert record is not None, "a result that was read has a record"
    meshes = [read_whole_surface(project, record, subject) for subject in record.subjects]
    apart = distances_from_mean(result.world, result.world.mean(axis=0), result.mean_surface)
    measures = measure_meshes(meshes, apart, tick, list(result.structures))
    write_measures(out, result, measures, *arguments.particles)
    write_lines(*group_lines(result, measures, *arguments.particles))
    return ""


_SURFACES = (
    option("--surface", required=True, help="surface that is written, with a distance at each vertex"),
    option(
        "--from",
        dest="other",
        required=True,
        metavar="SURFACE",
        help="surface from which distances are measured",
    ),
)


def _write_distances(arguments: argparse.Namespace, _: None, out: Path, tick: Tick) -> str:
    from homolog.progress import part_of
    from homolog_app.exports.meshes import write_distances
    from homolog_app.scenes.loaded_result import load_result
    from homolog_app.scenes.model_shape import fit_model_shape
    from homolog_app.scenes.shapes import aligned_surfaces, named_surface

    project = ProjectFolder(arguments.project)
    loaded = load_result(project, part_of(tick, 0.0, 0.4))
    result = loaded.result
    shape = fit_model_shape(project.folder.name, loaded.method, result, part_of(tick, 0.4, 0.9))
    own = aligned_surfaces(loaded)
    pair = [named_surface(n, shape, own, result.groups)[0] for n in (arguments.surface, arguments.other)]
    write_lines(write_distances(out, *pair))
    return ""


def _write_meshes(arguments: argparse.Namespace, settings: MeshSettings, out: Path, tick: Tick) -> str:
    from homolog_app.exports.meshes import write_meshes

    count = write_meshes(ProjectFolder(arguments.project), out, settings, _groups(arguments), tick)
    return f"{count} surfaces"


def _write_points(arguments: argparse.Namespace, settings: ParticleSettings, out: Path, tick: Tick) -> str:
    from homolog.io.markups import write_markups
    from homolog.io.morphometrics import write_morphometrics
    from homolog.io.names import file_stems
    from homolog.io.particles import write_particles
    from homolog.io.results import read_result

    result = read_result(ProjectFolder(arguments.project))
    if arguments.what == "morphometrics":
        write_morphometrics(out, result.names, getattr(result, settings.coordinates), result.groups)
        return ""
    points = dict(zip(result.names, getattr(result, settings.coordinates), strict=True))
    if settings.coordinates == "world":  # only aligned shapes have a mean
        points["mean"] = result.world.mean(axis=0)
    for index, (stem, point) in enumerate(zip(file_stems(list(points)), points.values(), strict=True)):
        tick(index / len(points), f"writing {stem}")
        if arguments.what == "particles":
            write_particles(out / f"{stem}_{settings.coordinates}.particles", point)
        else:
            write_markups(out / f"{stem}.mrk.json", point, title=f"{stem} particles")
    return ""


def _write_shapeworks(arguments: argparse.Namespace, _: None, out: Path, tick: Tick) -> str:
    from homolog.io.shapeworks_export import write_shapeworks

    write_shapeworks(ProjectFolder(arguments.project), out, tick)
    return ""


_KINDS = {
    "film": _Kind(
        export_film,
        "animation as MP4, GIF or numbered pictures",
        "Animate the mean shape along modes, from one group's mean to another's, or on a turntable; "
        "along mode 1 by default.",
        "FILE (.mp4, .gif, or no suffix for a folder of PNG pictures)",
        FilmSettings,
        options=MOTION,
    ),
    "still": _Kind(
        export_still,
        "picture of any size as PNG",
        "Draw the mean shape moved along modes or between group means: one frame of the film with the same "
        "options.",
        "FILE (.png)",
        StillSettings,
        options=MOTION,
    ),
    "screenshot": _Kind(
        export_screenshot,
        "the window's views as PNG",
        "Draw the views as Screenshot does in the window. SCENE is JSON with page, shapes and cameras, as "
        'the dialog shows it. The shortest is \'{"view": {"page": "modes"}}\'; pages are subjects, '
        "modes, groups, measure and check.",
        "FILE (.png)",
        ScreenshotSettings,
        options=SCENE,
    ),
    "plot": _Kind(
        export_plot,
        "a plot as SVG, PDF or PNG",
        "Write a plot of the result.",
        "FILE (.svg, .pdf or .png)",
        PlotSettings,
        (_of_groups("two groups of a column, for --kind difference and discriminant"), COLOUR_BY),
    ),
    "meshes": _Kind(
        _write_meshes,
        "surfaces as VTP, PLY, STL or GLB",
        "Write the mean and both ends of the modes, and on request group means and subjects, aligned, in LPS "
        "and mm. VTP, PLY and GLB also contain the outward displacement [mm]; VTP and PLY also p and q. "
        "meshes.csv describes the files.",
        "FOLDER",
        MeshSettings,
        (_of_groups("also the means of two groups of a column, with p and q of their difference"),),
    ),
    "cohort": _Kind(
        _write_cohort,
        "names, files, groups and covariates as CSV",
        "Write the table of the project's subjects; it can be read as a cohort again.",
        "FILE.csv",
    ),
    "table": _Kind(
        _write_tables,
        "scores, modes, measures and group results as CSV",
        "Write scores.csv, modes.csv and subjects.csv (volume, area, size, distance from the mean), and a "
        "folder of tables for each study that homolog analyze stored, or for the groups given here.",
        "FOLDER",
        TableSettings,
        (_of_groups("compare two groups of a column instead of exporting the stored studies"),),
    ),
    "measures": _Kind(
        _write_measures,
        "distances, volume, surface area and wall thickness of each subject as CSV",
        "Write measures of each subject: the Euclidean distance between two particles; volume, surface area "
        "and mean wall thickness of the groomed surface at its original size; mean distance of the aligned "
        "particles from the mean surface. Print means, standard deviations and Welch's test by group.",
        "FILE.csv",
        options=_PARTICLES,
    ),
    "distances": _Kind(
        _write_distances,
        "a surface with its distance from another one",
        "Write a surface with the signed distance of each vertex from another surface (distance_mm, negative "
        "inside), and print mean, root mean square, 95th percentile and maximum, both ways. A surface "
        "is a subject's name, mean, 'mean of GROUP', or a mesh file in aligned coordinates (LPS mm).",
        "FILE (.vtp or .ply)",
        options=_SURFACES,
    ),
    "particles": _Kind(
        _write_points,
        "one .particles file per subject",
        "Write each subject's particles and the mean's: one 'x y z' per line in mm, LPS; equal line numbers "
        "correspond.",
        "FOLDER",
        ParticleSettings,
    ),
    "markups": _Kind(
        _write_points,
        "point lists for 3D Slicer",
        "Write each subject's particles and the mean's as .mrk.json, in mm, LPS, labelled by their numbers.",
        "FOLDER",
        ParticleSettings,
    ),
    "morphometrics": _Kind(
        _write_points,
        "points of all subjects as TPS, NTS and Morphologika",
        "Write all subjects' particles as .tps, .nts and Morphologika files, in mm, for geomorph and Morpho "
        "in R, MorphoJ and PAST.",
        "FOLDER",
        ParticleSettings,
    ),
    "shapeworks": _Kind(
        _write_shapeworks,
        "a project that ShapeWorks opens",
        "Write a .swproj with particles, groomed surfaces and alignments.",
        "FOLDER",
    ),
}


def _declare_kinds(parser: argparse.ArgumentParser) -> None:
    kinds = parser.add_subparsers(dest="what", metavar="WHAT", title="what to export", required=True)
    for name, kind in _KINDS.items():
        kind.add(name, kinds)
    page = "write one page about a project's model and studies, as HTML and PDF"
    add_command(kinds, "report", run_report, page)
    of_patient = "report of one patient against a reference as PDF or HTML"
    add_command(kinds, "patient", run_patient_report, of_patient)


@command("Export a project's result. If you press Ctrl-C, partial files are removed.", _declare_kinds)
def run_export(arguments: argparse.Namespace) -> int:
    """Export; return the exit code."""
    pages = {"report": run_report, "patient": run_patient_report}
    return pages.get(arguments.what, lambda given: _KINDS[given.what].run(given))(arguments)
