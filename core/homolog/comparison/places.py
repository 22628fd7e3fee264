"""Results at particles mapped to the mean surface, their connected regions, and names of locations."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from homolog.arrays import BoolArray, FloatArray, IntArray
from homolog.comparison.answer import Answer
from homolog.io.report_details import Axes, ReportDetails
from homolog.io.results import Result
from homolog.statistics.cautions import LEVEL
from homolog.statistics.comparison import Comparison
from homolog.statistics.effects import Effect
from homolog.statistics.thin_plate import MOST_CENTRES, farthest_points, thin_plate_operator
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.nearest import nearest_particles

__all__ = [
    "EDGE",
    "FILE_AXES",
    "INNER",
    "OUTER",
    "PATIENT_AXES",
    "Directions",
    "Region",
    "SurfaceCarrier",
    "directions_of",
    "significant_regions",
]

INNER, OUTER, EDGE = "inner surface", "outer surface", "edge of the opening"
"""The walls of a hollow shape."""


_OFF_THE_MIDDLE = 1.0 / 3.0
"""Fraction of half the extent along an axis from which a location is named by that side."""
_ALONG = 0.35
"""Cosine to an axis from which a direction is named by it."""


@dataclass(frozen=True, slots=True)
class Directions:
    """The names of the sides of three axes.

    Attributes
    ----------
    sides : tuple of pairs of str
        Names of the sides of smaller and larger values of each coordinate.
    """

    sides: tuple[tuple[str, str], ...]

    @property
    def are_the_patients(self) -> bool:
        """Whether the axes are those of the patient."""
        return self is PATIENT_AXES

    @property
    def are_named(self) -> bool:
        """Whether the names are words, not coordinates."""
        return self is not FILE_AXES

    def place(self, points: FloatArray, number: int) -> str:
        """Return one point's location from the middle of points (N, 3), such as ``"left posterior"``."""
        middle = (points.min(axis=0) + points.max(axis=0)) / 2.0
        return self._named(
            (points[number] - middle) / np.maximum(np.ptp(points, axis=0) / 2.0, 1e-300), _OFF_THE_MIDDLE
        )

    def way(self, vector: FloatArray) -> str:
        """Return the name of the direction of a vector (3,)."""
        return self._named(vector / max(float(np.linalg.norm(vector)), 1e-300), _ALONG)

    def _named(self, parts: FloatArray, least: float) -> str:
        names = [
            pair[int(part > 0.0)]
            for pair, part in zip(self.sides, parts.tolist(), strict=True)
            if abs(part) > least
        ]
        return " ".join(names) or "middle"


PATIENT_AXES = Directions((("right", "left"), ("anterior", "posterior"), ("inferior", "superior")))
"""Directions of LPS coordinates that are those of the patient."""
FILE_AXES = Directions((("-x", "+x"), ("-y", "+y"), ("-z", "+z")))
"""Directions of coordinates whose relation to the patient is unknown."""


def directions_of(details: ReportDetails) -> Directions:
    """Return the names of directions: the patient's only if somebody has confirmed the axes."""
    if details.places:
        pairs = (pair.split("/") for pair in details.places.split())
        return Directions(tuple((low, high) for low, high in pairs))
    return PATIENT_AXES if details.axes is Axes.PATIENT else FILE_AXES


