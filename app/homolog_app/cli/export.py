"""``homolog export``: a project's result for talks, papers and other programs.

The window's exports are this command in a child process, so that both give the same files.
"""

import argparse
import importlib
import signal
from types import ModuleType
from typing import Any

from homolog_app.signals import handling

__all__ = ["add_parser", "run"]

_MODULES = {
    "film": "export_film", "still": "export_still",
    "screenshot": "export_screenshot", "plot": "export_plot", "meshes": "export_meshes",
    "cohort": "export_cohort", "table": "export_table", "measures": "export_measures",
    "particles": "export_points", "markups": "export_points", "shapeworks": "export_points",
    "report": "report", "patient": "export_patient",
}  # fmt: skip
"""The module of each kind."""


def add_parser(subparsers: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the command and its kinds."""
    parser = subparsers.add_parser(
        "export",
        description="Export a project's result. Ctrl-C removes partial files.",
    )
    kinds = parser.add_subparsers(dest="what", metavar="WHAT", title="what to export", required=True)
    for module in dict.fromkeys(_modules().values()):
        module.add_parser(kinds)


def run(arguments: argparse.Namespace) -> int:
    """Export; returns the exit code."""
    with handling(signal.SIGTERM, signal.default_int_handler):  # ended by the window: tidy up as for Ctrl-C
        return int(_modules()[arguments.what].run(arguments))


def _modules() -> dict[str, ModuleType]:
    package = __name__.rpartition(".")[0]
    return {kind: importlib.import_module(f"{package}.{name}") for kind, name in _MODULES.items()}
