"""Geodesic distances on one surface, given in any form."""

from os import PathLike
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from homolog.api.inputs import as_mesh
from homolog.arrays import ArrayLike
from homolog.errors import InputError
from homolog.geodesics import solve_tables
from homolog.io.meshes import read_mesh
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["geodesic_distances"]


def geodesic_distances(
    surface: Any,  # noqa: ANN401 - meshes of any library
    faces: ArrayLike | None = None,
    d_max: float = float("inf"),
    *,
    device: str = "auto",
) -> csr_array:
    """Return the geodesic distances between all vertices of a triangle mesh up to d_max.

    The mesh may have rims, across which no path leads, and pieces, between which there are no distances.

    Parameters
    ----------
    surface : TriangleMesh, mesh of another library, path or (V, 3) array_like
        A mesh of Homolog, trimesh, pyvista, VTK or meshio; a file, whose vertices are those of `read_mesh`; a
        pair (vertices, faces); or the positions of the vertices, in any unit of length, with `faces`. Of a
        mesh of pyvista, VTK or meshio, vertices without a face are left out.
    faces : (F, 3) array_like of int, optional
        Vertex indices, consistently oriented, if the surface is an array.
    d_max : float
        Longest distance, in the unit of the vertices; inf for all.
    device : str
        ``"auto"`` (the first GPU if there is one, else the CPU), ``"cpu"`` or ``"cuda:<n>"``.

    Returns
    -------
    (V, V) float32 csr_array
        Symmetric. Pairs farther apart than d_max have no entry; the zeros of the diagonal are stored.
        The rounding error is at most 8e-6 d_max.

    Raises
    ------
    InputError
        If the surface is no mesh or not an oriented manifold, d_max is not positive, or the device does not
        exist.

    References
    ----------
    Z. Fu et al., "A fast iterative method for solving the eikonal equation on triangulated surfaces", SIAM
    Journal on Scientific Computing 33 (2011) 2468-2488; docs/geodesics.md describes the differences.

    Examples
    --------
    >>> import homolog as hl
    >>> vertices = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]
    >>> faces = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
    >>> distances = hl.geodesic_distances(vertices, faces, d_max=2.0)  # an octahedron's neighbours
    >>> distances.nnz, distances[0, 2].round(3)
    (30, np.float32(1.414))
    """
    if isinstance(surface, str | PathLike):
        mesh: TriangleMesh | None = read_mesh(surface)
    else:
        mesh = as_mesh(surface if faces is None else (surface, faces))
    if mesh is None:
        raise InputError(
            f"{type(surface).__name__} is not a surface; give a mesh, a file, or vertices (V, 3) and faces "
            "(F, 3), and the longest distance as d_max"
        )
    if not isinstance(d_max, int | float | np.number):
        raise InputError(f"d_max={d_max!r}: must be a distance in mm")
    return solve_tables([mesh], float(d_max), device=device)[0].to_csr()
