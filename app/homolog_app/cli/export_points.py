"""``homolog export particles``, ``markups`` and ``shapeworks``: correspondences for other programs."""

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from homolog.files.project import ProjectFolder
from homolog_app.cli.export_files import add_kind, exporting
from homolog_app.cli.options import add_options, with_options
from homolog_app.exports.settings import ParticleSettings

if TYPE_CHECKING:
    from homolog.progress import Tick

__all__ = ["add_parser", "run"]


def add_parser(kinds: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the kinds."""
    particles = add_kind(
        kinds,
        "particles",
        "a .particles file a subject",
        "Write each subject's particles and the mean's: one 'x y z' a line in mm, LPS; the line is the "
        "correspondence.",
        "FOLDER",
    )
    add_options(particles, ParticleSettings)
    markups = add_kind(
        kinds,
        "markups",
        "point lists for 3D Slicer",
        "Write each subject's particles and the mean's as .mrk.json, in mm, LPS; labels are the numbers of "
        "the correspondences.",
        "FOLDER",
    )
    add_options(markups, ParticleSettings)
    add_kind(
        kinds,
        "shapeworks",
        "a project that ShapeWorks opens",
        "Write a .swproj with particles, groomed surfaces and alignments.",
        "FOLDER",
    )


def run(arguments: argparse.Namespace) -> int:
    """Write the points; returns the exit code."""
    from homolog.files.atomic import replace_folder

    with exporting(arguments) as tick, replace_folder(arguments.out) as folder:
        if arguments.what == "shapeworks":
            from homolog.exchange import write_shapeworks

            write_shapeworks(ProjectFolder(arguments.project), folder, tick)
        else:
            _write_points(arguments, folder, tick)
    sys.stderr.write(f"{arguments.out}\n")
    return 0


def _write_points(arguments: argparse.Namespace, folder: Path, tick: "Tick") -> None:
    from homolog.exchange import write_markups
    from homolog.files.names import file_stems
    from homolog.files.particles import write_particles
    from homolog.files.results import read_result

    settings = with_options(ParticleSettings(), arguments)
    result = read_result(ProjectFolder(arguments.project))
    points = dict(zip(result.names, getattr(result, settings.coordinates), strict=True))
    if settings.coordinates == "world":  # shapes in the coordinates of their files have no common mean
        points["mean"] = result.world.mean(axis=0)
    for index, (stem, point) in enumerate(zip(file_stems(list(points)), points.values(), strict=True)):
        tick(index / len(points), f"writing {stem}")
        if arguments.what == "particles":
            write_particles(folder / f"{stem}_{settings.coordinates}.particles", point)
        else:
            write_markups(folder / f"{stem}.mrk.json", point, title=f"{stem} particles")