@dataclass(frozen=True, eq=False)
class SurfaceCarrier:
    """The mean surface of a result and its warp by the particles.

    Attributes
    ----------
    mesh : TriangleMesh
        The mean surface.
    operator : (V, n) array
        Thin-plate weights of the particles that warp it.
    centres : (n,) int array
        Indices of those particles.
    nearest : (V,) int array
        The closest particle to each vertex on the same side of a wall.
    directions : Directions
        Names of directions.
    """

    mesh: TriangleMesh
    operator: FloatArray
    centres: IntArray
    nearest: IntArray
    directions: Directions = PATIENT_AXES

    @classmethod
    def of(cls, result: Result, directions: Directions = PATIENT_AXES) -> "SurfaceCarrier":
        """Prepare the mean surface of a result, with the names of directions."""
        mean = result.world.mean(axis=0)
        vertices, smoothing = result.mean_surface.vertices, result.smoothing
        chosen, blocks = [], []
        for own, near in result.pieces or ((slice(0, len(mean)), slice(0, len(vertices))),):
            chosen.append(own.start + farthest_points(mean[own], MOST_CENTRES))
            some = mean[chosen[-1]], vertices[near]
            blocks.append(thin_plate_operator(*some, smoothing=smoothing[chosen[-1]]))
        centres, operator = np.concatenate(chosen), block_diag(*blocks)
        nearest = nearest_particles(result.mean_surface, mean)
        return cls(result.mean_surface, operator, centres, nearest, directions)

    def mean_of(self, comparison: Comparison) -> TriangleMesh:
        """Return the mean surface of the subjects of a comparison."""
        return TriangleMesh(self.moved(comparison.mean), self.mesh.faces)

    def moved(self, particles: FloatArray) -> FloatArray:
        """Return vertices (..., V, 3) for positions or displacements of particles (..., N, 3)."""
        vertices: FloatArray = self.operator @ particles[..., self.centres, :]
        return vertices

    def significant(self, comparison: Comparison, level: float) -> BoolArray:
        """Return whether the effect is significant at each vertex after correction, (V,)."""
        significant: BoolArray = comparison.p_fwe[self.nearest] <= level
        return significant

    def walls_at_particles(self, count: int) -> list[str]:
        """Return the wall of each of `count` particles: `INNER`, `OUTER` or `EDGE`.

        An inner surface mostly sees itself, or faces itself across the cavity; the edge of an opening is
        between both. All are empty if inner surfaces are a tenth of the area or less: the shape is not
        hollow.
        """
        inner, edge, areas = self._walls
        if not inner.any():
            return [""] * count
        parts = np.array(
            [
                np.bincount(self.nearest, areas * part, minlength=count)
                for part in (inner, ~inner & ~edge, edge)
            ]
        )
        return [(INNER, OUTER, EDGE)[part] for part in parts.argmax(axis=0).tolist()]

    @property
    def is_hollow(self) -> bool:
        """Whether the mean shape has an inner surface."""
        return bool(self._walls[0].any())

    @cached_property
    def _walls(self) -> tuple[BoolArray, BoolArray, FloatArray]:
        """Masks of vertices on an inner surface and on the edge of its opening, and the vertices' areas."""
        from homolog.surfaces.openness import faces_itself, openness  # loads Warp

        diagonal = float(np.linalg.norm(np.ptp(self.mesh.vertices, axis=0)))
        inner = openness(self.mesh, diagonal)[0] < 1.0 - _ENCLOSED
        shares, count = np.repeat(self.mesh.face_areas, 3), len(self.mesh.vertices)
        areas = np.bincount(self.mesh.faces.ravel(), shares, minlength=count).astype(np.float64)
        if float(areas[inner].sum()) <= _HOLLOW * float(areas.sum()):
            return np.zeros(count, dtype=bool), np.zeros(count, dtype=bool), areas
        ahead, behind = faces_itself(self.mesh)
        inner |= np.isfinite(ahead)
        across = float(np.median(behind[inner & np.isfinite(behind)]))
        near = KDTree(self.mesh.vertices[inner]).query(self.mesh.vertices)[0] < _NEAR_THE_WALL * across
        return inner, ~inner & near & (behind > _ALONG_THE_WALL * across), areas

    def outward_at_particles(self, comparison: Comparison, displacement: FloatArray) -> FloatArray:
        """Return the outward component of displacements of the particles (..., N, 3) [mm], shape (..., N)."""
        outward: FloatArray = (displacement * self.normals_at_particles(comparison)).sum(axis=-1)
        return outward

    def normals_at_particles(self, comparison: Comparison) -> FloatArray:
        """Return the outward unit normals of the comparison's mean surface at the particles, (N, 3)."""
        mesh = self.mean_of(comparison)
        vertex = np.asarray(KDTree(mesh.vertices).query(comparison.mean)[1], dtype=np.int64)
        normals: FloatArray = mesh.vertex_normals[vertex]
        return normals


