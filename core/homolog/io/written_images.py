"""Images that the program generates, as NRRD."""

from pathlib import Path

import numpy as np

from homolog.arrays import Array, FloatArray
from homolog.errors import InputError
from homolog.io.atomic import atomic_write

__all__ = ["write_image"]


def write_image(path: Path, values: Array, index_to_world: FloatArray) -> None:
    """Write an image whose axes are those of the world.

    Parameters
    ----------
    path : Path
        File that ends in ``.nrrd``.
    values : (I, J, K) array
        One number for each voxel.
    index_to_world : (4, 4) array
        A diagonal of voxel sizes and a translation [mm].

    Raises
    ------
    InputError
        If the folder can't be written to or the disk is full.
    """
    import SimpleITK

    image = SimpleITK.GetImageFromArray(values.T)
    image.SetOrigin(index_to_world[:3, 3].tolist())
    image.SetSpacing(np.diag(index_to_world)[:3].tolist())
    with atomic_write(path) as part:
        try:
            SimpleITK.WriteImage(image, str(part), useCompression=True)
        except RuntimeError as error:
            raise InputError(
                f"{path}: can't be written; choose a writable folder with enough free space"
            ) from error
