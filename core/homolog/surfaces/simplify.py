"""Coarser meshes of the same surface."""

import numpy as np

from homolog.surfaces.mesh import TriangleMesh

__all__ = ["simplified"]


def simplified(mesh: TriangleMesh, n_vertices: int) -> TriangleMesh:
    """Return a mesh of the same surface and topology with fewer vertices, by quadric edge collapse.

    Where quick collapsing would pinch the surface, it is done more carefully and may stop earlier.

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
    centre = mesh.vertices.mean(axis=0)  # single precision: keep the numbers small
    points, faces = (mesh.vertices - centre).astype(np.float32), np.array(mesh.faces)
    target = max(4, 2 * (n_vertices - euler))
    for haste in (7, 5, 3):
        fewer, simpler = fast_simplification.simplify(points, faces, target_count=target, agg=haste)
        if len(fewer) - len(simpler) // 2 == euler and len(simpler) % 2 == 0:
            return TriangleMesh(fewer.astype(np.float64) + centre, simpler)
    return mesh
