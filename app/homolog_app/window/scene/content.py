"""What a view can show of a subject."""

from dataclasses import dataclass

import numpy as np

from homolog.arrays import FloatArray
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["Content"]


@dataclass(frozen=True, slots=True, eq=False)
class Content:
    """One subject's surfaces.

    Attributes
    ----------
    name : str
    raw : TriangleMesh or None
        The input as it is, in the coordinates of the file.
    groomed, coarse : TriangleMesh or None
        The groomed surface and a light one for quick drawing, in the coordinates of the file.
    alignment : (4, 4) array
        From those coordinates to the common ones that are shown.
    note : str
        Second line of the caption.
    """

    name: str
    raw: TriangleMesh | None
    groomed: TriangleMesh | None
    coarse: TriangleMesh | None
    alignment: FloatArray
    note: str = ""

    @property
    def patient_axes(self) -> FloatArray:
        """Directions of the patient's left, back and head as shown: the columns of a rotation."""
        left, _, right = np.linalg.svd(self.alignment[:3, :3])
        return np.asarray(left @ right)
