"""The colours of the light and the dark scheme, for the window and for plots; knows no Qt."""

from dataclasses import dataclass

__all__ = ["DARK", "LIGHT", "Colours", "rgb", "rgb_bytes"]


@dataclass(frozen=True, slots=True)
class Colours:
    """What each surface, text and group of subjects is painted with, as ``#rrggbb``."""

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


# Groups: Okabe and Ito (2008), darker on light ground and lighter on dark ground for contrast.
LIGHT = Colours(
    window="#f3f4f6", surface="#fbfbfc", raised="#ffffff", sunken="#e9ebee", field="#ffffff", zebra="#f7f8f9",
    hover="#e6ecec", selected="#d3e9e7", notice="#fdf4dc", line="#d3d7dc", text="#1b1f24", dim="#59636e",
    faint="#9aa2ab", accent="#0a6f6a", accent_hover="#085a56", on_accent="#ffffff", danger="#b3261e",
    warning="#8a5a00", scene="#eef0f2", bone="#d9d4c8", raw="#d2b48c",
    mark="#1b1f24", cut="#b56a5c",
    groups=("#0068a3", "#b84e00", "#00795a", "#a8487f", "#2f7fae", "#8a6400", "#5f5f5f"),
)  # fmt: skip

DARK = Colours(
    window="#1c1f24", surface="#22262b", raised="#2b3036", sunken="#15171b", field="#1a1d21", zebra="#1e2126",
    hover="#333a41", selected="#194240", notice="#3a3322", line="#3b4149", text="#e7eaed", dim="#a3acb6",
    faint="#6b747e", accent="#35b8b0", accent_hover="#50cac2", on_accent="#06201f", danger="#ff8a80",
    warning="#f2b84b", scene="#121417", bone="#cdc6b6", raw="#bf9f74",
    mark="#d81b60", cut="#a65a4d",
    groups=("#56b4e9", "#f2864b", "#2fc79c", "#e08fc0", "#9ad2f2", "#f0c04a", "#b5b5b5"),
)  # fmt: skip


def rgb(colour: str) -> tuple[float, float, float]:
    """Return the parts of a ``#rrggbb`` in [0, 1]."""
    red, green, blue = (part / 255.0 for part in rgb_bytes(colour))
    return red, green, blue


def rgb_bytes(colour: str) -> tuple[int, int, int]:
    """Return the parts of a ``#rrggbb`` in 0 ... 255."""
    red, green, blue = (int(colour[at : at + 2], 16) for at in (1, 3, 5))
    return red, green, blue
