"""The particles of a result: text files for other programs, and one array for all subjects.

The array is mapped into memory, so that large projects open quickly. The text files are authoritative. A
second file contains the size and time of each text file when the array was written, like Git's index;
text files that have changed since, or were copied without their times, are read instead of the array.
"""

import json
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from homolog.arrays import FloatArray, frozen
from homolog.errors import InputError
from homolog.io.atomic import atomic_write, write_text
from homolog.io.particles import read_particles, write_particles
from homolog.io.project import ProjectFolder
from homolog.progress import Tick, no_tick

__all__ = ["particle_file", "read_all_particles", "write_all_particles", "write_particle_array"]

FRAMES = ("local", "world")
_Stamp = tuple[int, int]
_Stamps = dict[str, tuple[_Stamp, ...]]


def particle_file(project: ProjectFolder, stem: str, frame: str) -> Path:
    """Return the path of a subject's particles; `frame` is ``"local"`` or ``"world"``."""
    return project.particles / f"{stem}_{frame}.particles"


def write_all_particles(
    project: ProjectFolder,
    stems: Sequence[str],
    local: FloatArray | Sequence[FloatArray],
    world: FloatArray | Sequence[FloatArray],
    tick: Tick = no_tick,
) -> None:
    """Write the particles of a result.

    Parameters
    ----------
    project : ProjectFolder
        The new project folder, from `ProjectFolder.replacing_result`.
    stems : sequence of M str
        Stems of the subjects' files.
    local, world : (M, N, 3) arrays or sequences of (N, 3) arrays
        Particles in file and in aligned coordinates [mm].
    tick : Tick

    Raises
    ------
    InputError
        If they can't be written.
    """
    for number, (stem, *both) in enumerate(zip(stems, local, world, strict=True)):
        tick(number / len(stems), f"writing particles of {stem}")
        for frame, points in zip(FRAMES, both, strict=True):
            write_particles(particle_file(project, stem, frame), points)
    write_particle_array(project, stems, local, world)


def write_particle_array(
    project: ProjectFolder,
    stems: Sequence[str],
    local: FloatArray | Sequence[FloatArray],
    world: FloatArray | Sequence[FloatArray],
) -> None:
    """Write the array of the particles in the existing text files; see `write_all_particles`."""
    stamps = _stamps_of_files(project)
    known = {stem: stamps[stem] for stem in stems}
    with atomic_write(_array_file(project)) as part:
        whole = np.lib.format.open_memmap(
            part, "w+", dtype=np.float64, shape=(len(FRAMES), len(stems), *np.shape(local[0]))
        )
        for index, both in enumerate(zip(local, world, strict=True)):
            whole[:, index] = both
        whole.flush()
    write_text(_stamp_file(project), json.dumps({"files": known}, separators=(",", ":")) + "\n")


def read_all_particles(
    project: ProjectFolder, stems: Sequence[str], names: Sequence[str], count: int, tick: Tick = no_tick
) -> tuple[FloatArray, FloatArray, int]:
    """Read the particles of a result.

    Parameters
    ----------
    project : ProjectFolder
    stems, names : sequences of M str
        Stems of the subjects' files, and names for messages.
    count : int
        Number of particles of each subject.
    tick : Tick

    Returns
    -------
    local, world : (M, N, 3) arrays
        Particles [mm], read-only; memory-mapped if no text file has changed.
    parsed : int
        Number of subjects that were read from text files.

    Raises
    ------
    InputError
        If a file is missing or damaged, or has another number of particles.
    """
    mapped, rows = _mapped(project, stems, count)
    missing = [place for place, row in enumerate(rows) if row is None]
    if mapped is not None and not missing and rows == list(range(mapped.shape[1])):
        local, world = mapped
        return frozen(local), frozen(world), 0
    both = np.empty((len(FRAMES), len(stems), count, 3))
    if mapped is not None:
        known = [place for place, row in enumerate(rows) if row is not None]
        both[:, known] = mapped[:, [row for row in rows if row is not None]]
    for number, place in enumerate(missing):
        tick(number / len(missing), f"particles of {names[place]}")
        for frame, into in zip(FRAMES, both, strict=True):
            points = read_particles(particle_file(project, stems[place], frame))
            if len(points) != count:
                raise InputError(
                    f"{project.folder}: the particles of {names[place]} are not {count}; run again"
                )
            into[place] = points
    return frozen(both[0]), frozen(both[1]), len(missing)


def _mapped(
    project: ProjectFolder, stems: Sequence[str], count: int
) -> tuple[FloatArray | None, list[int | None]]:
    """Return the array, and the row of each subject or None if its text files are to be read."""
    none: list[int | None] = [None] * len(stems)
    try:
        stored = json.loads(_stamp_file(project).read_bytes())["files"]
        # Windows can't replace a file that is mapped.
        array = np.load(_array_file(project), mmap_mode=None if os.name == "nt" else "r", allow_pickle=False)
        known = {
            stem: (row, tuple(tuple(map(int, stamp)) for stamp in stamps))
            for row, (stem, stamps) in enumerate(stored.items())
        }
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return None, none
    shape = (len(FRAMES), len(known), count, 3)
    if array.shape != shape or array.dtype != np.float64 or not np.isfinite(array.sum()):
        return None, none
    present = _stamps_of_files(project)
    rows = [known[stem][0] if known.get(stem, (0, ()))[1] == present.get(stem) else None for stem in stems]
    return np.asarray(array), rows


def _stamps_of_files(project: ProjectFolder) -> _Stamps:
    """Return size [bytes] and time [ns] of the files in both frames, by stem, if both exist."""
    states: dict[str, _Stamp] = {}
    try:
        with os.scandir(project.particles) as entries:
            for entry in entries:
                state = entry.stat()
                states[entry.name] = state.st_size, state.st_mtime_ns
    except OSError:
        return {}
    ends = [f"_{frame}.particles" for frame in FRAMES]
    stems = [name.removesuffix(ends[0]) for name in states if name.endswith(ends[0])]
    return {
        stem: tuple(states[stem + end] for end in ends)
        for stem in stems
        if all(stem + end in states for end in ends)
    }


def _array_file(project: ProjectFolder) -> Path:
    return project.folder / "particles.npy"


def _stamp_file(project: ProjectFolder) -> Path:
    return project.folder / "particles.json"
