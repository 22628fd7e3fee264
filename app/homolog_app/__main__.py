"""The program: ``homolog``, or ``python -m homolog_app``."""

import gc
import sys

from homolog_app.cli import main

__all__ = ["start"]


def start() -> None:
    """Run the command of the process's arguments, and exit with its code."""
    code = main()
    gc.freeze()  # the interpreter's last search for cycles would take 0.3 s of the processor
    sys.exit(code)


if __name__ == "__main__":
    start()
