"""Particles as text, one ``x y z`` per line, as ShapeWorks reads and writes them."""

from pathlib import Path

import numpy as np

from homolog.arrays import FloatArray, frozen
from homolog.errors import InputError
from homolog.io.atomic import write_text
from homolog.io.bounded import read_bytes
from homolog.io.vtk_files import read_legacy_vtk

__all__ = ["PARTICLE_SUFFIXES", "read_particles", "write_particles"]

PARTICLE_SUFFIXES = (".particles", ".pts", ".lpts", ".wpts")
"""Names of lists of particles; the last two are those of older ShapeWorks, local and world."""


def write_particles(path: Path, points: FloatArray) -> None:
    """Write particles with all their digits; the line is the index of the correspondence.

    Parameters
    ----------
    path : Path
        The ``.particles`` file, replaced atomically.
    points : (N, 3) array
        Positions [mm].

    Raises
    ------
    InputError
        If the file can't be written.
    """
    numbers = np.asarray(points, dtype=np.float64).ravel().tolist()
    write_text(path, ("%r %r %r\n" * (len(numbers) // 3)) % tuple(numbers))


def read_particles(path: Path) -> FloatArray:
    """Read particles, shape (N, 3) [mm], read-only.

    ShapeWorks also stores them as the points of a legacy ``.vtk`` file. As in ShapeWorks, empty lines are
    skipped, and reading stops at the first line that does not start with a number. Commas may separate the
    numbers, or be their decimal points, and a line ``x,y,z`` may come first.

    Raises
    ------
    InputError
        If the file is missing, empty, implausibly large, or has a line that is not three finite numbers.
    """
    path = Path(path)
    stored = read_bytes(path, "list of particles")
    is_vtk = path.suffix.lower() == ".vtk"
    try:
        points = read_legacy_vtk(stored).points if is_vtk else None
        lines = [] if is_vtk else stored.decode("utf-8-sig").splitlines()
    except ValueError as error:
        raise InputError(f"{path}: can't be read as particles: {error}; choose another file") from error
    return _checked(path, _of_lines(path, lines) if points is None else points)


def _of_lines(path: Path, lines: list[str]) -> FloatArray:
    plain = _of_plain_lines(lines)
    if plain is not None:
        return plain
    points: list[list[float]] = []
    for number, line in enumerate(lines, start=1):
        tokens = _tokens(line)
        if not tokens or (not points and [word.lower() for word in tokens] == ["x", "y", "z"]):
            continue
        if not _is_number(tokens[0]):
            break
        if len(tokens) != 3 or not all(_is_number(word) for word in tokens):
            raise InputError(f"{path}, line {number}: is not a point; each line must have three numbers")
        points.append([float(word) for word in tokens])
    return np.array(points)


def _tokens(line: str) -> list[str]:
    """Return the numbers of a line as text; commas within three numbers are their decimal points."""
    line = line.replace(";", " ")
    tokens = line.split()
    if len(tokens) == 3 and all(0 < token.find(",") < len(token) - 1 for token in tokens):
        return [token.replace(",", ".") for token in tokens]
    return line.replace(",", " ").split()


def _of_plain_lines(lines: list[str]) -> FloatArray | None:
    """Return the points of lines in the format of `write_particles`, several times as fast; else None."""
    text = " ".join(lines)
    if any(line.count(" ") != 2 for line in lines) or "_" in text:
        return None
    tokens = text.split(" ")
    try:
        return np.array(list(map(float, tokens))).reshape(-1, 3)
    except ValueError:  # also for an empty token, so that each line has three
        return None


def _checked(path: Path, points: FloatArray) -> FloatArray:
    if not len(points):
        raise InputError(f"{path}: contains no particles")
    if not np.isfinite(points).all():
        raise InputError(f"{path}: contains values that are not finite; write the particles again")
    return frozen(points)


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return "_" not in word  # Python accepts it between digits
