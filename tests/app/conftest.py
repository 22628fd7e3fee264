"""A sphere to make shapes of, and films decoded again."""

import re
import subprocess

import numpy as np
import pytest
from skimage.measure import marching_cubes

from homolog.surfaces.mesh import TriangleMesh


@pytest.fixture(scope="session")
def decode():
    """Return a function that decodes a film: what FFmpeg says of it, and its frames (n, height, width, 3)."""
    from imageio_ffmpeg import get_ffmpeg_exe

    def decoded(path):
        raw = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-fps_mode", "passthrough", "-"]
        done = subprocess.run([get_ffmpeg_exe(), "-i", str(path), *raw], capture_output=True, check=True)
        facts = done.stderr.decode()
        width, height = map(int, re.search(r"Video: .* (\d+)x(\d+)", facts).groups())
        return facts, np.frombuffer(done.stdout, np.uint8).reshape(-1, height, width, 3).astype(int)

    return decoded


@pytest.fixture(scope="session")
def ball():
    """A sphere of radius 10 mm around (1, 2, 3)."""
    grid = np.stack(np.meshgrid(*[np.arange(-12.0, 13.0)] * 3, indexing="ij"), axis=-1)
    vertices, faces, _, _ = marching_cubes(
        np.linalg.norm(grid - 0.3, axis=-1) - 10.0, 0.0, gradient_direction="ascent"
    )
    mesh = TriangleMesh(vertices - 12.3 + [1.0, 2.0, 3.0], faces)
    return mesh if mesh.volume > 0 else TriangleMesh(mesh.vertices, mesh.faces[:, ::-1])


@pytest.fixture
def without_figures(monkeypatch):
    """Let reports have no figures and no PDF: drawing them takes most of the time."""
    for figures in ("model_figures", "study_figures"):
        monkeypatch.setattr(f"homolog_app.report.write.{figures}", lambda *_: [])
    monkeypatch.setattr("homolog_app.report.write.write_page", lambda *_: None)
