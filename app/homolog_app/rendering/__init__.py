"""Shapes drawn in 3-D: one description (`scene`), drawn by VTK, or without it where there is no OpenGL.

`draw.draw` makes pictures; the window draws the same description with the same `actors`. Imports are left to
the modules: VTK, pyvista and Warp are heavy.
"""
