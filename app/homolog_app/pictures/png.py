"""PNG files."""

import io

import numpy as np
from numpy.typing import NDArray
from PIL import Image

__all__ = ["png_of"]


def png_of(pixels: NDArray[np.uint8], dots_per_inch: float | None = None) -> bytes:
    """Return a picture as the content of a PNG file.

    Parameters
    ----------
    pixels : (H, W, 4) uint8 array
        Red, green, blue, opacity. The opacity is left out if all pixels are opaque.
    dots_per_inch : float, optional
        Resolution of the printed picture.
    """
    opaque, stream = bool((pixels[..., 3] == 255).all()), io.BytesIO()
    size = {} if dots_per_inch is None else {"dpi": (dots_per_inch, dots_per_inch)}
    Image.fromarray(pixels[..., :3] if opaque else pixels).save(stream, "PNG", compress_level=1, **size)
    return stream.getvalue()
