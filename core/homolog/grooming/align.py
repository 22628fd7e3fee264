"""Bringing groomed shapes into one frame."""

from collections.abc import Sequence

import numpy as np

from homolog.arrays import FloatArray
from homolog.grooming.subject import GroomedSubject
from homolog.settings import GroomSettings

__all__ = ["align"]


def align(groomed: Sequence[GroomedSubject], settings: GroomSettings) -> FloatArray:
    """Return one similarity per subject, (M, 4, 4), from local to world coordinates."""
    result = np.tile(np.eye(4), (len(groomed), 1, 1))
    for matrix, one in zip(result, groomed, strict=True):
        matrix[:3, 3] = -one.mesh.vertices.mean(axis=0)
    return result
