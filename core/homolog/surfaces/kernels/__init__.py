"""Kernels of distances on grids and to meshes, and of edges that are merged."""
