"""Signed distance maps, such as those that ShapeWorks makes in grooming."""

from pathlib import Path

import numpy as np

from homolog.arrays import Array
from homolog.errors import InputError
from homolog.geometry import transform_points
from homolog.io.images import read_volume
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.simplify import simplified
from homolog.surfaces.topology import check_mesh, face_components

__all__ = ["read_distance_map"]

_VERTICES = 6000


def read_distance_map(path: Path) -> TriangleMesh:
    """Read the zero level of a distance map; the sign at the border of the image means outside.

    Parameters
    ----------
    path : Path
        NRRD or MetaImage with positive and negative values.

    Raises
    ------
    InputError
        If the file can't be read or contains no closed surface.
    """
    from skimage.measure import marching_cubes

    path = Path(path)
    volume = read_volume(path)
    values: Array = np.asarray(volume.layers[0], np.float32)
    if not np.isfinite(values).all() or not values.min() < 0.0 < values.max():
        raise InputError(f"{path}: is not a distance map; its values must lie on both sides of zero")
    if values[0].mean() < 0.0:
        values = -values
    padded = np.pad(values, 1, constant_values=float(values.max()))
    points, faces, _, _ = marching_cubes(padded, 0.0)
    matrix = volume.index_to_world
    mesh = TriangleMesh(transform_points(matrix, points - 1.0), faces)
    largest = mesh.faces[face_components(mesh.faces) == 0]
    used, numbers = np.unique(largest, return_inverse=True)
    mesh = TriangleMesh(mesh.vertices[used], numbers.reshape(-1, 3))
    if mesh.volume < 0.0:
        mesh = TriangleMesh(mesh.vertices, mesh.faces[:, ::-1])
    check_mesh(mesh, str(path))
    return simplified(mesh, _VERTICES)
