"""Films and stills of shapes that move along modes, between groups or on a turntable; no Qt, no OpenGL."""

from homolog_app.films.board import Board
from homolog_app.films.encode import FILM_SUFFIXES, write_film, write_still
from homolog_app.films.film import Film
from homolog_app.films.motion import Motion, group_motion, mode_motions, standing
from homolog_app.films.settings import FilmSettings, PictureSettings, StillSettings

__all__ = [
    "FILM_SUFFIXES",
    "Board",
    "Film",
    "FilmSettings",
    "Motion",
    "PictureSettings",
    "StillSettings",
    "group_motion",
    "mode_motions",
    "standing",
    "write_film",
    "write_still",
]
