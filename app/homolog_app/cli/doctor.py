"""What this machine offers, with the remedy for what is missing: ``homolog doctor``."""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

from homolog_app.cli.options import command, write_lines

__all__ = ["run_doctor"]

_GIB = 2**30
_SECONDS = 60
"""Time after which a probe in its own process counts as hung."""
_QT = """
import ctypes, sys
from PySide6 import QtWidgets
from PySide6.QtCore import QLibraryInfo
if sys.platform == "linux":  # the libraries of the display are loaded with the first window only
    ctypes.CDLL(QLibraryInfo.path(QLibraryInfo.LibraryPath.PluginsPath) + "/platforms/libqxcb.so")
"""
_OPENGL = """
import pyvista
plotter = pyvista.Plotter(off_screen=True, window_size=(16, 16))
plotter.add_mesh(pyvista.Sphere())
plotter.screenshot()
print(pyvista.GPUInfo().renderer)
"""
_KERNELS = "from homolog.geodesics.cpu.solver import load_kernels; load_kernels()"
_CACHE = "set WARP_CACHE_PATH to a folder with free space that you may write to"


class Finding(NamedTuple):
    """A line of the answer: what was looked at, the answer, and the remedy (empty if all is well)."""

    name: str
    answer: str
    remedy: str = ""


@command(
    "Show what this machine offers: cores, memory, GPU, compiler of kernels, OpenGL, Qt's "
    "libraries, disk. A line each, with the remedy for what is missing. Exit code 2 if something is."
)
def run_doctor(_arguments: argparse.Namespace) -> int:
    """Print a line for each part of the machine; returns 2 if one has a remedy."""
    findings = [examine() for examine in (_cores, _memory, _gpu, _kernels, _opengl, _qt, _disk)]
    write_lines(
        *(f"{name:<8}{'; '.join(filter(None, (answer, remedy)))}" for name, answer, remedy in findings)
    )
    return 2 if any(finding.remedy for finding in findings) else 0


def _cores() -> Finding:
    from homolog.threads import cores

    return Finding("cores", str(cores()))


def _memory() -> Finding:
    import psutil

    from homolog.memory import free_memory

    total = psutil.virtual_memory().total
    return Finding("memory", f"{free_memory() / _GIB:.1f} of {total / _GIB:.1f} GiB free for this program")


def _gpu() -> Finding:
    try:
        from homolog.device import choose_device, describe_device
    except OSError as error:  # Warp makes its folder of kernels
        return Finding("GPU", f"not seen ({error})", _CACHE)

    device = choose_device()
    if device != "cpu":
        return Finding("GPU", describe_device(device))
    if Path("/proc/driver/nvidia").exists() or shutil.which("nvidia-smi"):
        remedy = "update the driver, and see that CUDA_VISIBLE_DEVICES does not hide it; runs use the CPU"
        return Finding("GPU", "an NVIDIA driver is installed, but CUDA sees no GPU", remedy)
    return Finding("GPU", "none from NVIDIA; runs use the CPU")


def _kernels() -> Finding:
    return _probed("kernels", _KERNELS, "compile", "do not compile", _CACHE)


def _opengl() -> Finding:
    remedy = "the window needs it: apt install libgl1 libegl1"
    return _probed("OpenGL", _OPENGL, "draws", "does not draw", remedy)


def _qt() -> Finding:
    remedy = "the window needs it: apt install libegl1 libxkbcommon-x11-0 libxcb-cursor0 libdbus-1-3"
    return _probed("Qt", _QT, "loads", "does not load", remedy)


def _disk() -> Finding:
    """Return the free space in the current folder, where projects go, and in that of temporary files."""
    places = dict.fromkeys([Path.cwd(), Path(tempfile.gettempdir())])
    free = ", ".join(f"{shutil.disk_usage(place).free / _GIB:.1f} GiB free in {place}" for place in places)
    closed = [str(place) for place in places if not os.access(place, os.W_OK)]
    return Finding("disk", free, f"you may not write to {' and '.join(closed)}" if closed else "")


def _probed(name: str, program: str, works: str, fails: str, remedy: str) -> Finding:
    """Return what a program that may crash finds, in a process of its own."""
    try:
        done = subprocess.run(
            [sys.executable, "-c", program], capture_output=True, text=True, timeout=_SECONDS, check=False
        )
    except subprocess.TimeoutExpired:
        return Finding(name, f"{fails} (no answer in {_SECONDS} s)", remedy)
    said = done.stdout.strip()
    if done.returncode == 0:
        return Finding(name, f"{works} ({said})" if said else works)
    lines = done.stderr.strip().splitlines()
    if "ModuleNotFoundError" in done.stderr:
        return Finding(name, "not installed; only the window needs it")
    fault = lines[-1] if lines and done.returncode > 0 else f"the process ended with {done.returncode}"
    return Finding(name, f"{fails} ({fault})", remedy)
