"""Colours: the paper's blue-yellow map, stable colours by correspondence, light and dark themes."""

from dataclasses import dataclass
from functools import cache
from importlib.resources import files

import numpy as np

from homolog.arrays import FloatArray, frozen

__all__ = ["DARK", "LIGHT", "Theme", "correspondence_colours", "diverging_colours", "diverging_table"]


@dataclass(frozen=True, slots=True)
class Theme:
    """Colours of everything but the data; red, green, blue in [0, 1]."""

    background: tuple[float, float, float]
    text: tuple[float, float, float]
    surface: tuple[float, float, float]
    cut: tuple[float, float, float]


LIGHT = Theme(
    background=(1.0, 1.0, 1.0), text=(0.10, 0.10, 0.12), surface=(0.83, 0.82, 0.80), cut=(0.71, 0.42, 0.36)
)
"""Dark text on white, for print."""

DARK = Theme(
    background=(0.09, 0.10, 0.11), text=(0.91, 0.91, 0.92), surface=(0.72, 0.72, 0.73), cut=(0.65, 0.35, 0.30)
)
"""Light text on near black, for slides and the dark window."""


@cache
def diverging_table() -> FloatArray:
    """Return the blue-white-yellow table, contraction (yellow) first: (256, 3) in [0, 1]."""
    source = files("homolog_resources") / "colours" / "blue_white_yellow.csv"
    with source.open() as stream:
        rows = np.loadtxt(stream, delimiter=",")
    return frozen(rows / 255.0, np.float64)


def diverging_colours(values: FloatArray, limit: float) -> FloatArray:
    """Colour outward displacements: blue where positive (expansion), yellow where negative.

    Parameters
    ----------
    values : (n,) array
        Outward displacement [mm].
    limit : float
        Value of the strongest colours [mm], on both sides of 0; values beyond it are cut off.
    """
    table = diverging_table()
    place = (np.clip(values / limit, -1.0, 1.0) + 1.0) / 2.0 * (len(table) - 1)
    columns = [np.interp(place, np.arange(len(table)), column) for column in table.T]
    return np.stack(columns, axis=1)


def correspondence_colours(particles: FloatArray) -> FloatArray:
    """Return a colour for each particle that shows its place on the mean shape, shape (N, 3).

    The same particle has the same colour on every shape, and neighbours look alike: a particle that
    strays stands out.

    Parameters
    ----------
    particles : (N, 3) array
        Mean particles [mm].
    """
    centred = particles - particles.mean(axis=0)
    _, _, axes = np.linalg.svd(centred, full_matrices=False)
    axes *= np.sign(axes[range(3), np.abs(axes).argmax(axis=1)])[:, None]
    place = (centred @ axes.T).argsort(axis=0).argsort(axis=0)
    return np.asarray(0.15 + 0.85 * (place + 1.0) / len(particles))
