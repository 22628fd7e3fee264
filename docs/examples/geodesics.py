"""Geodesic distances on a mesh, all pairs of vertices up to a distance, as a sparse matrix."""

import numpy as np
import trimesh

import homolog as hl

radius = 10.0
ball = trimesh.creation.icosphere(subdivisions=4, radius=radius)

distances = hl.geodesic_distances(ball, d_max=12.0)  # scipy CSR, float32
print(f"{distances.shape[0]} vertices, {distances.nnz} pairs within 12 mm")

row = distances[[0]].tocoo()  # from the first vertex
cosines = ball.vertices[row.col] @ ball.vertices[0] / radius**2
arcs = radius * np.arccos(np.clip(cosines, -1.0, 1.0))
print(f"mean error on the sphere: {abs(row.data - arcs).mean() / 12.0:.3%} of 12 mm")
