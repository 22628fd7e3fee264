"""From the voxels of a label to a smooth distance field."""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from homolog.arrays import BoolArray
from homolog.grooming.images import Segmentation
from homolog.settings import GroomSettings
from homolog.surfaces.distance_field import DistanceField

__all__ = ["Found", "prepared"]

PADDING = 6


@dataclass(frozen=True, slots=True)
class Found:
    """What was found in the voxels."""

    components_dropped: int
    holes_filled: int
    padded: bool
    notes: tuple[str, ...]


def prepared(segmentation: Segmentation, settings: GroomSettings) -> tuple[DistanceField, Found]:
    """Return the distance field of a segmentation."""
    labels, count = ndimage.label(segmentation.mask, np.ones((3, 3, 3)))
    mask: BoolArray = labels == 1 + int(np.argmax(np.bincount(labels.ravel())[1:]))
    filled = ndimage.binary_fill_holes(mask)
    holes = ndimage.label(filled & ~mask)[1]
    box = ndimage.find_objects(filled.view(np.uint8))[0]
    pad = np.ceil(PADDING * segmentation.spacing.min() / segmentation.spacing).astype(int)
    cropped = np.pad(filled[box], [(int(n), int(n)) for n in pad])
    start = np.array([axis.start for axis in box]) - pad
    inside = ndimage.distance_transform_edt(cropped, sampling=segmentation.spacing)
    outside = ndimage.distance_transform_edt(~cropped, sampling=segmentation.spacing)
    half = 0.5 * segmentation.spacing.min()
    signed = np.where(cropped, half - inside, outside - half)
    spacing = settings.spacing or float(segmentation.spacing.min())
    shape = np.floor((np.array(signed.shape) - 1) * segmentation.spacing / spacing).astype(int) + 1
    scale = spacing / segmentation.spacing
    signed = ndimage.affine_transform(signed, scale, output_shape=tuple(shape), order=1, mode="nearest")
    signed = ndimage.gaussian_filter(signed, settings.smoothing)
    affine = np.eye(4)
    affine[:3, :3] = segmentation.rotation * spacing
    affine[:3, 3] = segmentation.origin + segmentation.rotation @ (start * segmentation.spacing)
    touching = any(
        axis.start == 0 or axis.stop == size for axis, size in zip(box, segmentation.mask.shape, strict=True)
    )
    return DistanceField(signed, affine), Found(count - 1, holes, touching, ())