_ENCLOSED = 0.5
"""Fraction of directions in which a point of an inner surface sees the surface again, as in a cavity."""
_NEAR_THE_WALL, _ALONG_THE_WALL = 1.5, 1.7
"""Maximum distance of an edge from the inner surface, and length of rays through it, in wall thicknesses."""
_HOLLOW = 0.1
"""Minimum fraction of the area of inner surfaces in a hollow shape."""


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """A connected region of significant particles, on one side of the wall of a hollow shape.

    Attributes
    ----------
    particles : (n,) int array
        Their indices.
    area : float
        Area of the mean surface that belongs to them [mm²].
    peak : int
        The particle with the largest statistic.
    position : (3,) array
        Its mean position [mm].
    place : str
        Name of the position, relative to the middle of the mean shape along the axes of the files.
    wall : str
        `INNER`, `OUTER` or `EDGE` of a hollow shape; empty for others.
    outward : Effect
        Displacement at the peak along the outward normal [mm] with its interval, not corrected over the
        surface.
    length : float
        Length of the displacement at the peak [mm].
    way : str
        Name of its direction.
    mean_outward : Effect
        Mean outward displacement over the region's area [mm]. The interval is the mean of the particles'
        intervals, which is at least as wide as that of their mean.
    outward_range : (float, float)
        Smallest and largest outward displacement of the region's particles [mm].
    p, q : float
        Corrected p and false discovery rate of the peak.
    """

    particles: IntArray
    area: float
    peak: int
    position: FloatArray
    place: str
    wall: str
    outward: Effect
    length: float
    way: str
    mean_outward: Effect
    outward_range: tuple[float, float]
    p: float
    q: float

    @property
    def where(self) -> str:
        """Text of the wall and the location."""
        return f"{self.wall}, {self.place}" if self.wall else self.place

    def direction(self, outward: Effect) -> str:
        """Describe the direction of an outward displacement, if its interval determines it."""
        if outward.low <= 0.0 <= outward.high:
            return "neither clearly out of the tissue nor into it"
        way = "out of the tissue" if outward.value > 0.0 else "into the tissue"
        if self.wall != INNER:
            return way
        return f"{way} (cavity {'narrower' if outward.value > 0.0 else 'wider'})"


def significant_regions(answer: Answer, comparison: Comparison, carrier: SurfaceCarrier) -> list[Region]:
    """Return the regions of a comparison with one effect, the largest first.

    Regions on the inner surface, the outer surface and the edge of a hollow shape are separate.
    """
    inside = comparison.p_fwe <= LEVEL
    if len(comparison.pointwise.effect) > 1 or not inside.any():
        return []
    faces = carrier.mesh.faces
    edges = carrier.nearest[np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])]
    walls = carrier.walls_at_particles(len(inside))
    of_wall = np.array(walls)
    kept = edges[inside[edges].all(axis=1) & (of_wall[edges[:, 0]] == of_wall[edges[:, 1]])]
    graph = coo_matrix((np.ones(len(kept)), kept.T), shape=(len(inside), len(inside)))
    labels = connected_components(graph, directed=False)[1]
    normals = carrier.normals_at_particles(comparison)
    effect = comparison.pointwise.effect[0]
    outward = (effect * normals).sum(axis=1)
    low, high = comparison.pointwise.bounds(normals)
    regions = []
    for label in np.unique(labels[inside]):
        own = np.flatnonzero(inside & (labels == label))
        areas = answer.areas[own]
        mean = np.array([outward, low, high])[:, own] @ areas / max(float(areas.sum()), 1e-300)
        peak = int(own[comparison.pointwise.studentized[own].argmax()])
        regions.append(
            Region(
                particles=own,
                area=float(areas.sum()),
                peak=peak,
                position=comparison.mean[peak],
                place=carrier.directions.place(comparison.mean, peak),
                wall=walls[peak],
                outward=Effect(float(outward[peak]), float(low[peak]), float(high[peak])),
                length=float(np.linalg.norm(effect[peak])),
                way=carrier.directions.way(effect[peak]),
                mean_outward=Effect(float(mean[0]), float(mean[1]), float(mean[2])),
                outward_range=(float(outward[own].min()), float(outward[own].max())),
                p=float(comparison.p_fwe[peak]),
                q=float(comparison.pointwise.q[peak]),
            )
        )
    return sorted(regions, key=lambda region: -region.area)
