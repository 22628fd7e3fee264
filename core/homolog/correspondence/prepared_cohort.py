"""A cohort prepared for the optimization: fields, surfaces and geodesic tables on the device."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from homolog.arrays import BoolArray, FloatArray
from homolog.correspondence.entropy.sampling import LIST_CUTOFF
from homolog.correspondence.fields import field_array, opening_array
from homolog.correspondence.schedule import MIN_FINE_PARTICLES, particle_counts
from homolog.correspondence.surface_sets import (
    Similarity,
    SurfaceSet,
    build_surface_set,
    length_unit,
    morton_ordered,
)
from homolog.correspondence.types import Shape
from homolog.errors import InputError
from homolog.geodesics import GeodesicSolver, GeodesicTable, solve_tables
from homolog.memory import Store, in_memory, return_freed_memory
from homolog.progress import Tick, no_tick, part_of
from homolog.settings import OptimizeSettings
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.simplify import simplified
from homolog.threads import cores, in_threads, on_one_thread

__all__ = ["MEAN_AREA", "PreparedCohort", "landmarks_on_device", "prepare_cohort"]

VERTICES_PER_PARTICLE = 12
"""Vertices per particle of the meshes on which distances are computed; finer ones are simplified.

Such a mesh has edges of h = s / √12, where s is the spacing of particles. On a bend as round as the spacing,
the roundest that particles can tell from a sharper one, a chord of length h leaves the surface by h² / 8 s
(1 % of s) and is shorter than its arc by the share h² / 24 s²: a distance is too short by at most 0.35 %,
and by less on rounder surfaces. Sheets need not stay apart, since distances and particles follow the faces.
Coarse meshes, on which fewer than `MIN_FINE_PARTICLES` start, may have half as many: 0.7 %. They keep enough
for that number, since shapes are also registered on them.
"""
MEAN_AREA = 1.0e4
"""Mean surface area in squared optimizer lengths, by definition of the unit."""


@dataclass(frozen=True, slots=True, eq=False)
class PreparedCohort:
    """The shapes on the device; constant while particles move.

    Attributes
    ----------
    names : tuple of str
        The subjects.
    unit : float
        Optimizer's unit of length [mm of the world frame].
    to_optimizer : tuple of Similarity
        From local millimetres to the optimizer's coordinates, for each shape.
    fields, opening_fields : wp.array of FieldData
        Distances and opening angles.
    sets : SurfaceSets
        For fewer than `MIN_FINE_PARTICLES` particles, and for more.
    geodesic : bool
        Whether the surface sets have geodesic tables.
    device : str
        Warp alias.
    """

    names: tuple[str, ...]
    unit: float
    to_optimizer: tuple[Similarity, ...]
    fields: Any
    opening_fields: Any
    sets: "SurfaceSets"
    geodesic: bool
    device: str

    def surface_set(self, count: int, tick: Tick = no_tick) -> SurfaceSet:
        """Return the surface set on which `count` particles measure distances, and create it if necessary."""
        return self.sets.of(count, tick)


class SurfaceSets:
    """Surface sets of few and of many particles, one at a time.

    The number of particles only grows: the set for few is released before that for many is created, and the
    geodesic tables of the latter are computed after the first preliminary model.

    Parameters
    ----------
    coarse, fine : callable
        Make the sets for fewer than `MIN_FINE_PARTICLES` particles, and for more.
    """

    def __init__(self, coarse: Callable[[Tick], SurfaceSet], fine: Callable[[Tick], SurfaceSet]) -> None:
        self._make = {False: coarse, True: fine}
        self._made: tuple[bool, SurfaceSet] | None = None

    def of(self, count: int, tick: Tick) -> SurfaceSet:
        """Return the set for a number of particles."""
        is_fine = count >= MIN_FINE_PARTICLES
        if self._made is None or self._made[0] is not is_fine:
            follows = self._made is not None
            if follows:
                self._made = None
                return_freed_memory()  # of its tables, before others are solved
            self._made = is_fine, self._make[is_fine](tick)
            if follows:
                return_freed_memory()  # of the solver, before there are more particles
        return self._made[1]


@dataclass(frozen=True, slots=True, eq=False)
class _Surfaces:
    """What surface sets of a cohort have in common, at any level of detail."""

    shapes: Sequence[Shape]
    to_optimizer: Sequence[Similarity]
    free: BoolArray
    device: str
    solve: GeodesicSolver | None  # None for straight distances
    store: Store

    def build(self, originals: Sequence[TriangleMesh], counts: Sequence[int], tick: Tick) -> SurfaceSet:
        """Bring meshes for these numbers of particles to the device, with tables of distances in reach."""
        enough = VERTICES_PER_PARTICLE * max(*counts, MIN_FINE_PARTICLES)

        def made(mesh: TriangleMesh) -> TriangleMesh:
            return morton_ordered(simplified(mesh, enough))

        cutoff = LIST_CUTOFF / math.sqrt(math.pi * min(counts))  # of the root of a surface's area
        meshes, limits = [], []
        for mesh, shape in zip(in_threads(made, originals, cores()), self.shapes, strict=True):
            tick(0.0, f"mesh of {shape.name}")
            meshes.append(mesh.stored(self.store))
            limits.append(cutoff * math.sqrt(shape.mesh.area) + 2.0 * mesh.mean_edge)
        tables: list[GeodesicTable | None] = [None] * len(meshes)
        if self.solve is not None:
            solved_shapes = np.flatnonzero(self.free).tolist()
            solved = self.solve(
                [meshes[k] for k in solved_shapes],
                [limits[k] for k in solved_shapes],
                device=self.device,
                names=[self.shapes[k].name for k in solved_shapes],
                tick=tick,
            )
            for k, table in zip(solved_shapes, solved, strict=True):
                tables[k] = table
        return build_surface_set(
            meshes,
            tables,
            self.to_optimizer,
            self.device,
            self.free,
            carriers=[shape.mesh if shape.field is None else None for shape in self.shapes],
            store=self.store,
        )


@on_one_thread
def prepare_cohort(
    shapes: Sequence[Shape],
    settings: OptimizeSettings,
    *,
    device: str,
    counts: Sequence[int] | None = None,
    free_shapes: BoolArray | None = None,
    solve: GeodesicSolver = solve_tables,
    unit: float | None = None,
    opening_scale: float | None = None,
    store: Store = in_memory,
    tick: Tick = no_tick,
) -> PreparedCohort:
    """Compute the first geodesic tables and bring all shapes to the device.

    Parameters
    ----------
    shapes : sequence of Shape
        The groomed and aligned subjects.
    settings : OptimizeSettings
        Method, particles and weight of opening angles.
    device : str
        Warp alias.
    counts : sequence of int, optional
        Numbers of particles of the stages, ascending; by default those of a complete optimization. Surfaces
        and tables are made for the first one.
    free_shapes : (M,) bool array, optional
        Shapes with free particles. The others get no tables, as no distances on them are needed.
    solve : callable
        Geodesic solver.
    unit, opening_scale : float, optional
        Of another cohort, that these shapes are compared with; by default their own.
    store : Store
        Where meshes are stored, and fields and surfaces for a CPU; the solver decides for tables.
    tick : Tick
        Progress and cancellation.

    Returns
    -------
    PreparedCohort
    """
    for _ in in_threads(lambda shape: shape.mesh.area, shapes, cores()):
        pass  # the meshes keep it
    unit = length_unit(shapes) if unit is None else unit
    to_optimizer = tuple(Similarity.of(shape.alignment, unit) for shape in shapes)
    counts = particle_counts(settings.particles) if counts is None else counts
    free = np.full(len(shapes), True) if free_shapes is None else free_shapes
    geodesic = settings.method.uses_geodesics
    many_counts = [n for n in counts if n >= MIN_FINE_PARTICLES]
    surfaces = _Surfaces(shapes, to_optimizer, free, device, solve if geodesic else None, store)
    few_counts = [n for n in counts if n < MIN_FINE_PARTICLES]
    opening = settings.opening_weight if settings.method.uses_normals else 0.0
    cohort = PreparedCohort(
        names=tuple(shape.name for shape in shapes),
        unit=unit,
        to_optimizer=to_optimizer,
        fields=field_array(shapes, to_optimizer, device, part_of(tick, 0.0, 0.08), store=store),
        opening_fields=opening_array(
            shapes,
            to_optimizer,
            opening,
            device,
            part_of(tick, 0.08, 0.1),
            scale=opening_scale,
            store=store,
        ),
        sets=SurfaceSets(
            lambda tick: surfaces.build([s.coarse_mesh for s in shapes], few_counts, tick),
            lambda tick: surfaces.build([s.mesh for s in shapes], many_counts, tick),
        ),
        geodesic=geodesic,
        device=device,
    )
    cohort.surface_set(counts[0], part_of(tick, 0.1, 1.0))
    return cohort


def landmarks_on_device(shapes: Sequence[Shape], cohort: PreparedCohort, count: int) -> FloatArray | None:
    """Return the shapes' landmarks.

    Parameters
    ----------
    shapes : sequence of Shape
        Of the cohort.
    cohort : PreparedCohort
        The same on the device.
    count : int
        Number of initial particles.

    Returns
    -------
    (M, L, 3) array or None
        In the optimizer's coordinates; None if there are no landmarks.

    Raises
    ------
    InputError
        If numbers of landmarks differ between shapes, or exceed the `count` initial particles.
    """
    landmarks = [shape.landmarks for shape in shapes if shape.landmarks is not None]
    if not landmarks:
        return None
    counts_of_landmarks = {len(is_free) for is_free in landmarks}
    if len(landmarks) < len(shapes) or len(counts_of_landmarks) > 1 or max(counts_of_landmarks) > count:
        raise InputError(
            f"landmarks must be the same on every shape and no more than the {count} initial particles; "
            "give all shapes the same, or run without them"
        )
    return np.stack(
        [
            similarity.apply(is_free)
            for similarity, is_free in zip(cohort.to_optimizer, landmarks, strict=True)
        ]
    )
