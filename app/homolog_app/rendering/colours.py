"""Colours: the paper's blue-yellow map, stable colours by correspondence, light and dark themes."""

import colorsys
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files

import numpy as np

from homolog.arrays import Array, FloatArray, frozen
from homolog_app import scheme
from homolog_app.scheme import Colours

__all__ = [
    "DARK", "LIGHT", "Theme", "colours_by_place", "diverging_colours", "diverging_table", "page_colours",
]  # fmt: skip


@dataclass(frozen=True, slots=True)
class Theme:
    """Colours of everything but the data; red, green, blue in [0, 1], of a cut 0 ... 255."""

    background: tuple[float, float, float]
    text: tuple[float, float, float]
    surface: tuple[float, float, float]
    cut: tuple[int, int, int]


LIGHT = Theme(
    background=(1.0, 1.0, 1.0),
    text=(0.10, 0.10, 0.12),
    surface=scheme.rgb(scheme.LIGHT.bone),
    cut=scheme.rgb_bytes(scheme.LIGHT.cut),
)
"""Dark text on white, for print."""

DARK = Theme(
    background=(0.09, 0.10, 0.11),
    text=(0.91, 0.91, 0.92),
    surface=scheme.rgb(scheme.DARK.bone),
    cut=scheme.rgb_bytes(scheme.DARK.cut),
)
"""Light text on near black, for slides and the dark window."""


def page_colours(theme: Theme) -> Colours:
    """Return the colours of plots that stand beside pictures of a theme."""
    ground, text = (
        f"#{''.join(f'{round(255 * part):02x}' for part in it)}" for it in (theme.background, theme.text)
    )
    return replace(scheme.DARK if theme is DARK else scheme.LIGHT, surface=ground, text=text)


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


def colours_by_place(mean: FloatArray) -> Array:
    """Return one colour for each particle, (N, 3) uint8, from its place on the mean shape.

    The angle about the shape's shortest axis gives the hue, the height along that axis the lightness, so that
    neighbours look alike and places far apart differ.

    Parameters
    ----------
    mean : (N, 3) array
        Mean of the corresponding particles [mm].
    """
    centred = np.asarray(mean, dtype=np.float64) - np.mean(mean, axis=0)
    if len(centred) < 3:
        return frozen(np.full((len(centred), 3), (60, 140, 220)), np.uint8)
    _, _, axes = np.linalg.svd(centred, full_matrices=False)
    axes *= np.where(axes[np.arange(3), np.abs(axes).argmax(axis=1)] < 0, -1.0, 1.0)[:, None]
    along = centred @ axes.T
    along /= np.maximum(np.abs(along).max(axis=0), 1e-12)
    hue = np.arctan2(along[:, 1], along[:, 0]) / (2 * np.pi) % 1.0
    lightness = 0.45 + 0.13 * along[:, 2]
    rgb = [colorsys.hls_to_rgb(h, level, 0.75) for h, level in zip(hue, lightness, strict=True)]
    return frozen(np.rint(255 * np.array(rgb)), np.uint8)
