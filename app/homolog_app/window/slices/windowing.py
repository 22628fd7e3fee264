"""Which grey values are black and which white. Knows no Qt."""

from dataclasses import dataclass

import numpy as np

from homolog.arrays import Array, Float32Array
from homolog.grooming.scans import Scan

__all__ = ["AUTOMATIC", "PRESETS", "GreyWindow", "first_preset"]

AUTOMATIC = "Automatic"
_CT_AIR = -500.0
"""Only CT has grey values this low in much of a scan."""


@dataclass(frozen=True, slots=True)
class GreyWindow:
    """Grey values around a level: its width below and above, from black to white."""

    width: float
    level: float

    @classmethod
    def between(cls, low: float, high: float) -> "GreyWindow":
        """Return the window from black to white."""
        return cls(high - low, 0.5 * (low + high))

    def dragged(self, right: float, down: float) -> "GreyWindow":
        """Return the window after a drag: wider to the right, darker downwards (parts of the widget)."""
        return GreyWindow(max(self.width * float(np.exp(2.0 * right)), 1e-6), self.level + self.width * down)

    def shades(self, values: Float32Array) -> Array:
        """Return grey values as uint8 from black to white."""
        low = self.level - 0.5 * self.width
        scaled = np.clip((values - low) * (255.0 / self.width), 0.0, 255.0)
        return np.asarray(np.nan_to_num(scaled).astype(np.uint8))


PRESETS = {
    "CT bone": GreyWindow(1800.0, 400.0),
    "CT soft tissue": GreyWindow(400.0, 40.0),
    "CT lung": GreyWindow(1500.0, -600.0),
    "CT brain": GreyWindow(80.0, 40.0),
}
"""Usual windows of CT [HU]; MR has no units, so that its window follows from the scan (`AUTOMATIC`)."""


def first_preset(scan: Scan) -> str:
    """Return the window that a scan is shown with at first: soft tissue if it looks like CT."""
    low = scan.values[:: max(1, len(scan.values) // 16)].min() * scan.slope + scan.intercept
    return "CT soft tissue" if low <= _CT_AIR else AUTOMATIC
