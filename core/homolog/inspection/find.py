"""The list of suspects of a cohort."""

from collections.abc import Sequence

import numpy as np

from homolog.arrays import FloatArray
from homolog.errors import InputError
from homolog.inspection.coverage import BEYOND, FAR, gaps_of, reach_of
from homolog.inspection.gather import Gatherer
from homolog.inspection.neighbourhood import neighbourhood_of
from homolog.inspection.places import Places, find_places
from homolog.inspection.types import Inspection, Kind, Suspect
from homolog.progress import Tick, no_tick, part_of
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["inspect"]

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

    Raises
    ------
    InputError
        If there are fewer than three subjects, or particles are not on their surfaces.
    """
    if len(meshes) < _FEWEST:
        raise InputError(
            f"suspects are found by comparing subjects; {len(meshes)} are too few, it takes three"
        )
    places = find_places(local, meshes, alignments, names=names, tick=part_of(tick, 0.0, 0.7))
    tick(0.7, "neighbours on most subjects")
    usual = neighbourhood_of(places)
    gatherer = Gatherer(places, usual)
    suspects = [one for m in range(len(meshes)) for one in gatherer.suspects(m)]
    suspects += _uncovered(local, meshes, alignments, places, names, part_of(tick, 0.75, 1.0))
    suspects.sort(key=lambda one: -one.severity)
    tick(1.0, "suspects")
    return Inspection(tuple(suspects), places, usual)


def _uncovered(
    local: FloatArray,
    meshes: Sequence[TriangleMesh],
    alignments: FloatArray,
    places: Places,
    names: Sequence[str],
    tick: Tick,
) -> list[Suspect]:
    """Return the regions that are farther from any particle than is usual in the cohort."""
    reaches = []
    for m, (mesh, name) in enumerate(zip(meshes, names, strict=True)):
        tick(m / len(meshes), f"{name}: uncovered regions")
        reaches.append(reach_of(mesh, places.feet[m], local[m], name=name))
    usual = float(
        np.median(np.concatenate([one / s for one, s in zip(reaches, places.spacing, strict=True)]))
    )
    limit = max(BEYOND * usual, FAR)
    suspects = []
    for m, (mesh, reach, spacing) in enumerate(zip(meshes, reaches, places.spacing, strict=True)):
        for gap in gaps_of(mesh, reach, places.feet[m], local[m], limit * spacing):
            wanting = max(1.0, gap.area / spacing**2)
            suspects.append(
                Suspect(
                    Kind.UNCOVERED,
                    m,
                    gap.around,
                    gap.distance / (limit * spacing) * float(np.sqrt(wanting)),
                    alignments[m, :3, :3] @ mesh.vertices[gap.centre] + alignments[m, :3, 3],
                    gap.area,
                    f"{gap.area:.3g} mm² without particles, up to {gap.distance:.3g} mm from the nearest; "
                    f"usual {usual * spacing:.2g} mm",
                )
            )
    return suspects
