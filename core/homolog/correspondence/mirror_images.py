"""Conversion of shapes with reflections as alignments to mirror images with proper alignments.

All later steps (surfaces, rotations, normals, poses) may assume that alignments are proper similarities. Only
signs of coordinates change, so that the conversion is exact in both directions.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from homolog.arrays import BoolArray, FloatArray
from homolog.correspondence.types import Frame, FrameCallback, InitialParticles, OptimizedParticles, Shape
from homolog.memory import Store, in_memory
from homolog.surfaces.mirroring import MIRROR, mirror_image, mirrors

__all__ = ["MirrorImages", "with_mirror_images"]


@dataclass(frozen=True, slots=True, eq=False)
class MirrorImages:
    """Shapes with proper alignments only, and the conversion to the coordinates of the files.

    Attributes
    ----------
    shapes : tuple of Shape
        Mirror images in place of the shapes that their alignment mirrors.
    mirrored : (M,) bool array
        Which shapes are mirror images.
    """

    shapes: tuple[Shape, ...]
    mirrored: BoolArray

    def points(self, local: FloatArray) -> FloatArray:
        """Convert points (M, n, 3) from coordinates of the files to those of the shapes, or back."""
        signs = np.where(self.mirrored, -1.0, 1.0)
        changed = local.copy()
        changed[:, :, 0] *= signs[:, None]
        return changed

    def initial_particles(self, initial_particles: InitialParticles | None) -> InitialParticles | None:
        """Convert initial particles from coordinates of the files to those of the shapes, or back."""
        return (
            None
            if initial_particles is None
            else replace(initial_particles, local=self.points(initial_particles.local))
        )

    def alignments(self, alignments: FloatArray) -> FloatArray:
        """Return alignments (M, 4, 4) of the shapes as those of the files."""
        return np.where(self.mirrored[:, None, None], alignments @ MIRROR, alignments)

    def observer(self, observe: FrameCallback | None) -> FrameCallback | None:
        """Return a callback for frames of the shapes that passes them on as frames of the files."""
        if observe is None:
            return None

        return lambda frame: observe(self.frame(frame))

    def frame(self, frame: Frame) -> Frame:
        """Return a frame of the shapes as one of the files."""
        return replace(frame, alignments=self.alignments(frame.alignments))

    def result(self, result: OptimizedParticles) -> OptimizedParticles:
        """Return a result in the coordinates of the files."""
        return replace(result, local=self.points(result.local), alignments=self.alignments(result.alignments))


def with_mirror_images(shapes: Sequence[Shape], store: Store = in_memory) -> MirrorImages:
    """Return the shapes for the optimizer; images are made in a store."""
    mirrored = mirrors(np.stack([shape.alignment for shape in shapes]))
    images = (
        _image(shape).stored(store) if is_mirrored else shape
        for shape, is_mirrored in zip(shapes, mirrored.tolist(), strict=True)
    )
    return MirrorImages(tuple(images), mirrored)


def _image(shape: Shape) -> Shape:
    marks = shape.landmarks
    return replace(
        mirror_image(shape),
        alignment=shape.alignment @ MIRROR,
        landmarks=None if marks is None else marks @ MIRROR[:3, :3],
    )
