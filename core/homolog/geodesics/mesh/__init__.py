"""Preparation of meshes for the solvers: intrinsic triangulation, fans of triangles, clusters of sources."""
