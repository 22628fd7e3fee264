"""Numbers as people type and read them: both decimal signs are understood, a point is written."""

__all__ = ["duration", "parse_number"]


def parse_number(text: str) -> float:
    """Return the number of a text with a decimal point or comma; raises ValueError for anything else."""
    if "_" in text:
        raise ValueError(f"{text!r} is no number")
    return float(text.strip().replace(",", ".").replace("−", "-"))


def duration(seconds: float) -> str:
    """Return a time for people, no more exact than it is known: ``"about 3 min"``."""
    if seconds < 60:
        return f"about {max(5, round(seconds / 5) * 5)} s"
    if seconds < 5400:
        return f"about {round(seconds / 60)} min"
    return f"about {seconds / 3600:.1f} h"
