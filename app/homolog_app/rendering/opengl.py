"""VTK's windows off screen, with the machine's OpenGL."""

import os
import sys
from typing import Any

import numpy as np
import pyvista as pv
from numpy.typing import NDArray
from vtkmodules.vtkCommonCore import vtkUnsignedCharArray  # a screenshot by pyvista loses the opacity

__all__ = ["SMOOTH", "need_no_display", "pixels_of"]

SMOOTH = 8
"""Number of samples per pixel, for smooth edges."""


def need_no_display() -> None:
    """Let VTK use EGL without a display; call before its first window."""
    if sys.platform.startswith("linux") and not os.environ.get("DISPLAY"):
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")


def pixels_of(window: Any) -> NDArray[np.uint8]:  # noqa: ANN401 - VTK is untyped
    """Return the pixels of a VTK window, (height, width, 4), the first row on top."""
    width, height = window.GetSize()
    held = vtkUnsignedCharArray()
    window.GetRGBACharPixelData(0, 0, width - 1, height - 1, 0, held)
    return np.array(pv.convert_array(held).reshape(height, width, 4)[::-1])
