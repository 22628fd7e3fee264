"""Signed distance maps, as ShapeWorks grooms segmentations to."""

import os
from pathlib import Path

import numpy as np

from homolog.arrays import Array
from homolog.errors import InputError
from homolog.grooming.headers import read_header
from homolog.grooming.volumes import check_size
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.simplify import simplified
from homolog.surfaces.topology import check_mesh, face_components

__all__ = ["read_distance_map"]

_VERTICES = 6000


def read_distance_map(path: Path) -> TriangleMesh:
    """Read the zero level of a distance map; outside is what the border of the image is.

    Parameters
    ----------
    path : Path
        NRRD or MetaImage of numbers on both sides of zero.

    Raises
    ------
    InputError
        If the file can't be read or holds no closed surface.
    """
    import SimpleITK
    from skimage.measure import marching_cubes

    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: there is no such file; correct the path")
    read_header(path).check()
    SimpleITK.ProcessObject.SetGlobalWarningDisplay(False)
    reader = SimpleITK.ImageFileReader()
    reader.SetFileName(os.fspath(path))
    try:
        reader.ReadImageInformation()
        check_size(path, reader.GetSize(), 16.0 * reader.GetNumberOfComponents())
        image = reader.Execute()
    except RuntimeError as error:
        raise InputError(f"{path}: is no readable image; export it again") from error
    values: Array = SimpleITK.GetArrayFromImage(image).T.astype(np.float32)
    if values.ndim != 3 or not np.isfinite(values).all() or not values.min() < 0.0 < values.max():
        raise InputError(f"{path}: is no distance map, whose values are on both sides of zero")
    if values[0].mean() < 0.0:
        values = -values
    padded = np.pad(values, 1, constant_values=float(values.max()))
    points, faces, _, _ = marching_cubes(padded, 0.0)
    axes = np.reshape(image.GetDirection(), (3, 3)) * image.GetSpacing()
    mesh = TriangleMesh((points - 1.0) @ axes.T + image.GetOrigin(), faces)
    largest = mesh.faces[face_components(mesh.faces) == 0]
    used, numbers = np.unique(largest, return_inverse=True)
    mesh = TriangleMesh(mesh.vertices[used], numbers.reshape(-1, 3))
    if mesh.volume < 0.0:
        mesh = TriangleMesh(mesh.vertices, mesh.faces[:, ::-1])
    check_mesh(mesh, str(path))
    return simplified(mesh, _VERTICES)
