"""Numbers as people type and read them: both decimal signs are understood, a point is written."""

import math
from collections.abc import Sequence

__all__ = ["duration", "millilitres", "parse_number", "short", "signed", "tick_words"]


def parse_number(text: str) -> float:
    """Return the number of a text with a decimal point or comma; raises ValueError for anything else."""
    if "_" in text:
        raise ValueError(f"{text!r} is not a number")
    return float(text.strip().replace(",", ".").replace("−", "-"))


def duration(seconds: float) -> str:
    """Return a time for people, no more exact than it is known: ``"about 3 min"``."""
    if seconds < 60:
        return f"about {max(5, round(seconds / 5) * 5)} s"
    if seconds < 5400:
        return f"about {round(seconds / 60)} min"
    return f"about {seconds / 3600:.1f} h"


def signed(value: float, digits: int = 2) -> str:
    """Return a number with its sign, a true minus and fixed digits: ``"+1.50"``, ``"0.00"``."""
    text = f"{value:+.{digits}f}"
    return text[1:] if float(text) == 0.0 else text.replace("-", "−")


def short(value: float) -> str:
    """Return a number with three digits or all those before the point, and a true minus."""
    if abs(value) <= 1e-12:
        return "0"
    return (f"{value:.0f}" if 1000.0 <= abs(value) < 1e6 else f"{value:.3g}").replace("-", "−")


def millilitres(volume: float) -> str:
    """Return a volume with three digits or all those before the point: ``"96.0 ml"``, ``"1532 ml"``."""
    digits = 2 - math.floor(math.log10(volume)) if volume > 0.0 else 0
    return f"{volume:.{min(max(digits, 0), 6)}f} ml"


def tick_words(values: Sequence[float]) -> list[str]:
    """Return the words of evenly spaced ticks, all with as many digits as tell them apart."""
    step = values[1] - values[0] if len(values) > 1 else 1.0
    digits = next(
        digits for digits in range(10) if digits == 9 or abs(round(step, digits) - step) < 1e-3 * step
    )
    return [f"{value + 0.0:.{digits}f}".replace("-", "−") for value in values]
