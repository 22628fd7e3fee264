"""What films and stills show, as options: modes or groups, and from where."""

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING

from homolog.errors import InputError
from homolog.files.project import ProjectFolder
from homolog_app.films.settings import SIGHTS, camera_view

if TYPE_CHECKING:
    from homolog_app.films.motion import Motion

__all__ = ["add_motion_options", "chosen_motions"]


def add_motion_options(parser: argparse.ArgumentParser) -> None:
    """Declare ``--mode``, ``--group`` and ``--view``."""
    what = parser.add_mutually_exclusive_group()
    what.add_argument(
        "--mode", type=int, nargs="+", metavar="K", help="modes of variation, from 1; several form a grid"
    )
    what.add_argument(
        "--group", nargs=3, metavar=("COLUMN", "A", "B"), help="from the mean of one group to that of another"
    )
    parser.add_argument(
        "--view", nargs="+", type=_sight, metavar="VIEW", default=["oblique"],
        help=f"view directions; several form a grid: {', '.join(SIGHTS)} (default oblique), or "
        "camera:X,Y,Z,X,Y,Z, the directions to the viewer and upwards (LPS), as the window's dialogs give it",
    )  # fmt: skip


def _sight(text: str) -> str:
    if text not in SIGHTS and camera_view(text) is None:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not a view; choose {', '.join(SIGHTS)}, or camera: and six numbers"
        )
    return text


def chosen_motions(arguments: argparse.Namespace, deviations: float) -> "Sequence[Motion]":
    """Return what the options name; the mean at rest if they name nothing.

    Raises
    ------
    InputError
        If the project has no result, or no such mode or group.
    """
    from homolog.files.results import read_result
    from homolog_app.films.motion import group_motion, mode_motions, standing

    result = read_result(ProjectFolder(arguments.project))
    if len(set(arguments.view)) < len(arguments.view) or len(set(arguments.mode or [])) < len(
        arguments.mode or []
    ):
        raise InputError("--mode and --view: give each value once")
    if arguments.mode:
        return mode_motions(result, arguments.mode, deviations)
    if arguments.group:
        return [group_motion(result, *arguments.group)]
    return [standing(result)]
