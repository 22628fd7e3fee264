"""Pictures of scenes without a display, and functions that need OpenGL, in a process of their own."""

import os
import sys
import threading
from collections.abc import Callable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from homolog.errors import InputError
from homolog.workers import worker_processes
from homolog_app.rendering.camera import Frame
from homolog_app.rendering.scene import Scene

__all__ = ["draw", "with_opengl"]

PATIENCE_S = 120.0
"""Time within which a working driver starts [s]."""

_T = TypeVar("_T")
_LOCK = threading.Lock()


def draw(scene: Scene, frame: Frame, width: int) -> NDArray[np.uint8]:
    """Draw a scene in parallel projection, in software: alike on every machine, and as fast as needed.

    Parameters
    ----------
    scene : Scene
    frame : Frame
        The part of the world to show.
    width : int
        Width in pixels, which are square.

    Returns
    -------
    image : (height, width, 4) uint8 array
        Red, green, blue, opacity, the first row on top; empty pixels are transparent.
    """
    from homolog_app.rendering.rays import Software  # loads Warp

    with _LOCK:
        return Software().draw(scene, frame, width)


def with_opengl(function: Callable[..., _T], *arguments: object) -> _T:
    """Call a function of a module in a process with OpenGL, which VTK ends where there is none.

    Raises
    ------
    InputError
        If there is no OpenGL.
    """
    try:
        with worker_processes(1, fresh=True) as executor:
            executor.submit(begin).result(PATIENCE_S)
            return executor.submit(function, *arguments).result()
    except (RuntimeError, ImportError, TimeoutError) as error:  # BrokenProcessPool is a RuntimeError
        raise InputError(
            "no OpenGL was found; install a graphics driver, or Mesa (libegl1 and libgl1-mesa-dri)"
        ) from error


def begin() -> None:
    """Start VTK in a new process, which prints nothing of its own."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.__stderr__.fileno() if sys.__stderr__ else 2)
    from homolog_app.rendering.opengl import need_no_display

    need_no_display()
    from vtkmodules.vtkRenderingCore import vtkRenderWindow

    window = vtkRenderWindow()
    window.SetOffScreenRendering(True)
    window.Render()
