"""Coarser meshes of the same surface."""

import numpy as np

from homolog.errors import NumericalError
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.topology import euler_number

__all__ = ["simplified"]


def simplified(mesh: TriangleMesh, n_vertices: int) -> TriangleMesh:
    """Return a mesh of the same surface and topology with fewer vertices, by quadric edge collapse.

    Parameters
    ----------
    mesh : TriangleMesh
        A closed manifold.
    n_vertices : int
        Wished number of vertices; a mesh that has no more is returned as it is.

    Raises
    ------
    NumericalError
        If so few vertices can't carry the surface's handles.
    """
    import fast_simplification

    if len(mesh.vertices) <= n_vertices:
        return mesh
    euler = euler_number(mesh.faces)
    centre = mesh.vertices.mean(axis=0)  # single precision: keep the numbers small
    vertices, faces = fast_simplification.simplify(
        (mesh.vertices - centre).astype(np.float32),
        np.array(mesh.faces),
        target_count=max(4, 2 * (n_vertices - euler)),
    )
    if euler_number(faces) != euler:
        raise NumericalError(f"{n_vertices} vertices are too few for this surface; use shorter mesh edges")
    return TriangleMesh(vertices.astype(np.float64) + centre, faces)
