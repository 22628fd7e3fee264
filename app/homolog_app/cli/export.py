"""``homolog export``: a project's result for presentations, papers and other programs.

The window's exports are this command in a child process, so that both give the same files.
"""

import argparse
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from homolog.io.project import ProjectFolder
from homolog_app.cli.analysis import add_report, run_report
from homolog_app.cli.export_pictures import (
    add_film,
    add_group_option,
    add_kind,
    add_plot,
    add_screenshot,
    add_still,
    exporting,
    run_film,
    run_plot,
    run_screenshot,
    run_still,
)
from homolog_app.cli.options import add_options, with_options
from homolog_app.cli.patient import add_patient_report, run_patient_report
from homolog_app.exports.settings import MeshSettings, ParticleSettings, TableSettings

if TYPE_CHECKING:
    from homolog.progress import Tick

__all__ = ["add_export", "run_export"]


def add_cohort(kinds: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the kind."""
    add_kind(
        kinds,
        "cohort",
        "names, files, groups and covariates as CSV",
        "Write the table of the project's subjects; it can be read as a cohort again.",
        "FILE.csv",
    )


def run_cohort(arguments: argparse.Namespace) -> int:
    """Write the table; return the exit code."""
    from homolog_app.exports.tables import write_cohort

    with exporting(arguments):
        write_cohort(arguments.out, ProjectFolder(arguments.project).cohort())
    sys.stderr.write(f"{arguments.out}\n")
    return 0


def add_table(kinds: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the kind."""
    parser = add_kind(
        kinds,
        "table",
        "scores, modes, measures and group results as CSV",
        "Write scores.csv, modes.csv and subjects.csv (volume, area, size, distance from the mean), and a "
        "folder of tables for each study that homolog analyze stored, or for the groups given here.",
        "FOLDER",
    )
    add_group_option(parser, "compare two groups of a column instead of exporting the stored studies")
    add_options(parser, TableSettings)


def run_table(arguments: argparse.Namespace) -> int:
    """Write the tables; return the exit code."""
    settings = with_options(TableSettings(), arguments)
    from homolog.io.atomic import replace_folder
    from homolog_app.exports.tables import write_tables

    groups = tuple(arguments.group) if arguments.group else None
    with exporting(arguments) as tick, replace_folder(arguments.out) as folder:
        write_tables(ProjectFolder(arguments.project), folder, settings, groups, tick)
    sys.stderr.write(f"{arguments.out}\n")
    return 0


def add_measures(kinds: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the kind."""
    parser = add_kind(
        kinds,
        "measures",
        "distances, volume, surface area and wall thickness of each subject as CSV",
        "Write measures of each subject: the Euclidean distance between two particles; volume, surface area "
        "and mean wall thickness of the groomed surface at its original size; mean distance of the aligned "
        "particles from the mean surface. Print means, standard deviations and Welch's test by group.",
        "FILE.csv",
    )
    parser.add_argument(
        "--particles",
        nargs=2,
        type=int,
        required=True,
        metavar=("P", "Q"),
        help="numbers of two particles, from 0",
    )


def run_measures(arguments: argparse.Namespace) -> int:
    """Write the table; return the exit code."""
    from homolog.io.results import read_result, read_surface
    from homolog_app.exports.tables import distances_from_mean, group_lines, measure_meshes, write_measures

    project = ProjectFolder(arguments.project)
    with exporting(arguments) as tick:
        result, record = read_result(project), project.read().result
        assert record is not None, "a result that was read has a record"
        meshes = [read_surface(project, subject) for subject in record.subjects]
        apart = distances_from_mean(result.world, result.world.mean(axis=0), result.mean_surface)
        measures = measure_meshes(meshes, apart, tick)
        write_measures(arguments.out, result, measures, *arguments.particles)
        lines = group_lines(result, measures, *arguments.particles)
    sys.stdout.writelines(f"{line}\n" for line in lines)
    sys.stderr.write(f"{arguments.out}\n")
    return 0


def add_distances(kinds: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the kind."""
    parser = add_kind(
        kinds,
        "distances",
        "a surface with its distance from another one",
        "Write a surface with the signed distance of each vertex from another surface (distance_mm, negative "
        "inside), and print mean, root mean square, 95th percentile and maximum, both ways. A surface "
        "is a subject's name, mean, 'mean of GROUP', or a mesh file in aligned coordinates (LPS mm).",
        "FILE (.vtp or .ply)",
    )
    parser.add_argument(
        "--surface", required=True, help="surface that is written, with a distance at each vertex"
    )
    parser.add_argument(
        "--from",
        dest="other",
        required=True,
        metavar="SURFACE",
        help="surface from which distances are measured",
    )


def run_distances(arguments: argparse.Namespace) -> int:
    """Write the surface and print the statistics; return the exit code."""
    from homolog.progress import part_of
    from homolog_app.exports.meshes import write_distances
    from homolog_app.scenes.shapes import aligned_surfaces, named_surface
    from homolog_app.studies.loaded_result import load_result
    from homolog_app.studies.model_shape import fit_model_shape

    project = ProjectFolder(arguments.project)
    with exporting(arguments) as tick:
        loaded = load_result(project, part_of(tick, 0.0, 0.4))
        result = loaded.result
        shape = fit_model_shape(project.folder.name, loaded.method, result, part_of(tick, 0.4, 0.9))
        own = aligned_surfaces(loaded)
        pair = [named_surface(n, shape, own, result.groups)[0] for n in (arguments.surface, arguments.other)]
        text = write_distances(arguments.out, *pair)
    sys.stdout.write(f"{text}\n")
    sys.stderr.write(f"{arguments.out}\n")
    return 0


def add_meshes(kinds: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the kind."""
    parser = add_kind(
        kinds,
        "meshes",
        "surfaces as VTP, PLY, STL or GLB",
        "Write the mean and both ends of the modes, and on request group means and subjects, aligned, in LPS "
        "and mm. VTP, PLY and GLB also contain the outward displacement [mm]; VTP and PLY also p and q. "
        "meshes.csv describes the files.",
        "FOLDER",
    )
    add_group_option(parser, "also the means of two groups of a column, with p and q of their difference")
    add_options(parser, MeshSettings)


def run_meshes(arguments: argparse.Namespace) -> int:
    """Write the meshes; return the exit code."""
    settings = with_options(MeshSettings(), arguments)
    from homolog.io.atomic import replace_folder
    from homolog_app.exports.meshes import write_meshes

    groups = tuple(arguments.group) if arguments.group else None
    with exporting(arguments) as tick, replace_folder(arguments.out) as folder:
        count = write_meshes(ProjectFolder(arguments.project), folder, settings, groups, tick)
    sys.stderr.write(f"{arguments.out}: {count} surfaces\n")
    return 0


_POINTS = {
    "particles": (
        "one .particles file per subject",
        "Write each subject's particles and the mean's: one 'x y z' per line in mm, LPS; equal line numbers "
        "correspond.",
    ),
    "markups": (
        "point lists for 3D Slicer",
        "Write each subject's particles and the mean's as .mrk.json, in mm, LPS, labelled by their numbers.",
    ),
    "morphometrics": (
        "points of all subjects as TPS, NTS and Morphologika",
        "Write all subjects' particles as .tps, .nts and Morphologika files, in mm, for geomorph and Morpho "
        "in R, MorphoJ and PAST.",
    ),
}
"""Kinds of files of points: help and description."""


def add_points(kind: str, kinds: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare a kind of files of points."""
    add_options(add_kind(kinds, kind, *_POINTS[kind], "FOLDER"), ParticleSettings)


def add_shapeworks(kinds: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the kind."""
    add_kind(
        kinds,
        "shapeworks",
        "a project that ShapeWorks opens",
        "Write a .swproj with particles, groomed surfaces and alignments.",
        "FOLDER",
    )


def run_points(arguments: argparse.Namespace) -> int:
    """Write the points; return the exit code."""
    from homolog.io.atomic import replace_folder

    with exporting(arguments) as tick, replace_folder(arguments.out) as folder:
        if arguments.what == "shapeworks":
            from homolog.io.shapeworks_export import write_shapeworks

            write_shapeworks(ProjectFolder(arguments.project), folder, tick)
        else:
            _write_points(arguments, folder, tick)
    sys.stderr.write(f"{arguments.out}\n")
    return 0


def _write_points(arguments: argparse.Namespace, folder: Path, tick: "Tick") -> None:
    from homolog.io.markups import write_markups
    from homolog.io.morphometrics import write_morphometrics
    from homolog.io.names import file_stems
    from homolog.io.particles import write_particles
    from homolog.io.results import read_result

    settings = with_options(ParticleSettings(), arguments)
    result = read_result(ProjectFolder(arguments.project))
    if arguments.what == "morphometrics":
        write_morphometrics(folder, result.names, getattr(result, settings.coordinates), result.groups)
        return
    points = dict(zip(result.names, getattr(result, settings.coordinates), strict=True))
    if settings.coordinates == "world":  # only aligned shapes have a mean
        points["mean"] = result.world.mean(axis=0)
    for index, (stem, point) in enumerate(zip(file_stems(list(points)), points.values(), strict=True)):
        tick(index / len(points), f"writing {stem}")
        if arguments.what == "particles":
            write_particles(folder / f"{stem}_{settings.coordinates}.particles", point)
        else:
            write_markups(folder / f"{stem}.mrk.json", point, title=f"{stem} particles")


_KINDS: dict[str, tuple[Callable[[Any], None], Callable[[argparse.Namespace], int]]] = {
    "film": (add_film, run_film),
    "still": (add_still, run_still),
    "screenshot": (add_screenshot, run_screenshot),
    "plot": (add_plot, run_plot),
    "meshes": (add_meshes, run_meshes),
    "cohort": (add_cohort, run_cohort),
    "table": (add_table, run_table),
    "measures": (add_measures, run_measures),
    "distances": (add_distances, run_distances),
    **{kind: (partial(add_points, kind), run_points) for kind in _POINTS},
    "shapeworks": (add_shapeworks, run_points),
    "report": (add_report, run_report),
    "patient": (add_patient_report, run_patient_report),
}
"""Functions that declare and write each kind."""


def add_export(subparsers: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the command and its kinds."""
    parser = subparsers.add_parser(
        "export",
        description="Export a project's result. If you press Ctrl-C, partial files are removed.",
    )
    kinds = parser.add_subparsers(dest="what", metavar="WHAT", title="what to export", required=True)
    for add, _ in _KINDS.values():
        add(kinds)


def run_export(arguments: argparse.Namespace) -> int:
    """Export; return the exit code."""
    return _KINDS[arguments.what][1](arguments)
