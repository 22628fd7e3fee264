"""A cohort made ready for the optimizer: surfaces and geodesic tables on the device."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from homolog.correspondence.engine import REACH
from homolog.correspondence.surfaces import Level, Placement, build_level, field_array, length_unit, ordered
from homolog.correspondence.types import Shape
from homolog.geodesics import solve_tables
from homolog.progress import Tick, no_tick, part_of
from homolog.settings import OptimizeSettings

__all__ = ["AREA", "Domain", "prepare"]

AREA = 1.0e4
"""Mean surface area in the optimizer's unit, by the choice of the unit."""
FINE_FROM = 300
"""The coarse meshes (1500 vertices) resolve fewer particles than this: five vertices each."""


@dataclass(frozen=True, slots=True, eq=False)
class Domain:
    """Everything about the shapes that stays the same while particles move.

    Attributes
    ----------
    names : tuple of str
        The subjects.
    unit : float
        Optimizer's unit of length [mm of the world frame].
    placements : tuple of Placement
        Local millimetres to optimizer's coordinates.
    fields : wp.array of FieldData
    coarse, fine : Level
        For fewer than `FINE_FROM` particles, and for more; None if there will not be more.
    geodesic : bool
        Whether the levels carry tables.
    device : str
        Warp alias.
    """

    names: tuple[str, ...]
    unit: float
    placements: tuple[Placement, ...]
    fields: Any
    coarse: Level
    fine: Level | None
    geodesic: bool
    device: str

    def level(self, count: int) -> Level:
        """Return the level on which so many particles measure their distances."""
        return self.coarse if self.fine is None or count < FINE_FROM else self.fine


def prepare(
    shapes: Sequence[Shape], settings: OptimizeSettings, *, device: str, tick: Tick = no_tick
) -> Domain:
    """Compute the geodesic tables and bring all shapes to the device."""
    unit = length_unit(shapes)
    placements = tuple(Placement(s.alignment[:3, :3] / unit, s.alignment[:3, 3] / unit) for s in shapes)
    geodesic = settings.method.uses_geodesics
    names = [shape.name for shape in shapes]
    fine_meshes = [ordered(shape.mesh) for shape in shapes]
    coarse_meshes = [ordered(shape.coarse_mesh) for shape in shapes]
    wanted = settings.particles >= FINE_FROM
    empty: Sequence[Any] = [None] * len(shapes)
    reach = REACH * float(np.sqrt(AREA / (np.pi * FINE_FROM)))
    coarse_tables = fine_tables = empty
    if geodesic:
        between = 0.3 if wanted else 1.0
        coarse_tables = solve_tables(
            coarse_meshes,
            np.inf,
            device=device,
            names=names,
            tick=part_of(tick, 0.0, between),
        )
        if wanted:
            fine_tables = solve_tables(
                fine_meshes,
                [1.05 * reach / f.scale for f in placements],
                device=device,
                names=names,
                tick=part_of(tick, between, 1.0),
            )
    fine = build_level(fine_meshes, fine_tables, placements, device) if wanted else None
    return Domain(
        names=tuple(names),
        unit=unit,
        placements=placements,
        fields=field_array(shapes, placements, device),
        coarse=build_level(coarse_meshes, coarse_tables, placements, device),
        fine=fine,
        geodesic=geodesic,
        device=device,
    )
