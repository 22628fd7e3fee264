"""Kernels for distances on grids and to meshes, and for edge operations on meshes."""
