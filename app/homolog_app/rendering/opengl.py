"""Scenes drawn off screen by pyvista, with the machine's OpenGL, in a separate process.

VTK terminates its process without OpenGL, and does not support several threads.
"""

import os
import sys
from functools import cache
from typing import Any

import numpy as np
import pyvista as pv
from numpy.typing import NDArray
from vtkmodules.vtkCommonCore import vtkUnsignedCharArray  # a screenshot by pyvista loses the opacity

from homolog_app.rendering.actors import RoundBalls, SceneActors
from homolog_app.rendering.camera import VIEWS, Frame
from homolog_app.rendering.scene import Balls, Scene

__all__ = ["SMOOTH", "begin", "draw", "need_no_display", "pixels_of", "straight"]

SMOOTH = 8
"""Number of samples per pixel, for smooth edges."""


def begin() -> str:
    """Return the OpenGL renderer of a new process, such as ``"llvmpipe"``; VTK ends one without OpenGL.

    Raises
    ------
    RuntimeError
        If a test picture is empty.
    """
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.__stderr__.fileno() if sys.__stderr__ else 2)
    need_no_display()
    ball = Balls(np.zeros((1, 3)), 1.0, np.array([255, 0, 0], np.uint8))
    seen = draw(Scene((), ball), Frame(VIEWS["anterior"], (0.0, 0.0, 0.0), 2.0, 2.0, 2.0), 9)
    if not seen[4, 4, 0] > 100:
        raise RuntimeError("nothing was drawn")
    facts = dict(
        line.split(":", 1) for line in _plotter().ren_win.ReportCapabilities().splitlines() if ":" in line
    )
    return str(facts.get("OpenGL renderer string", "OpenGL")).split("(")[0].strip()


def need_no_display() -> None:
    """Let VTK use EGL without a display; call before its first window."""
    if sys.platform.startswith("linux") and not os.environ.get("DISPLAY"):
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")


def draw(scene: Scene, frame: Frame, width: int) -> NDArray[np.uint8]:
    """Draw a scene: see `homolog_app.rendering.draw.draw`."""
    plotter = _plotter()
    height = max(round(frame.height * width / frame.width), 1)
    plotter.window_size = [width, height]
    _actors().show(scene)
    _, up, back = frame.view.axes
    reach = frame.depth + frame.width + frame.height
    camera = plotter.camera
    camera.SetFocalPoint(*frame.centre)
    camera.SetPosition(*(np.array(frame.centre) + reach * back))
    camera.SetViewUp(*up)
    camera.SetParallelScale(height * frame.width / width / 2.0)
    camera.SetClippingRange(0.01 * reach, 2.0 * reach)
    plotter.ren_win.Render()
    return straight(pixels_of(plotter.ren_win))


def pixels_of(window: Any) -> NDArray[np.uint8]:  # noqa: ANN401 - VTK is untyped
    """Return the pixels of a VTK window, (height, width, 4), the first row on top."""
    width, height = window.GetSize()
    held = vtkUnsignedCharArray()
    window.GetRGBACharPixelData(0, 0, width - 1, height - 1, 0, held)
    return np.array(pv.convert_array(held).reshape(height, width, 4)[::-1])


def straight(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return pixels drawn on transparent black with straight instead of premultiplied colours."""
    edge = (pixels[..., 3] > 0) & (pixels[..., 3] < 255)
    result = pixels.copy()
    result[edge, :3] = np.minimum(np.rint(pixels[edge, :3] * (255.0 / pixels[edge, 3:])), 255.0)
    return result


@cache
def _plotter() -> pv.Plotter:
    plotter = pv.Plotter(off_screen=True, lighting="none", window_size=[8, 8])
    plotter.ren_win.SetMultiSamples(SMOOTH)
    plotter.ren_win.SetAlphaBitPlanes(True)
    plotter.enable_parallel_projection()
    plotter.renderer.SetBackground(0.0, 0.0, 0.0)
    plotter.renderer.SetBackgroundAlpha(0.0)
    return plotter


@cache
def _actors() -> SceneActors:
    return SceneActors(_plotter().renderer, RoundBalls())
