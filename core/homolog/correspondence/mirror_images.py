"""Shapes whose alignment is a reflection, as mirror images whose alignment is not.

Everything behind this (surfaces, turns, normals, poses) may take for granted that alignments are proper
similarities. Coordinates change sign only, so nothing is lost on the way in and out.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from homolog.arrays import BoolArray, FloatArray
from homolog.correspondence.types import Frame, Observe, OptimizedParticles, Shape, Start
from homolog.surfaces.mirroring import MIRROR, mirrors

__all__ = ["MirrorImages", "with_mirror_images"]


@dataclass(frozen=True, slots=True, eq=False)
class MirrorImages:
    """Shapes with proper alignments only, and the way back to the coordinates of the files.

    Attributes
    ----------
    shapes : tuple of Shape
        Mirror images in place of the shapes that their alignment mirrors.
    mirrored : (M,) bool array
        Which they are.
    """

    shapes: tuple[Shape, ...]
    mirrored: BoolArray

    def points(self, local: FloatArray) -> FloatArray:
        """Return points (M, n, 3) of the files in the coordinates of the shapes, and the other way about."""
        signs = np.where(self.mirrored, -1.0, 1.0)
        changed = local.copy()
        changed[:, :, 0] *= signs[:, None]
        return changed

    def start(self, start: Start | None) -> Start | None:
        """Return particles to begin with in the coordinates of the shapes, and the other way about."""
        return None if start is None else replace(start, local=self.points(start.local))

    def alignments(self, alignments: FloatArray) -> FloatArray:
        """Return alignments (M, 4, 4) of the shapes as those of the files."""
        return np.where(self.mirrored[:, None, None], alignments @ MIRROR, alignments)

    def observer(self, observe: Observe | None) -> Observe | None:
        """Return what takes frames of the shapes and hands on frames of the files."""
        if observe is None:
            return None

        def pass_on(frame: Frame) -> None:
            observe(replace(frame, alignments=self.alignments(frame.alignments)))

        return pass_on

    def result(self, found: OptimizedParticles) -> OptimizedParticles:
        """Return a result in the coordinates of the files."""
        return replace(found, local=self.points(found.local), alignments=self.alignments(found.alignments))


def with_mirror_images(shapes: Sequence[Shape]) -> MirrorImages:
    """Return the shapes for the optimizer."""
    mirrored = mirrors(np.stack([one.alignment for one in shapes]))
    taken = (_image(one) if odd else one for one, odd in zip(shapes, mirrored.tolist(), strict=True))
    return MirrorImages(tuple(taken), mirrored)


def _image(shape: Shape) -> Shape:
    marks = shape.landmarks
    return replace(
        shape,
        field=shape.field.mirrored,
        mesh=shape.mesh.placed(MIRROR),
        coarse_mesh=shape.coarse_mesh.placed(MIRROR),
        alignment=shape.alignment @ MIRROR,
        landmarks=None if marks is None else marks @ MIRROR[:3, :3],
    )
