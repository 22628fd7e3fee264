"""A sphere to make shapes of, and films decoded again."""

import re
import subprocess

import numpy as np
import pytest


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
