"""The list of suspects of a cohort."""

from collections.abc import Sequence

from homolog.arrays import FloatArray
from homolog.errors import InputError
from homolog.inspection.coverage import uncovered
from homolog.inspection.located_particles import LocatedParticles, locate_particles
from homolog.inspection.neighbourhood import neighbourhood_of
from homolog.inspection.suspects import SuspectCollector
from homolog.inspection.types import Inspection
from homolog.progress import Tick, no_tick, part_of
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["assess", "inspect"]

_FEWEST = 3
"""Least number of subjects for an inspection."""


def inspect(
    local: FloatArray,
    meshes: Sequence[TriangleMesh],
    alignments: FloatArray,
    *,
    names: Sequence[str],
    workers: int = 1,
    tick: Tick = no_tick,
) -> Inspection:
    """Find suspects: places where the correspondence may be wrong.

    Parameters
    ----------
    local : (M, N, 3) array
        Particles [mm] in the coordinates of the files, M ≥ 3.
    meshes : sequence of TriangleMesh
        The subjects' closed surfaces in the same coordinates.
    alignments : (M, 4, 4) array
        Similarities to aligned coordinates.
    names : sequence of str
        Names of the subjects, for messages.
    workers : int
        Largest number of processes; see `locate_particles`.
    tick : Tick
        Progress and cancellation.

    Returns
    -------
    Inspection

    Raises
    ------
    InputError
        If there are fewer than three subjects, or particles are not on their surfaces.
    NumericalError
        If processes die repeatedly.
    """
    if len(meshes) < _FEWEST:
        raise InputError(f"suspects are found by comparing three or more subjects, not {len(meshes)}")
    located = locate_particles(
        local, meshes, alignments, names=names, workers=workers, tick=part_of(tick, 0.0, 0.8)
    )
    return assess(located, part_of(tick, 0.8, 1.0))


def assess(located: LocatedParticles, tick: Tick = no_tick) -> Inspection:
    """Find suspects among located particles; the second step of `inspect`."""
    tick(0.0, "neighbours on most subjects")
    consensus = neighbourhood_of(located, part_of(tick, 0.0, 0.5))
    collector = SuspectCollector(located, consensus)
    suspects = []
    for m in range(len(located.meshes)):
        tick(0.5 + 0.3 * m / len(located.meshes), "suspects")
        suspects += collector.suspects(m)
    suspects += uncovered(located, part_of(tick, 0.8, 1.0))
    suspects.sort(key=lambda suspect: -suspect.severity)
    return Inspection(tuple(suspects), located, consensus)
