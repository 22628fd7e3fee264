"""Still pictures of shapes and particles, without a display and without OpenGL.

Surfaces are drawn by casting rays with Warp, because VTK ends the whole process where it finds no OpenGL
(bare containers, cluster nodes); captions and colour bars are matplotlib's. Every function returns a
`matplotlib.figure.Figure`; `write_picture` stores it.
"""

from homolog_app.pictures.colours import DARK, LIGHT, Theme, correspondence_colours
from homolog_app.pictures.differences import draw_differences
from homolog_app.pictures.displacement import common_limit, outward_displacement
from homolog_app.pictures.layout import write_picture
from homolog_app.pictures.modes import ModeSurfaces, draw_modes
from homolog_app.pictures.particles import draw_particles, draw_subjects
from homolog_app.pictures.views import VIEWS, View, three_quarter_view

__all__ = [
    "DARK",
    "LIGHT",
    "VIEWS",
    "ModeSurfaces",
    "Theme",
    "View",
    "common_limit",
    "correspondence_colours",
    "draw_differences",
    "draw_modes",
    "draw_particles",
    "draw_subjects",
    "outward_displacement",
    "three_quarter_view",
    "write_picture",
]
