"""Colours: maps and scales for numbers, particles by correspondence, schemes of the window and of pages."""

import colorsys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING

import numpy as np

from homolog.arrays import Array, BoolArray, FloatArray, frozen

if TYPE_CHECKING:  # scipy comes with it, and the command line's help needs colours
    from homolog.surfaces.mesh import TriangleMesh

__all__ = [
    "DARK",
    "DARK_SCHEME",
    "FAINT",
    "GREY",
    "LIGHT",
    "LIGHT_SCHEME",
    "ColourScale",
    "Colours",
    "Theme",
    "colours_by_place",
    "common_limit",
    "displacement_scale",
    "diverging_colours",
    "diverging_table",
    "outward_displacement",
    "page_colours",
    "rgb",
    "rgb_bytes",
    "structure_colour",
    "viridis",
]


@dataclass(frozen=True, slots=True)
class Colours:
    """Colours of surfaces, texts and groups of subjects, as ``#rrggbb``."""

    window: str
    surface: str
    raised: str
    sunken: str
    field: str
    zebra: str
    hover: str
    selected: str
    notice: str
    line: str
    text: str
    dim: str
    faint: str
    accent: str
    accent_hover: str
    on_accent: str
    danger: str
    warning: str
    scene: str
    bone: str
    raw: str
    mark: str
    cut: str
    groups: tuple[str, ...]


# Groups: Okabe and Ito (2008), darker on light and lighter on dark backgrounds for contrast.
LIGHT_SCHEME = Colours(
    window="#f3f4f6",
    surface="#fbfbfc",
    raised="#ffffff",
    sunken="#e9ebee",
    field="#ffffff",
    zebra="#f7f8f9",
    hover="#e6ecec",
    selected="#d3e9e7",
    notice="#fdf4dc",
    line="#d3d7dc",
    text="#1b1f24",
    dim="#59636e",
    faint="#9aa2ab",
    accent="#0a6f6a",
    accent_hover="#085a56",
    on_accent="#ffffff",
    danger="#b3261e",
    warning="#8a5a00",
    scene="#eef0f2",
    bone="#d9d4c8",
    raw="#d2b48c",
    mark="#1b1f24",
    cut="#b56a5c",
    groups=("#0068a3", "#b84e00", "#00795a", "#a8487f", "#2f7fae", "#8a6400", "#5f5f5f"),
)

DARK_SCHEME = Colours(
    window="#1c1f24",
    surface="#22262b",
    raised="#2b3036",
    sunken="#15171b",
    field="#1a1d21",
    zebra="#1e2126",
    hover="#333a41",
    selected="#194240",
    notice="#3a3322",
    line="#3b4149",
    text="#e7eaed",
    dim="#a3acb6",
    faint="#6b747e",
    accent="#35b8b0",
    accent_hover="#50cac2",
    on_accent="#06201f",
    danger="#ff8a80",
    warning="#f2b84b",
    scene="#121417",
    bone="#cdc6b6",
    raw="#bf9f74",
    mark="#d81b60",
    cut="#a65a4d",
    groups=("#56b4e9", "#f2864b", "#2fc79c", "#e08fc0", "#9ad2f2", "#f0c04a", "#b5b5b5"),
)


def rgb(colour: str) -> tuple[float, float, float]:
    """Return the parts of a ``#rrggbb`` in [0, 1]."""
    red, green, blue = (part / 255.0 for part in rgb_bytes(colour))
    return red, green, blue


def rgb_bytes(colour: str) -> tuple[int, int, int]:
    """Return the parts of a ``#rrggbb`` in 0 ... 255."""
    red, green, blue = (int(colour[at : at + 2], 16) for at in (1, 3, 5))
    return red, green, blue


@dataclass(frozen=True, slots=True)
class Theme:
    """Colours of everything but the data; red, green, blue in [0, 1], that of a cut in 0 ... 255."""

    background: tuple[float, float, float]
    text: tuple[float, float, float]
    surface: tuple[float, float, float]
    cut: tuple[int, int, int]


LIGHT = Theme(
    background=(1.0, 1.0, 1.0),
    text=(0.10, 0.10, 0.12),
    surface=rgb(LIGHT_SCHEME.bone),
    cut=rgb_bytes(LIGHT_SCHEME.cut),
)
"""Dark text on white, for print."""

DARK = Theme(
    background=(0.09, 0.10, 0.11),
    text=(0.91, 0.91, 0.92),
    surface=rgb(DARK_SCHEME.bone),
    cut=rgb_bytes(DARK_SCHEME.cut),
)
"""Light text on near black, for slides and the dark window."""


