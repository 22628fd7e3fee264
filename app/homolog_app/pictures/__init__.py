"""Still pictures of shapes and particles, without a display.

Shapes are drawn by `homolog_app.rendering`, captions and colour bars by matplotlib. Every function returns a
`matplotlib.figure.Figure`; `write_picture` stores it.
"""

from homolog_app.pictures.figures import (
    ModeSurfaces,
    draw_differences,
    draw_modes,
    draw_particles,
    draw_subjects,
)
from homolog_app.pictures.layout import write_picture
from homolog_app.rendering.camera import VIEWS, View, three_quarter_view
from homolog_app.rendering.colours import (
    DARK,
    LIGHT,
    Theme,
    colours_by_place,
    common_limit,
    outward_displacement,
)

__all__ = [
    "DARK",
    "LIGHT",
    "VIEWS",
    "ModeSurfaces",
    "Theme",
    "View",
    "colours_by_place",
    "common_limit",
    "draw_differences",
    "draw_modes",
    "draw_particles",
    "draw_subjects",
    "outward_displacement",
    "three_quarter_view",
    "write_picture",
]
