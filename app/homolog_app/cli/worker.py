"""``homolog worker``: a process that works for a Dask scheduler."""

import argparse
import sys
from typing import Any

__all__ = ["add_parser", "run"]


def add_parser(subparsers: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the command."""
    parser = subparsers.add_parser(
        "worker",
        description="Work for a Dask scheduler, one subject at a time, until the scheduler ends or Ctrl-C. "
        "Start one for each core, on any machine that sees the same files, and run with --cluster ADDRESS.",
    )
    parser.add_argument("address", help="of the scheduler, such as tcp://node1:8786")


def run(arguments: argparse.Namespace) -> int:
    """Serve; returns the exit code."""
    from homolog.cluster import serve_as_worker

    sys.stderr.write(f"working for {arguments.address}; Ctrl-C ends it\n")
    serve_as_worker(arguments.address)
    return 0
