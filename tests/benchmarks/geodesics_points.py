"""Geodesic distance between any two points of a surface, against exact polyhedral distances.

Needs the bench extra: ``python tests/benchmarks/geodesics_points.py``. Real surfaces are added where
HOMOLOG_DATA names their folder. For the exact solver points within faces are made vertices of a second mesh,
which leaves the surface as it is.
"""

import argparse
import os
from collections.abc import Callable
from pathlib import Path

import gdist
import geodesics_meshes
import numpy as np
import warp as wp
from geodesics import GENERATED, diagonal, real_surfaces
from geodesics_peers import exact_rows

from homolog.geodesics import GeodesicTable, solve_tables
from homolog.geodesics.kernels.lookup import LANES, MISSING, TableData, blocks_of, geodesic, surface_point
from homolog.surfaces.mesh import TriangleMesh

BINS = (0.25, 0.5, 1.0, 2.0, 5.0, np.inf)  # mean edges
Solver = Callable[[TriangleMesh, float], GeodesicTable]


@wp.kernel
def look_up(
    tables: wp.array(dtype=TableData),
    vertices: wp.array(dtype=wp.vec3),
    faces: wp.array(dtype=wp.vec3i),
    face: wp.array2d(dtype=wp.int32),
    point: wp.array2d(dtype=wp.vec3),
    result: wp.array(dtype=float),
):
    """Look up the distances of pairs of points."""
    k = wp.tid()
    x = surface_point(vertices, faces, face[k, 0], point[k, 0])
    y = surface_point(vertices, faces, face[k, 1], point[k, 1])
    result[k] = geodesic(tables[0], blocks_of(tables[0], x.corners), x, y).distance


def distances(mesh: TriangleMesh, table: GeodesicTable, face: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Return the distances (n,) of pairs of points; faces (n, 2), points (n, 2, 3)."""
    data = table.on_device("cpu")
    with wp.ScopedDevice("cpu"):
        result = wp.zeros(len(face), dtype=float)
        inputs = [
            wp.array([data], dtype=TableData),
            wp.array(mesh.vertices.astype(np.float32), dtype=wp.vec3),
            wp.array(mesh.faces.astype(np.int32), dtype=wp.vec3i),
            wp.array(face.astype(np.int32), dtype=wp.int32, ndim=2),
            wp.array(point.astype(np.float32), dtype=wp.vec3, ndim=2),
        ]
        wp.launch(look_up, len(face), inputs=inputs, outputs=[result])
        return result.numpy()


def with_points(mesh: TriangleMesh, faces: np.ndarray, points: np.ndarray) -> TriangleMesh:
    """Return the same surface with a point within each of some faces made a vertex."""
    new = len(mesh.vertices) + np.arange(len(faces))
    a, b, c = mesh.faces[faces].T
    parts = [np.column_stack(corners) for corners in ((a, b, new), (b, c, new), (c, a, new))]
    kept = np.delete(mesh.faces, faces, axis=0)
    return TriangleMesh(np.vstack([mesh.vertices, points]), np.vstack([kept, *parts]))


def exact_table(mesh: TriangleMesh, reach: float) -> GeodesicTable:
    """Return a table of exact distances between vertices: what is left is the interpolation's error."""
    exact = gdist.local_gdist_matrix(mesh.vertices, mesh.faces.astype(np.int32), max_distance=reach).tocoo()
    unit = reach / 65000
    codes = np.full((len(mesh.vertices),) * 2, MISSING, np.uint16)
    codes[exact.row, exact.col] = np.round(exact.data / unit)
    np.fill_diagonal(codes, 0)
    n = len(codes)
    clusters = -(-n // LANES)  # of consecutive vertices, whose blocks have a row for every vertex
    blocks = np.full((clusters * LANES, n), MISSING, np.uint16)
    blocks[:n] = codes
    return GeodesicTable(
        n,
        reach,
        unit,
        wp.array(blocks.reshape(clusters, LANES, n).swapaxes(1, 2).reshape(-1, LANES), dtype=wp.uint16),
        wp.array(np.tile(np.arange(n, dtype=np.uint16), (clusters, 1)), dtype=wp.uint16),
        wp.array(n * np.arange(clusters, dtype=np.int32), dtype=wp.int32),
        wp.array(np.arange(n, dtype=np.int32), dtype=wp.int32),
    )


def first_table(mesh: TriangleMesh, reach: float) -> GeodesicTable:
    """Return the table that Homolog solves."""
    return solve_tables([mesh], reach)[0]


def compare(
    name: str, mesh: TriangleMesh, share: float, n_sources: int, random: np.random.Generator, solve: Solver
) -> None:
    """Print the errors by distance."""
    d_max, edge = share * diagonal(mesh), mesh.mean_edge
    longest = np.linalg.norm(
        mesh.vertices[mesh.faces] - mesh.vertices[np.roll(mesh.faces, 1, 1)], axis=2
    ).max()
    table = solve(mesh, d_max + 2.0 * longest)
    faces = np.sort(random.choice(len(mesh.faces), len(mesh.faces) // 3, replace=False))
    weights = random.dirichlet([2.0, 2.0, 2.0], len(faces))
    points = np.einsum("ij,ijk->ik", weights, mesh.vertices[mesh.faces[faces]])
    sources = random.choice(len(faces), n_sources, replace=False)
    n = len(mesh.vertices)
    truth = exact_rows(with_points(mesh, faces, points), d_max, n + sources)[:, n:]
    x, y = np.nonzero((truth > 0) & (truth <= d_max))
    pairs, exact = np.column_stack([sources[x], y]), truth[x, y]
    result = distances(mesh, table, faces[pairs], points[pairs])
    error = 100.0 * np.abs(result / exact - 1.0)
    assert (result >= 0).all(), "a pair within d_max is missing"
    which = np.digitize(exact / edge, BINS) - 1
    cells = [
        f"{error[which == k].mean():8.3f} / {np.percentile(error[which == k], 99):7.3f}" for k in range(5)
    ]
    same = np.column_stack([sources, sources])
    own = distances(mesh, table, faces[same], points[same]).max() / edge
    print(
        f"{name:10s} {n:6d} {len(exact):7d} pairs {' |'.join(cells)} | "
        f"from 1/4 edge {error[which >= 0].mean():.3f} | D(x, x) at most {own:.4f} edges",
        flush=True,
    )


def main() -> None:
    """Compare on every surface."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", type=int, default=5000)
    parser.add_argument(
        "--share", type=float, default=0.2, help="d_max, as a part of the bounding box' diagonal"
    )
    parser.add_argument("--sources", type=int, default=60)
    parser.add_argument("--meshes", nargs="*", default=[*GENERATED, "vertebra", "ventricle"])
    parser.add_argument("--exact", action="store_true", help="interpolate exact distances between vertices")
    arguments = parser.parse_args()
    random = np.random.default_rng(0)
    print(
        "relative error, percent, mean / 99th percentile, at 1/4-1/2 | 1/2-1 | 1-2 | 2-5 | above 5 mean edges"
    )
    surfaces = [(name, getattr(geodesics_meshes, name)(arguments.size)) for name in GENERATED]
    if "HOMOLOG_DATA" in os.environ:
        surfaces += real_surfaces(Path(os.environ["HOMOLOG_DATA"]), arguments.size)
    for name, mesh in surfaces:
        if name in arguments.meshes:
            solve = exact_table if arguments.exact else first_table
            compare(name, mesh, arguments.share, arguments.sources, random, solve)


if __name__ == "__main__":
    main()
