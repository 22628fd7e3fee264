"""Coarser meshes of the same surface."""

import numpy as np

from homolog.errors import NumericalError
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["simplified"]


def simplified(mesh: TriangleMesh, n_vertices: int) -> TriangleMesh:
    """Return a mesh of the same surface and topology with fewer vertices.

    Parameters
    ----------
    mesh : TriangleMesh
        A closed manifold.
    n_vertices : int
        Wished number of vertices; a mesh that has no more is returned as it is.
    """
    import fast_simplification

    if len(mesh.vertices) <= n_vertices:
        return mesh
    euler = len(mesh.vertices) - len(mesh.faces) // 2
    target = 2 * (n_vertices - euler)
    vertices, faces = fast_simplification.simplify(
        np.array(mesh.vertices, dtype=np.float32), np.array(mesh.faces), target_count=target, lossless=False
    )
    result = TriangleMesh(vertices.astype(np.float64), faces)
    if len(result.vertices) - len(result.faces) // 2 != euler:
        raise NumericalError("the simplified mesh has another topology")
    return result
