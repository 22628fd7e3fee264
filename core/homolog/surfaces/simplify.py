"""Coarser meshes of the same surface."""

import numpy as np

from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.topology import euler_number, is_sound

__all__ = ["simplified"]

_AGGRESSIVENESS = (7, 5, 3)


def simplified(mesh: TriangleMesh, n_vertices: int, *, most: int | None = None) -> TriangleMesh:
    """Return a mesh of the same surface and topology with fewer vertices, by quadric edge collapse.

    The quadric decimation checks no topology. Its result is therefore checked, and where it pinches the
    surface, more vertices are kept: as few as give a sound mesh.

    Parameters
    ----------
    mesh : TriangleMesh
        A closed manifold.
    n_vertices : int
        Wanted number of vertices; a mesh that has no more is returned as it is.
    most : int, optional
        Largest number of vertices that is tried before the mesh itself is returned.

    Returns
    -------
    TriangleMesh
        A closed manifold of the same Euler number; the mesh itself if none was found.
    """
    import fast_simplification

    if len(mesh.vertices) <= n_vertices:
        return mesh
    euler = euler_number(mesh.faces)
    centre = mesh.vertices.mean(axis=0)  # single precision: keep the numbers small
    points, faces = (mesh.vertices - centre).astype(np.float32), np.array(mesh.faces)
    count = n_vertices
    while count < min(len(points), (most or len(points)) + 1):
        target = max(4, 2 * (count - euler))
        for aggressiveness in _AGGRESSIVENESS:
            fewer, simpler = fast_simplification.simplify(
                points, faces, target_count=target, agg=aggressiveness
            )
            if len(simpler) >= len(faces):
                continue
            result = TriangleMesh(fewer.astype(np.float64) + centre, simpler)
            if euler_number(simpler) == euler and is_sound(result):
                return result
        count *= 2
    return mesh
