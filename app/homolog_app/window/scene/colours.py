"""Colours of particles: the same place on the mean shape has the same colour on every shape."""

import colorsys

import numpy as np

from homolog.arrays import Array, FloatArray, frozen

__all__ = ["colours_by_place"]


def colours_by_place(mean: FloatArray) -> Array:
    """Return one colour for each particle, (N, 3) uint8, from its place on the mean shape.

    The angle about the shape's shortest axis gives the hue, the height along that axis the lightness, so that
    neighbours look alike and places far apart differ.

    Parameters
    ----------
    mean : (N, 3) array
        Mean of the corresponding particles [mm].
    """
    centred = np.asarray(mean, dtype=np.float64) - np.mean(mean, axis=0)
    if len(centred) < 3:
        return frozen(np.full((len(centred), 3), (60, 140, 220)), np.uint8)
    _, _, axes = np.linalg.svd(centred, full_matrices=False)
    axes *= np.where(axes[np.arange(3), np.abs(axes).argmax(axis=1)] < 0, -1.0, 1.0)[:, None]
    along = centred @ axes.T
    along /= np.maximum(np.abs(along).max(axis=0), 1e-12)
    hue = np.arctan2(along[:, 1], along[:, 0]) / (2 * np.pi) % 1.0
    lightness = 0.45 + 0.13 * along[:, 2]
    rgb = [colorsys.hls_to_rgb(h, level, 0.75) for h, level in zip(hue, lightness, strict=True)]
    return frozen(np.rint(255 * np.array(rgb)), np.uint8)
