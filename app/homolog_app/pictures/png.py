"""PNG files, written faster than by general libraries, which try five filters for each row of pixels.

After *Portable Network Graphics Specification* (W3C). Pictures of shapes on an even background are as small
with one filter, the difference from the row above, and run-length encoding.
"""

import struct
import zlib

import numpy as np
from numpy.typing import NDArray

__all__ = ["png_of"]

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_UP = 2
"""The filter that subtracts the row above."""
_RGB, _RGBA = 2, 6
"""Types of colours."""
_INCH_M = 0.0254


def png_of(pixels: NDArray[np.uint8], dots_per_inch: float) -> bytes:
    """Return a picture as the content of a PNG file.

    Parameters
    ----------
    pixels : (H, W, 4) uint8 array
        Red, green, blue, opacity. The opacity is left out if all pixels are opaque.
    dots_per_inch : float
        Resolution of the printed picture.
    """
    height, width = pixels.shape[:2]
    together = np.bitwise_and.reduce(np.ascontiguousarray(pixels).view(np.uint32), axis=None)
    opaque = together.tobytes()[3] == 255  # ten times as fast as looking at every fourth byte
    flat = np.ascontiguousarray(pixels[..., :3] if opaque else pixels).reshape(height, -1)
    rows = np.empty((height, 1 + flat.shape[1]), np.uint8)
    rows[:, 0] = _UP
    rows[0, 1:] = flat[0]
    np.subtract(flat[1:], flat[:-1], out=rows[1:, 1:])
    deflate = zlib.compressobj(1, strategy=zlib.Z_RLE)
    per_metre = round(dots_per_inch / _INCH_M)
    return b"".join(
        [
            _SIGNATURE,
            _chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, _RGB if opaque else _RGBA, 0, 0, 0)),
            _chunk(b"pHYs", struct.pack(">IIB", per_metre, per_metre, 1)),
            _chunk(b"IDAT", deflate.compress(rows.data) + deflate.flush()),
            _chunk(b"IEND", b""),
        ]
    )


def _chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))
