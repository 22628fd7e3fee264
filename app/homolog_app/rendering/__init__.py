"""3-D rendering: one description (`scene`), drawn by VTK, or in software without OpenGL.

`draw.draw` makes pictures; the window draws the same description with the same `actors`. This
package imports nothing itself: VTK, pyvista and Warp are heavy.
"""
