"""What a table will take, before it is solved: reach, storage and memory."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from homolog.errors import InputError
from homolog.geodesics.lookup import LANES
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.topology import check_mesh, edges

__all__ = ["DENSE_BUDGET", "TablePlan", "plan_tables"]

DENSE_BUDGET = 1_500_000_000
"""Tables of a cohort are dense, which is faster to read, while all take no more than this [bytes] …"""
DENSE_SHAPE = 250_000_000
"""… and each no more than this (11 180 vertices)."""
DEFAULT_LIMIT = 8_000_000_000
"""Ceiling for the tables of a cohort [bytes] where the caller names none."""


@dataclass(frozen=True, slots=True)
class TablePlan:
    """How the tables of a cohort will be stored.

    Attributes
    ----------
    reaches : tuple of float
        Longest distance [mm] of each shape that codes must hold: d_max, or what the mesh allows.
    dense : bool
        Dense tables, or blocks.
    nbytes : int
        Predicted size of all tables [bytes]; exact for dense ones.
    """

    reaches: tuple[float, ...]
    dense: bool
    nbytes: int


def plan_tables(
    meshes: Sequence[TriangleMesh],
    d_max: Sequence[float],
    names: Sequence[str],
    memory_limit: int | None = None,
) -> TablePlan:
    """Check the meshes, choose the storage and predict its size.

    Raises
    ------
    InputError
        For a mesh that `check_mesh` refuses, for d_max that is not positive, and for tables above the limit.
    """
    for mesh, limit, name in zip(meshes, d_max, names, strict=True):
        check_mesh(mesh, name)
        if not limit > 0.0:
            raise InputError(f"{name}: d_max is {limit}; geodesic distances need a positive length in mm")
    ceiling = DEFAULT_LIMIT if memory_limit is None else memory_limit
    reaches = tuple(_reach(mesh, limit) for mesh, limit in zip(meshes, d_max, strict=True))
    squares = [2 * len(mesh.vertices) ** 2 for mesh in meshes]
    dense = sum(squares)
    blocks = sum(_block_bytes(mesh, reach) for mesh, reach in zip(meshes, reaches, strict=True))
    small = dense <= DENSE_BUDGET and max(squares) <= DENSE_SHAPE
    if dense <= ceiling and (small or dense <= blocks):
        return TablePlan(reaches, dense=True, nbytes=dense)
    if blocks > ceiling:
        raise InputError(
            f"geodesic tables of {len(meshes)} shapes would take about {blocks / 1e9:.1f} GB, above the "
            f"limit of {ceiling / 1e9:.1f} GB: raise the limit, shorten d_max or use coarser meshes"
        )
    return TablePlan(reaches, dense=False, nbytes=blocks)


def _reach(mesh: TriangleMesh, d_max: float) -> float:
    """d_max, or an upper bound of all distances on the mesh if that is less."""
    if d_max < np.linalg.norm(np.ptp(mesh.vertices, axis=0)):
        return float(d_max)
    pairs = edges(mesh.faces)
    lengths = np.linalg.norm(mesh.vertices[pairs[:, 0]] - mesh.vertices[pairs[:, 1]], axis=1)
    graph = coo_array((lengths, (pairs[:, 0], pairs[:, 1])), shape=(len(mesh.vertices),) * 2)
    return min(
        float(d_max), 2.0 * float(dijkstra(graph.tocsr(), directed=False, indices=np.array([0])).max())
    )


def _block_bytes(mesh: TriangleMesh, reach: float) -> int:
    """Size of a block table, from the area of a flat disc; curved surfaces mostly need less."""
    n = len(mesh.vertices)
    radius = reach + 3.0 * mesh.mean_edge  # of a cluster: about 2.5 edges
    patch = min(n, n * math.pi * radius**2 / mesh.area)
    n_clusters = 1.05 * n / LANES
    return int(2 * n_clusters * n + 2 * LANES * n_clusters * patch)
