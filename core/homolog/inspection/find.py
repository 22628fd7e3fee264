"""The list of suspects of a cohort."""

from collections.abc import Sequence

from homolog.arrays import FloatArray
from homolog.errors import InputError
from homolog.inspection.coverage import uncovered
from homolog.inspection.gather import Gatherer
from homolog.inspection.neighbourhood import neighbourhood_of
from homolog.inspection.places import Places, find_places
from homolog.inspection.types import Inspection
from homolog.progress import Tick, no_tick, part_of
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["inspect", "judge"]

_FEWEST = 3
"""Subjects that it takes to say which of them is the odd one."""


def inspect(
    local: FloatArray,
    meshes: Sequence[TriangleMesh],
    alignments: FloatArray,
    *,
    names: Sequence[str],
    tick: Tick = no_tick,
) -> Inspection:
    """Look for places where corresponding particles don't correspond.

    Parameters
    ----------
    local : (M, N, 3) array
        Particles [mm] in the coordinates of the files, M ≥ 3.
    meshes : sequence of TriangleMesh
        The subjects' closed surfaces in the same coordinates.
    alignments : (M, 4, 4) array
        Similarities to aligned coordinates.
    names : sequence of str
        Subjects, for messages.
    tick : Tick
        Progress and cancelling.

    Returns
    -------
    Inspection

    Raises
    ------
    InputError
        If there are fewer than three subjects, or particles are not on their surfaces.
    """
    if len(meshes) < _FEWEST:
        raise InputError(f"suspects are found by comparing three or more subjects, not {len(meshes)}")
    places = find_places(local, meshes, alignments, names=names, tick=part_of(tick, 0.0, 0.8))
    return judge(places, part_of(tick, 0.8, 1.0))


def judge(places: Places, tick: Tick = no_tick) -> Inspection:
    """Look for suspects among particles whose places are known; `inspect` from its second step on."""
    tick(0.0, "neighbours on most subjects")
    usual = neighbourhood_of(places, part_of(tick, 0.0, 0.5))
    gatherer = Gatherer(places, usual)
    suspects = []
    for m in range(len(places.meshes)):
        tick(0.5 + 0.3 * m / len(places.meshes), "suspects")
        suspects += gatherer.suspects(m)
    suspects += uncovered(places, part_of(tick, 0.8, 1.0))
    suspects.sort(key=lambda one: -one.severity)
    return Inspection(tuple(suspects), places, usual)
