"""A sphere to make shapes of, and films decoded again."""

import re
import subprocess

import numpy as np
import pytest
from scipy.spatial import ConvexHull


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
def unit_sphere():
    """Return a function that spreads points evenly on the unit sphere: (n, 3) points and outward faces."""

    def spread(count):
        index = np.arange(count)
        height = 1.0 - (2.0 * index + 1.0) / count
        turn = np.pi * (1.0 + 5**0.5) * index
        radius = np.sqrt(1.0 - height**2)
        points = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), height])
        faces = ConvexHull(points).simplices.copy()
        corners = points[faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        inward = np.einsum("fi,fi->f", normals, corners.mean(axis=1)) < 0
        faces[inward] = faces[inward][:, ::-1]
        return points, faces

    return spread
