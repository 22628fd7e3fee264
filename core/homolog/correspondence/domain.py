"""A cohort made ready for the optimizer: surfaces and geodesic tables on the device."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from homolog.arrays import BoolArray, FloatArray
from homolog.correspondence.sampling import REACH
from homolog.correspondence.schedule import particle_counts
from homolog.correspondence.surfaces import (
    Level,
    Placement,
    build_level,
    field_array,
    length_unit,
    opening_array,
    ordered,
)
from homolog.correspondence.types import Shape
from homolog.errors import InputError
from homolog.geodesics import GeodesicTable, solve_tables
from homolog.progress import Tick, no_tick, part_of
from homolog.settings import OptimizeSettings
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["AREA", "Domain", "Solve", "placed_landmarks", "prepare"]

Solve = Callable[..., Sequence[GeodesicTable]]
"""What is called, and answers, as `homolog.geodesics.solve_tables`."""

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
    fields, reliefs : wp.array of FieldData
        Distances and opening angles.
    coarse, fine : Level or None
        For fewer than `FINE_FROM` particles, and for more; None if there will never be so many.
    geodesic : bool
        Whether the levels carry tables.
    device : str
        Warp alias.
    """

    names: tuple[str, ...]
    unit: float
    placements: tuple[Placement, ...]
    fields: Any
    reliefs: Any
    coarse: Level | None
    fine: Level | None
    geodesic: bool
    device: str

    def level(self, count: int) -> Level:
        """Return the level on which so many particles measure their distances."""
        level = self.coarse if count < FINE_FROM else self.fine
        if level is None:
            raise ValueError(f"the shapes were not prepared for {count} particles")
        return level


def prepare(
    shapes: Sequence[Shape],
    settings: OptimizeSettings,
    *,
    device: str,
    counts: Sequence[int] | None = None,
    moving: BoolArray | None = None,
    solve: Solve = solve_tables,
    tick: Tick = no_tick,
) -> Domain:
    """Compute the geodesic tables and bring all shapes to the device.

    Parameters
    ----------
    shapes : sequence of Shape
    settings : OptimizeSettings
    device : str
        Warp alias.
    counts : sequence of int, optional
        Numbers of particles that there will be; by default those of an optimization from its beginning.
    moving : (M,) bool array, optional
        Shapes on which particles may move. The others get no tables: nobody asks for distances on them.
    solve : callable
        Gives the geodesic tables of meshes.
    tick : Tick
        Progress and cancelling.
    """
    unit = length_unit(shapes)
    placements = tuple(Placement(s.alignment[:3, :3] / unit, s.alignment[:3, 3] / unit) for s in shapes)
    counts = particle_counts(settings.particles) if counts is None else counts
    free = np.full(len(shapes), True) if moving is None else moving
    geodesic = settings.method.uses_geodesics
    few, many = [n for n in counts if n < FINE_FROM], [n for n in counts if n >= FINE_FROM]
    between = 1.0 if not many else 0.4 if few else 0.1

    def level(originals: Sequence[TriangleMesh], limits: Sequence[float], tick: Tick) -> Level:
        meshes = []
        for mesh, shape in zip(originals, shapes, strict=True):
            tick(0.0, f"mesh of {shape.name}")
            meshes.append(ordered(mesh))
        tables: list[GeodesicTable | None] = [None] * len(shapes)
        if geodesic:
            chosen = [k for k, one in enumerate(free) if one]
            solved = solve(
                [meshes[k] for k in chosen],
                [limits[k] for k in chosen],
                device=device,
                names=[shapes[k].name for k in chosen],
                tick=tick,
            )
            for k, table in zip(chosen, solved, strict=True):
                tables[k] = table
        return build_level(meshes, tables, placements, device, free)

    complete = [np.inf] * len(shapes)
    reach = REACH * math.sqrt(AREA / (math.pi * min(many))) if many else 0.0
    enough = [  # longer on larger surfaces, where particles lie farther apart
        reach * 0.01 * math.sqrt(s.mesh.area) + 2.0 * s.mesh.mean_edge for s in shapes
    ]
    opening = settings.opening_weight if settings.method.uses_normals else 0.0
    return Domain(
        names=tuple(shape.name for shape in shapes),
        unit=unit,
        placements=placements,
        fields=field_array(shapes, placements, device, part_of(tick, 0.0, 0.08)),
        reliefs=opening_array(shapes, placements, opening, device, part_of(tick, 0.08, 0.1)),
        coarse=level([s.coarse_mesh for s in shapes], complete, part_of(tick, 0.1, between)) if few else None,
        fine=level([s.mesh for s in shapes], enough, part_of(tick, between, 1.0)) if many else None,
        geodesic=geodesic,
        device=device,
    )


def placed_landmarks(shapes: Sequence[Shape], domain: Domain, count: int) -> FloatArray | None:
    """Return the shapes' landmarks in the optimizer's coordinates, (M, L, 3); None if there are none.

    Raises
    ------
    InputError
        If they are not the same on every shape, or more than the `count` first particles.
    """
    given = [shape.landmarks for shape in shapes if shape.landmarks is not None]
    if not given:
        return None
    numbers = {len(one) for one in given}
    if len(given) < len(shapes) or len(numbers) > 1 or max(numbers) > count:
        raise InputError(
            f"landmarks must be the same on every shape and no more than the {count} first particles; "
            "give all shapes the same, or run without them"
        )
    return np.stack([place.apply(one) for place, one in zip(domain.placements, given, strict=True)])
