"""``homolog export screenshot``: a picture of the window's views, made again without the window."""

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from homolog.errors import InputError
from homolog.files.project import ProjectFolder
from homolog_app.cli.export_files import add_kind, exporting
from homolog_app.cli.options import add_options, with_options
from homolog_app.exports.settings import ScreenshotSettings

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from homolog_app.window.explore.chosen import Snapshot
    from homolog_app.window.scene.canvas import Canvas
    from homolog_app.window.scene.content import Shown

__all__ = ["add_parser", "run"]


def add_parser(kinds: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the kind."""
    parser = add_kind(
        kinds,
        "screenshot",
        "the window's views as PNG",
        "Draw the views as the window's Screenshot does. VIEW is JSON that describes page, shapes and "
        "cameras; "
        'the window\'s dialog shows it. The shortest is \'{"view": {"page": "modes"}}\'; pages are subjects, '
        "modes, groups, measure and check. For views that no project contains, such as those of a run in "
        "progress, the window writes NAME.views.npz with its picture; such a file is a VIEW, too.",
        "FILE (.png)",
    )
    parser.add_argument("--view", required=True, metavar="VIEW", help="JSON, or a file that contains it")
    add_options(parser, ScreenshotSettings)


def run(arguments: argparse.Namespace) -> int:
    """Write the picture; returns the exit code."""
    settings = with_options(ScreenshotSettings(), arguments)
    from homolog_app.films.encode import write_still
    from homolog_app.rendering.draw import with_opengl
    from homolog_app.window.scene.kept import KEPT, read_shown
    from homolog_app.window.snapshot import shown_again

    with exporting(arguments) as tick:
        if arguments.view.endswith(KEPT):
            shown, canvas = read_shown(Path(arguments.view))
        else:
            wanted = _snapshot(arguments.view)
            shown, canvas = shown_again(ProjectFolder(arguments.project), wanted, tick), wanted.canvas
        tick(0.9, "drawing")
        pixels = with_opengl(_drawn, shown, canvas, settings.scale, settings.transparent)
        write_still(arguments.out, pixels)
    sys.stderr.write(f"{arguments.out}: {pixels.shape[1]} x {pixels.shape[0]} pixels\n")
    return 0


def _drawn(shown: "Shown", canvas: "Canvas", scale: int, transparent: bool) -> "NDArray[np.uint8]":
    from homolog_app.window.scene.offscreen import drawn

    return drawn(shown, canvas, scale, transparent=transparent)


def _snapshot(text: str) -> "Snapshot":
    from pydantic import ValidationError

    from homolog_app.window.explore.chosen import Snapshot

    try:
        content = text if text.lstrip().startswith("{") else Path(text).read_bytes()
        return Snapshot.model_validate_json(content)
    except OSError as error:
        raise InputError(f"--view {text}: can't be read: {error.strerror}") from error
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"])) or "the JSON"
        raise InputError(f"--view: {where}: {first['msg']}") from error
