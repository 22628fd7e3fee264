"""What this machine offers, with the remedy for what is missing: ``homolog doctor``."""

import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

__all__ = ["add_doctor", "run_doctor"]

_GIB = 2**30
_SECONDS = 60
"""Time after which a probe in its own process counts as hung."""
_QT = "import PySide6.QtWidgets"
_OPENGL = """
import pyvista
plotter = pyvista.Plotter(off_screen=True, window_size=(16, 16))
plotter.add_mesh(pyvista.Sphere())
plotter.screenshot()
"""


class Finding(NamedTuple):
    """A line of the answer: what was looked at, the answer, and the remedy (empty if all is well)."""

    name: str
    answer: str
    remedy: str = ""


def add_doctor(subparsers: Any) -> None:  # noqa: ANN401 - argparse keeps the type private
    """Declare the command."""
    subparsers.add_parser(
        "doctor",
        description="Show what this machine offers: cores, memory, GPU, OpenGL, Qt's libraries, disk. "
        "A line each, with the remedy for what is missing. Exit code 2 if something is.",
    )


def run_doctor(_arguments: argparse.Namespace) -> int:
    """Print a line for each part of the machine; returns 2 if one has a remedy."""
    findings = [examine() for examine in (_cores, _memory, _gpu, _opengl, _qt, _disk)]
    for finding in findings:
        remedy = f"; {finding.remedy}" if finding.remedy else ""
        sys.stdout.write(f"{finding.name:<8}{finding.answer}{remedy}\n")
    return 2 if any(finding.remedy for finding in findings) else 0


def _cores() -> Finding:
    from homolog.threads import cores

    return Finding("cores", str(cores()))


def _memory() -> Finding:
    import psutil

    memory = psutil.virtual_memory()
    return Finding("memory", f"{memory.available / _GIB:.1f} of {memory.total / _GIB:.1f} GiB free")


def _gpu() -> Finding:
    from homolog.device import choose_device, describe_device

    device = choose_device()
    return Finding(
        "GPU", "none that CUDA sees; runs use the CPU" if device == "cpu" else describe_device(device)
    )


def _opengl() -> Finding:
    fault = _fault_of(_OPENGL)
    remedy = "install OpenGL: apt install libgl1 libegl1, or start under xvfb-run"
    return (
        Finding("OpenGL", "works") if fault is None else Finding("OpenGL", f"does not draw ({fault})", remedy)
    )


def _qt() -> Finding:
    fault = _fault_of(_QT)
    remedy = "the window needs it: apt install libegl1 libxkbcommon-x11-0 libxcb-cursor0 libdbus-1-3"
    return Finding("Qt", "loads") if fault is None else Finding("Qt", f"does not load ({fault})", remedy)


def _disk() -> Finding:
    """Return the free space in the current folder, where projects go, and in that of temporary files."""
    free = [
        (place, shutil.disk_usage(place).free / _GIB) for place in (Path.cwd(), Path(tempfile.gettempdir()))
    ]
    return Finding("disk", ", ".join(f"{space:.1f} GiB free in {place}" for place, space in free))


def _fault_of(program: str) -> str | None:
    """Run a program in a process that may crash; returns its last line of errors, None if it works."""
    try:
        done = subprocess.run(
            [sys.executable, "-c", program], capture_output=True, text=True, timeout=_SECONDS, check=False
        )
    except subprocess.TimeoutExpired:
        return f"no answer in {_SECONDS} s"
    if done.returncode == 0:
        return None
    lines = done.stderr.strip().splitlines()
    return lines[-1] if lines and done.returncode > 0 else f"the process ended with {done.returncode}"
