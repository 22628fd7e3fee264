"""The views as a picture of any size, drawn aside: the same on a screen, without one, and from a command."""

import sys
from typing import Any

import numpy as np
import vtkmodules.vtkRenderingFreeType
import vtkmodules.vtkRenderingOpenGL2  # noqa: F401 - loads what draws
from numpy.typing import NDArray
from vtkmodules.vtkRenderingCore import vtkRenderer, vtkRenderWindow

from homolog_app.rendering.opengl import SMOOTH, need_no_display, pixels_of
from homolog_app.rendering.scheme import DARK, LIGHT
from homolog_app.window.scene.canvas import Canvas
from homolog_app.window.scene.colour_scale_picture import scale_picture
from homolog_app.window.scene.content import ViewContents
from homolog_app.window.scene.grid import MOST, Grid

__all__ = ["drawn"]


def drawn(
    shown: ViewContents, canvas: Canvas, scale: int = 1, *, transparent: bool = False
) -> NDArray[np.uint8]:
    """Draw the views.

    Parameters
    ----------
    shown : Shown
        With its particles.
    canvas : Canvas
        How they are looked at.
    scale : int
        How many times as large as on the screen.
    transparent : bool
        Whether there is no background.

    Returns
    -------
    (height, width, 4) uint8 array
        Red, green, blue, opacity; the colour scale, if there is one, at the lower edge.
    """
    need_no_display()
    _release_context_of_qt()
    colours = DARK if canvas.scheme == "dark" else LIGHT
    ratio = scale * canvas.ratio
    window: Any = vtkRenderWindow()
    window.SetOffScreenRendering(True)
    window.SetMultiSamples(SMOOTH)
    window.SetAlphaBitPlanes(True)
    window.SetNumberOfLayers(1)
    window.SetSize(round(canvas.width * ratio), round(canvas.height * ratio))
    grid = Grid(window, [vtkRenderer() for _ in range(MOST)])
    grid.ratio, grid.text, grid.layout = ratio, canvas.text, canvas.layout
    grid.raw, grid.groomed, grid.balls = canvas.raw, canvas.groomed, canvas.particles
    grid.letters, grid.scale_bar = canvas.letters, canvas.scale_bar
    grid.opacity, grid.clip = canvas.opacity, canvas.clip
    grid.paint(colours)
    grid.show_backdrop(not transparent)
    grid.take(shown)
    _look(grid, canvas)
    grid.show_page(canvas.page)
    window.Render()
    pixels = pixels_of(window)
    grid.close()
    window.Finalize()
    if not transparent:
        pixels[..., 3] = 255
    if shown.scale is not None:
        strip = scale_picture(
            shown.scale, colours, pixels.shape[1], ratio * canvas.text, transparent=transparent
        )
        pixels = np.concatenate([pixels, strip])
    return pixels


def _release_context_of_qt() -> None:
    """Let Qt know that its context won't be current any more, if this process has windows of Qt.

    VTK makes its own context the thread's without telling. Qt would go on to believe that that of the views
    were current, and free objects of OpenGL in none or in another one, when a window is deleted.
    """
    gui = sys.modules.get("PySide6.QtGui")
    context = gui.QOpenGLContext.currentContext() if gui is not None else None
    if context is not None:
        context.doneCurrent()


def _look(grid: Grid, canvas: Canvas) -> None:
    if len(canvas.cameras) > 1:
        grid.cameras.link(False)
    for camera, state in zip(grid.cameras.each, canvas.cameras, strict=False):
        state.set(camera)
    if not canvas.cameras:
        grid.show_page(canvas.page)  # there must be something to look at
        grid.cameras.turn("corner")
        grid.fit(canvas.width, canvas.height)
