"""Other programs' geodesic distances, called the same way, from sampled sources.

Each peer takes a mesh, d_max [mm] and sources, and returns the rows of those sources (len(sources), V) and
the CPU seconds that all V sources would take: set-up once, sampled sources scaled up.
"""

import time
from collections.abc import Callable

import gdist
import igl
import numpy as np
import potpourri3d
import scipy.sparse
from meshlib import mrmeshnumpy, mrmeshpy
from scipy.sparse.csgraph import dijkstra

from homolog.api.geodesics import geodesic_distances
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.topology import edges

Rows = tuple[np.ndarray, float]
WHOLE = 7000  # 20 000 vertices would take gdist a quarter of an hour and 7 GB


def homolog(mesh: TriangleMesh, d_max: float, sources: np.ndarray) -> Rows:
    """Whole CSR matrix by the public call."""
    begin = time.process_time()
    matrix = geodesic_distances(mesh.vertices, mesh.faces, d_max, device="cpu")
    return matrix[sources].toarray(), time.process_time() - begin


def exact_rows(mesh: TriangleMesh, limit: float, sources: np.ndarray) -> np.ndarray:
    """Return exact distances up to a limit; not for timing, since it builds the mesh for each source."""
    everywhere, faces = np.arange(len(mesh.vertices), dtype=np.int32), mesh.faces.astype(np.int32)
    starts = [np.array([source], np.int32) for source in sources]
    rows = [
        gdist.compute_gdist(mesh.vertices, faces, start, everywhere, max_distance=limit) for start in starts
    ]
    return np.stack(rows)


def exact(mesh: TriangleMesh, d_max: float, sources: np.ndarray) -> Rows:
    """Mitchell, Mount, Papadimitriou; stops at d_max. The whole matrix, not timed above WHOLE vertices."""
    rows, seconds = exact_rows(mesh, d_max, sources), float("nan")
    if len(mesh.vertices) < WHOLE:
        begin = time.process_time()
        gdist.local_gdist_matrix(mesh.vertices, mesh.faces.astype(np.int32), max_distance=d_max)
        seconds = time.process_time() - begin
    return rows, seconds


def dijkstra_edges(mesh: TriangleMesh, d_max: float, sources: np.ndarray) -> Rows:
    """Shortest paths along edges, all sources, as a CSR matrix."""
    begin = time.process_time()
    pairs = edges(mesh.faces)
    lengths = np.linalg.norm(mesh.vertices[pairs[:, 0]] - mesh.vertices[pairs[:, 1]], axis=1)
    n = len(mesh.vertices)
    graph = scipy.sparse.csr_array((lengths, (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    rows, pieces = np.empty((len(sources), n)), []
    for first in range(0, n, 512):  # in pieces: each is dense
        block = dijkstra(graph, directed=False, indices=np.arange(first, min(first + 512, n)), limit=d_max)
        here = (sources >= first) & (sources < first + 512)
        rows[here] = block[sources[here] - first]
        pieces.append(scipy.sparse.csr_array(np.where(np.isfinite(block), block, 0.0).astype(np.float32)))
    scipy.sparse.vstack(pieces)
    return rows, time.process_time() - begin


def heat_geometry_central(mesh: TriangleMesh, d_max: float, sources: np.ndarray) -> Rows:
    """Heat method; can't stop at d_max."""
    return _sampled(
        mesh,
        sources,
        lambda: potpourri3d.MeshHeatMethodDistanceSolver(mesh.vertices, mesh.faces).compute_distance,
    )


def fast_marching(mesh: TriangleMesh, d_max: float, sources: np.ndarray) -> Rows:
    """Fast marching of geometry-central; can't stop at d_max."""

    def prepare() -> Callable[[int], np.ndarray]:
        solver = potpourri3d.MeshFastMarchingDistanceSolver(mesh.vertices, mesh.faces)
        return lambda source: solver.compute_distance([[(int(source), [])]])

    return _sampled(mesh, sources, prepare)


def heat_igl(mesh: TriangleMesh, d_max: float, sources: np.ndarray) -> Rows:
    """Heat method of libigl; can't stop at d_max."""

    def prepare() -> Callable[[int], np.ndarray]:
        data = igl.HeatGeodesicsData()
        igl.heat_geodesics_precompute(mesh.vertices, mesh.faces.astype(np.int64), data)
        return lambda source: igl.heat_geodesics_solve(data, np.array([source], np.int64))

    return _sampled(mesh, sources, prepare)


def meshlib_surface(mesh: TriangleMesh, d_max: float, sources: np.ndarray) -> Rows:
    """MeshLib's surface distance; stops at d_max. Turning vectors into arrays isn't counted."""
    solid = mrmeshnumpy.meshFromFacesVerts(mesh.faces, mesh.vertices)
    rows, seconds = [], 0.0
    for source in sources:
        start = mrmeshpy.VertBitSet(len(mesh.vertices))
        start.set(mrmeshpy.VertId(int(source)))
        begin = time.process_time()
        result = mrmeshpy.computeSurfaceDistances(solid, start, float(d_max))
        seconds += time.process_time() - begin
        rows.append(np.array(result.vec, np.float64))
    return np.stack(rows), seconds / len(sources) * len(mesh.vertices)


PEERS: dict[str, Callable[[TriangleMesh, float, np.ndarray], Rows]] = {
    "homolog": homolog,
    "gdist (exact)": exact,
    "scipy Dijkstra": dijkstra_edges,
    "potpourri3d heat": heat_geometry_central,
    "potpourri3d fast marching": fast_marching,
    "libigl heat": heat_igl,
    "meshlib": meshlib_surface,
}


def _sampled(
    mesh: TriangleMesh, sources: np.ndarray, prepare: Callable[[], Callable[[int], np.ndarray]]
) -> Rows:
    begin = time.process_time()
    row = prepare()
    ready = time.process_time()
    rows = np.stack([np.ravel(row(source)) for source in sources])
    each = (time.process_time() - ready) / len(sources)
    return rows, ready - begin + each * len(mesh.vertices)
