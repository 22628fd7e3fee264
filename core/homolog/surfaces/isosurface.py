"""The zero level of a distance field as a triangle mesh."""

import numpy as np
from scipy import ndimage, sparse

from homolog.errors import NumericalError
from homolog.surfaces.distance_field import DistanceField
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["isosurface"]


def isosurface(field: DistanceField, edge: float | None = None) -> TriangleMesh:
    """Return the zero level as a closed mesh."""
    from skimage.measure import marching_cubes

    values = np.array(field.values)
    area = np.count_nonzero(np.abs(values) < field.spacing) * field.spacing**2 / 2
    edge = edge or float(np.sqrt(area / 6000 * 2 / np.sqrt(3)))
    step = edge * 1.2 / field.spacing
    shape = np.floor((np.array(values.shape) - 1) / step).astype(int) + 1
    values = ndimage.affine_transform(values, np.full(3, step), output_shape=tuple(shape), order=3)
    near = np.abs(values) < 0.02 * step * field.spacing
    values[near] = np.where(values[near] < 0, -1, 1) * 0.02 * step * field.spacing
    vertices, faces, _, _ = marching_cubes(values, 0.0, gradient_direction="ascent")
    n = len(vertices)
    graph = sparse.coo_array((np.ones(len(faces)), (faces[:, 0], faces[:, 1])), shape=(n, n))
    _, label = sparse.csgraph.connected_components(graph + graph.T, directed=False)
    keep = label[faces[:, 0]] == np.argmax(np.bincount(label))
    faces = faces[keep]
    used, faces = np.unique(faces, return_inverse=True)
    vertices = vertices[used] * step @ field.index_to_world[:3, :3].T + field.index_to_world[:3, 3]
    mesh = TriangleMesh(vertices, faces.reshape(-1, 3))
    if mesh.volume < 0:
        mesh = TriangleMesh(mesh.vertices, np.array(mesh.faces)[:, ::-1])
    if len(mesh.faces) % 2:
        raise NumericalError("the surface is not closed")
    return mesh