def page_colours(theme: Theme) -> Colours:
    """Return the colours of plots next to pictures of a theme."""
    ground, text = (
        f"#{''.join(f'{round(255 * part):02x}' for part in it)}" for it in (theme.background, theme.text)
    )
    return replace(DARK_SCHEME if theme is DARK else LIGHT_SCHEME, surface=ground, text=text)


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
        Value of the strongest colours [mm], on both sides of 0; values beyond it are clipped.
    """
    table = diverging_table()
    place = (np.clip(values / limit, -1.0, 1.0) + 1.0) / 2.0 * (len(table) - 1)
    columns = [np.interp(place, np.arange(len(table)), column) for column in table.T]
    return np.stack(columns, axis=1)


def structure_colour(place: int) -> tuple[int, int, int]:
    """Return red, green, blue of the structure at a place among several.

    Those of groups, half as strong, so that light and shade are seen.
    """
    bone, own = rgb_bytes(LIGHT_SCHEME.bone), rgb_bytes(LIGHT_SCHEME.groups[place % len(LIGHT_SCHEME.groups)])
    red, green, blue = ((a + b) // 2 for a, b in zip(bone, own, strict=True))
    return red, green, blue


def colours_by_place(mean: FloatArray) -> Array:
    """Return one colour for each particle, (N, 3) uint8, from its position on the mean shape.

    The angle about the shape's shortest axis determines the hue, and the height along that axis the
    lightness. Neighbours therefore have similar colours, and distant particles different ones.

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


FAINT = 0.35
"""Saturation factor of colours for differences within the limit."""
GREY = (150, 150, 150)
"""Colour of missing or ignored values: neutral, and not part of any scale."""

# Viridis (Smith and van der Walt 2015) at nine positions.
_VIRIDIS = np.array(
    [(68, 1, 84), (71, 44, 122), (59, 81, 139), (44, 113, 142), (33, 144, 141), (39, 173, 129),
     (92, 200, 99), (170, 220, 50), (253, 231, 37)], float,
)  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class ColourScale:
    """A map from numbers to colours.

    Attributes
    ----------
    title, unit : str
        Quantity, such as ``"Outward displacement"``, and unit, such as ``"mm"``.
    low, high : float
        Ends of the scale; values beyond them have the colours of the ends.
    table : (256, 3) uint8 array
        Colours from low to high.
    low_label, high_label : str
        Meaning of the ends, such as ``"into the tissue"`` and ``"out of the tissue"``.
    note : str
        A further remark, such as the scale of arrows.
    grey_label : str
        Meaning of grey, for a patch next to the scale; empty without grey.
    """

    title: str
    unit: str
    low: float
    high: float
    table: Array
    low_label: str = ""
    high_label: str = ""
    note: str = ""
    grey_label: str = ""

    def within(self, range_: tuple[float, float] | None) -> "ColourScale":
        """Return the scale with its ends set by hand, or unchanged without a range."""
        if range_ is None:
            return self
        note = " · ".join(part for part in (self.note, "range set by hand") if part)
        return replace(self, low=range_[0], high=range_[1], note=note)

    def colours(self, values: Array, faded: BoolArray | None = None, faint: BoolArray | None = None) -> Array:
        """Return (V, 3) uint8 colours of values (V,).

        Values marked in `faded` (V,) are grey; those in `faint` (V,) are as pale as values within a limit.
        """
        span = max(self.high - self.low, np.finfo(float).tiny)
        place = np.clip((values - self.low) * ((len(self.table) - 1) / span), 0, len(self.table) - 1)
        chosen = self.table[np.rint(place).astype(np.intp)]
        if faint is not None:
            middle = self.table[len(self.table) // 2]
            chosen[faint] = np.rint(middle + FAINT * (chosen[faint] - middle.astype(float)))
        if faded is not None and faded.any():
            chosen[faded] = GREY
        return chosen


def displacement_scale(
    limit: float, title: str = "Outward displacement", note: str = "", *, from_middle: bool = False
) -> ColourScale:
    """Return the blue-yellow scale of displacements, symmetric about 0.

    Parameters
    ----------
    limit : float
        End of the scale on both sides [mm]: blue at +limit is out of the tissue, yellow at -limit into it.
    title, note : str
        See `ColourScale`.
    from_middle : bool
        Whether blue means away from the centre of the shape.
    """
    table = np.rint(255.0 * diverging_table()).astype(np.uint8)
    centre, tissue = ("toward the centre", "away from the centre"), ("into the tissue", "out of the tissue")
    texts = centre if from_middle else tissue
    return ColourScale(title, "mm", -limit, limit, table, *texts, note)


def thickness_scale(limit: float, note: str = "") -> ColourScale:
    """Return the scale of differences of the wall's thickness, from -limit to limit [%]."""
    scale = displacement_scale(limit, "Thickness of the wall, relative to the expected one", note)
    return replace(scale, unit="%", low_label="thinner", high_label="thicker")


def viridis() -> Array:
    """Return a sequential colour map, (256, 3) uint8."""
    stops = np.linspace(0.0, 1.0, len(_VIRIDIS))
    fine = [np.interp(np.linspace(0.0, 1.0, 256), stops, channel) for channel in _VIRIDIS.T]
    table: Array = np.rint(np.stack(fine, axis=1)).astype(np.uint8)
    return table


_STEPS = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)


def outward_displacement(mesh: "TriangleMesh", displacement: FloatArray) -> FloatArray:
    """Return the part of a displacement (V, 3) along the outward normals [mm], shape (V,)."""
    return np.asarray((displacement * mesh.vertex_normals).sum(axis=1))


def common_limit(values: Sequence[FloatArray]) -> float:
    """Return a round value [mm] that exceeds 99 % of the values."""
    reach = float(np.percentile(np.abs(np.concatenate(values)), 99.0))
    if reach <= 0.0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(reach))
    return float(next(step for step in _STEPS if step * power >= 0.99 * reach) * power)
