"""The desktop application."""

from collections.abc import Sequence

__all__ = ["main"]


def main(argv: Sequence[str] = ()) -> int:
    """Open the window and return its exit code once it is closed.

    Parameters
    ----------
    argv : sequence of str, optional
        A project, folder or files to open.
    """
    try:
        from homolog_app.window.start import start
    except ImportError as error:
        import sys

        missing = isinstance(error, ModuleNotFoundError)
        remedy = "; it is not part of homolog-core, but of homolog: pip install ." if missing else ""
        sys.stderr.write(f"homolog: the window can't open: {error}{remedy}\n")
        return 1
    return start(list(argv))
