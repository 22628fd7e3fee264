"""The font of what is written in pictures: matplotlib's, so that they look alike on all machines."""

import importlib.util
from pathlib import Path

__all__ = ["font_file"]


def font_file() -> Path:
    """Return the file of DejaVu Sans, without loading matplotlib."""
    home = importlib.util.find_spec("matplotlib")
    assert home is not None
    assert home.origin is not None
    return Path(home.origin).parent / "mpl-data" / "fonts" / "ttf" / "DejaVuSans.ttf"
