"""Choice of the renderer, once per process: VTK with OpenGL, or software."""

import atexit
import logging
import os
import sys
import threading
from collections.abc import Callable
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from homolog.errors import InputError
from homolog.workers import worker_processes
from homolog_app.rendering.camera import Frame
from homolog_app.rendering.scene import Scene

__all__ = ["RENDERER", "draw", "renderer_name", "start_renderer", "with_opengl"]

RENDERER = "HOMOLOG_RENDERER"
"""Environment variable that selects the renderer: ``opengl`` or ``software``."""

_NO_OPENGL = "no OpenGL was found; install a graphics driver, or Mesa (libegl1 and libgl1-mesa-dri)"
_EMULATED = ("llvmpipe", "softpipe", "swrast")
"""Names of Mesa's OpenGL without a graphics card, which is half as fast as the software renderer."""
PATIENCE_S = 120.0
"""Time within which a working driver starts [s]."""

_FAULTS = (RuntimeError, ImportError, TimeoutError)
"""Errors of a process that starts OpenGL; `BrokenProcessPool` is a RuntimeError."""
_CARDS = ("dri/card*", "dri/renderD*", "nvidia[0-9]*", "dxg")
"""Devices of graphics cards on Linux; the last one is that of WSL on Windows."""

_log = logging.getLogger(__name__)

_T = TypeVar("_T")
_WANTED = ("", "opengl", "software")


class _Drawer(Protocol):
    name: str

    def draw(self, scene: Scene, frame: Frame, width: int) -> NDArray[np.uint8]: ...


def draw(scene: Scene, frame: Frame, width: int) -> NDArray[np.uint8]:
    """Draw a scene in parallel projection.

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
    return CHOICE.draw(scene, frame, width)


def start_renderer() -> None:
    """Choose and start the renderer in advance; errors are raised with the first picture."""
    with suppress(InputError):
        _ = CHOICE.name


def with_opengl(function: Callable[..., _T], *arguments: object) -> _T:
    """Call a function of a module in the process with OpenGL and return its result.

    Raises
    ------
    InputError
        If there is no OpenGL.
    """
    return CHOICE.with_opengl(function, *arguments)


def renderer_name() -> str:
    """Return the name of the renderer."""
    return CHOICE.name


class RendererChoice:
    """The renderer of this process, chosen with the first picture; other threads wait."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._drawer: _Drawer | None = None
        self._emulated: OpenGLProcess | None = None  # started only for functions that need OpenGL

    @property
    def name(self) -> str:
        with self._lock:
            return self._chosen().name

    def draw(self, scene: Scene, frame: Frame, width: int) -> NDArray[np.uint8]:
        with self._lock:
            try:
                return self._chosen().draw(scene, frame, width)
            except BrokenProcessPool:  # a driver that ended its process
                _log.warning("the graphics driver failed; further pictures are drawn by software")
                self._drawer = _software()
                return self._drawer.draw(scene, frame, width)

    def with_opengl(self, function: Callable[..., _T], *arguments: object) -> _T:
        try:
            with self._lock:
                return self._process().call(function, *arguments)
        except _FAULTS as error:
            raise InputError(_NO_OPENGL) from error

    def _process(self) -> "OpenGLProcess":
        drawer = self._chosen()
        if isinstance(drawer, OpenGLProcess):
            return drawer
        if os.environ.get(RENDERER) == "software":
            raise InputError(_NO_OPENGL)
        self._emulated = self._emulated or OpenGLProcess()
        return self._emulated

    def _chosen(self) -> _Drawer:
        if self._drawer is None:
            choice = os.environ.get(RENDERER, "")
            if choice not in _WANTED:
                raise InputError(f"{RENDERER}={choice}: use {' or '.join(filter(None, _WANTED))}")
            needed = choice == "opengl"
            uses_opengl = needed or (choice != "software" and may_have_graphics_card())
            self._drawer = self._opengl(needed) if uses_opengl else _software()
        return self._drawer

    def _opengl(self, needed: bool) -> _Drawer:
        try:
            return OpenGLProcess(draws_emulated=needed)
        except _FAULTS as error:
            if needed:
                raise InputError(f"{RENDERER}=opengl: this machine has no working OpenGL") from error
            return _software()


class OpenGLProcess:
    """VTK in a separate process, because it terminates its process without OpenGL and is single-threaded.

    Parameters
    ----------
    draws_emulated : bool
        Whether to draw with OpenGL even if it is emulated and slow; otherwise pictures are then drawn by
        software.
    """

    def __init__(self, *, draws_emulated: bool = True) -> None:
        stack = ExitStack()
        atexit.register(stack.close)
        self._executor = stack.enter_context(worker_processes(1, fresh=True))
        try:
            card = self._executor.submit(begin).result(PATIENCE_S)
        except TimeoutError:
            stack.close()  # otherwise this program would wait for that process at its end
            raise
        self._software = None if draws_emulated or card not in _EMULATED else _software()
        self.name = f"OpenGL ({card})" if self._software is None else self._software.name

    def draw(self, scene: Scene, frame: Frame, width: int) -> NDArray[np.uint8]:
        if self._software is not None:
            return self._software.draw(scene, frame, width)
        return self.call(_draw, scene, frame, width)

    def call(self, function: Callable[..., _T], *arguments: object) -> _T:
        return self._executor.submit(function, *arguments).result()


def begin() -> str:
    from homolog_app.rendering import opengl

    return opengl.begin()


def _draw(scene: Scene, frame: Frame, width: int) -> NDArray[np.uint8]:
    from homolog_app.rendering import opengl

    return opengl.draw(scene, frame, width)


def may_have_graphics_card() -> bool:
    """Return False if OpenGL can only be emulated, which saves starting a process that loads VTK."""
    return sys.platform != "linux" or any(any(Path("/dev").glob(card)) for card in _CARDS)


def _software() -> _Drawer:
    from homolog_app.rendering.rays import Software

    return Software()


CHOICE = RendererChoice()
