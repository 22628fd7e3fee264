"""Patients that are cut off by the border of their image: the missing part, and the fit to the rest."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import KDTree

from homolog.arrays import BoolArray, FloatArray
from homolog.errors import InputError
from homolog.geometry import inverse_matrices, transform_points
from homolog.grooming import GroomedSubject
from homolog.patient.fit import CutEnd, SurfaceFit, fit_surface
from homolog.patient.local import Region
from homolog.patient.reference import Reference
from homolog.progress import Tick, no_tick
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["CutFit", "check_cut", "distance_z", "ends_of", "fit_rest", "flat_ends", "flat_remarks"]

_CAP_COSINE, _CAP_DEPTH = 0.97, 2.0
"""Flat end: least cosine between normals and axis, and largest depth inward [nodes]."""
_CAP_SHARE, _INWARD = 0.5, -2.0
"""Cut-off vertex: least share of its nearest points on an end, and least z."""
_LEAST_MISSING, _MOST_MISSING = 0.005, 0.3
"""Missing share of the surface above which an end counts as cut, and above which the rest is insufficient."""
_FLAT, _MOST_BEYOND = 0.35, 0.5
"""Flat end inside the image: largest standard deviation of its height [nodes], least share of the surface
beyond."""
_NEAR_COSINES = (0.8, 0.9, _CAP_COSINE)
"""Least cosine of the normals that determine the direction of a flat end, in successive rounds."""


@dataclass(frozen=True, slots=True, eq=False)
class CutFit:
    """A fit to the part that is present.

    Attributes
    ----------
    fit : SurfaceFit
        The fit, with a residual of 0 where a part is missing.
    missing : (V,) bool array
        Vertices of the expected surface that are cut off, or at the rim of the cut.
    share : float
        Share of the expected surface that is cut off.
    """

    fit: SurfaceFit
    missing: BoolArray
    share: float


def fit_rest(
    reference: Reference,
    mesh: TriangleMesh,
    coarse: TriangleMesh,
    columns: FloatArray,
    ends: Sequence[CutEnd],
    fit: SurfaceFit,
    tick: Tick = no_tick,
) -> CutFit:
    """Fit a reference again, without the flat ends of a surface at the border of its image.

    An end counts if a fit without it expects the surface to continue there. Without such an end the fit is
    unchanged.

    Parameters
    ----------
    reference : Reference
    mesh, coarse : TriangleMesh
        See `fit_surface`.
    columns : (c,) array
        The patient's covariates.
    ends : sequence of CutEnd
        Ends at which the patient touches the border of its image.
    fit : SurfaceFit
        Fit to the whole surface.
    tick : Tick

    Returns
    -------
    CutFit
    """
    rest = fit
    while ends:
        rest = fit_surface(reference.model, mesh, coarse, columns, tick, pose=fit.pose, ends=ends)
        cut = [end for end in ends if _continues_beyond(reference, mesh, rest, end)]
        if len(cut) == len(ends):
            break
        ends = cut
    if not ends:
        return CutFit(fit, np.zeros(reference.model.vertices, np.bool_), 0.0)
    local = transform_points(inverse_matrices(rest.pose), rest.expected[: reference.model.vertices])
    beyond, missing = (
        np.any([end.beyond(local, inward * end.depth) for end in ends], axis=0) for inward in (0.0, 1.0)
    )
    areas = reference.model.surface(rest.expected).vertex_areas
    share = float(areas[beyond].sum() / areas.sum())
    seen = replace(rest, residual=np.where(missing, 0.0, rest.residual), met=rest.met & ~missing)
    return CutFit(seen, missing, share)


def check_cut(
    name: str, cut: CutFit, gap: float, reference: Reference, *, at_border: bool, force: bool = False
) -> list[str]:
    """Return remarks on a part that is cut off, as far as the reference expects one.

    Parameters
    ----------
    name : str
        The patient's, for messages.
    cut : CutFit
    gap : float
        Median distance from the fitted model, relative to the size.
    reference : Reference
    at_border : bool
        Whether the patient touches a border of its image that controls do not touch.
    force : bool
        Return what would be refused as a remark.

    Raises
    ------
    InputError
        If too much is cut off.
    """
    share, by = cut.share, " by the border of its image" * at_border
    if share == 0.0:
        # Images of many structures end with them, as stacks of slices do: touching the border is no evidence.
        is_odd = at_border and gap > float(reference.gap[-1])
        return ["touches the border of its image: check that it shows the whole structure"] * is_odd
    if share <= _MOST_MISSING:
        return [_remark(share, by)]
    problem = (
        f"is cut off{by}: {100.0 * share:.0f} % of the surface is missing; give an image that shows the "
        "whole structure"
    )
    if not force:
        raise InputError(f"{name}: {problem}")
    return [problem]


def _remark(share: float, by: str) -> str:
    return (
        f"cut off{by}: about {100.0 * share:.0f} % of the surface is missing and "
        "not assessed; size is that of the complete shape that is expected from the rest"
    )


def ends_of(
    reference: Reference, groomed: GroomedSubject, mesh: TriangleMesh, turn: FloatArray, pose: FloatArray
) -> list[CutEnd]:
    """Return the ends where a patient touches a border of its image that controls do not touch.

    Parameters
    ----------
    reference : Reference
    groomed : GroomedSubject
    mesh : TriangleMesh
        The patient's surface after `turn`.
    turn : (4, 4) array
        Reflection to the side of the controls, or the identity.
    pose : (4, 4) array
        Rigid motion of this surface to the reference.
    """
    borders = [turn[:3, :3] @ border for border in groomed.report.borders]
    return [_end(groomed, mesh, way) for way in borders if not reference.ends_at(pose[:3, :3] @ way)]


def distance_z(reference: Reference, fit: SurfaceFit) -> FloatArray:
    """Return distances from the expected shape in standard deviations (V,), however wide a difference is."""
    usual = reference.usual
    z: FloatArray = (fit.residual - usual.mean[0]) / usual.deviation[0]
    return z


def flat_ends(
    groomed: GroomedSubject,
    mesh: TriangleMesh,
    fit: SurfaceFit,
    surface: TriangleMesh,
    regions: Sequence[Region],
    known: Sequence[CutEnd] = (),
) -> list[CutEnd]:
    """Return the flat ends of a surface inward of the expected shape: it may be cut off there.

    Parameters
    ----------
    groomed : GroomedSubject
    mesh : TriangleMesh
        The patient's surface, reflected if necessary.
    fit : SurfaceFit
        Fit to the whole surface.
    surface : TriangleMesh
        Expected surface of this fit.
    regions : sequence of Region
        Regions of large distances from it.
    known : sequence of CutEnd
        Ends at the border of the image; the result excludes them.
    """
    if groomed.field is None:  # an open mesh has no flat ends
        return []
    tree, areas = KDTree(mesh.vertices), surface.vertex_areas
    here, normals = (
        surface.placed(inverse_matrices(fit.pose)).vertices,
        surface.vertex_normals @ fit.pose[:3, :3],
    )
    ends: list[CutEnd] = []
    for region in regions:
        if region.peak > 0.0 or region.area < _LEAST_MISSING * surface.area:
            continue
        own = region.vertices
        nearest = np.unique(np.asarray(tree.query(here[own], k=8)[1]))
        # The vector area of the missing part is that of the flat end.
        end = _end(groomed, mesh, _direction(areas[own] @ normals[own], mesh.vertex_normals[nearest]))
        beyond = areas * end.beyond(here)
        is_cut = beyond[own].sum() >= _CAP_SHARE * region.area and beyond.sum() < _MOST_BEYOND * areas.sum()
        is_known = any(other.direction @ end.direction > _CAP_COSINE for other in (*known, *ends))
        if is_cut and not is_known and _is_flat(mesh, end):
            ends.append(end)
    return ends


def flat_remarks(cut: CutFit, places: Sequence[str]) -> list[str]:
    """Return a remark on a patient that seems to be cut off inside its image, with the places of its ends."""
    if cut.share == 0.0:
        return []
    where = f" ({', '.join(filter(None, places))})" if any(places) else ""
    return [
        f"has a flat end{where}, beyond which the reference expects {100.0 * cut.share:.0f} % of its "
        "surface: if its segmentation or scan ends there, compare it as cut off at this end"
    ]


def _is_flat(mesh: TriangleMesh, end: CutEnd) -> bool:
    """Return whether the surface is flat at an end."""
    heights = mesh.vertices[end.cap] @ end.direction
    return bool(end.cap.any() and heights.std() < _FLAT * end.depth / _CAP_DEPTH)


def _direction(first: FloatArray, normals: FloatArray) -> FloatArray:
    """Return the mean direction (3,) of the normals (n, 3) close to an initial direction."""
    direction = first
    for cosine in _NEAR_COSINES:
        direction = direction / max(float(np.linalg.norm(direction)), 1e-9)
        near = normals @ direction > cosine
        direction = normals[near].mean(axis=0) if near.any() else direction
    return direction / max(float(np.linalg.norm(direction)), 1e-9)


def _end(groomed: GroomedSubject, mesh: TriangleMesh, direction: FloatArray) -> CutEnd:
    """Return the end of a surface in a direction."""
    depth = _CAP_DEPTH * (mesh.mean_edge if groomed.field is None else groomed.field.spacing)
    along, slope = mesh.vertices @ direction, mesh.vertex_normals @ direction
    height = float(along.max())
    return CutEnd(direction, height, depth, (slope > _CAP_COSINE) & (along > height - depth))


def _continues_beyond(reference: Reference, mesh: TriangleMesh, fit: SurfaceFit, end: CutEnd) -> bool:
    """Return whether a fit without an end expects much of the surface beyond it."""
    model = reference.model
    surface = model.surface(fit.expected)
    z = distance_z(reference, fit)
    vertices = transform_points(inverse_matrices(fit.pose), surface.vertices)
    nearest = np.asarray(KDTree(mesh.vertices).query(vertices, k=8)[1])
    areas = surface.vertex_areas
    beyond = (end.cap[nearest].mean(axis=1) >= _CAP_SHARE) & end.beyond(vertices)
    return bool(areas[beyond].sum() >= _LEAST_MISSING * areas.sum() and np.median(z[beyond]) < _INWARD)
