"""Results at particles carried to the mean surface, where they are drawn."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from homolog.analysis.cautions import LEVEL
from homolog.analysis.comparison import Comparison
from homolog.analysis.thin_plate import MOST_CENTRES, farthest_points, thin_plate_operator
from homolog.arrays import BoolArray, FloatArray, IntArray
from homolog.files.results import Result
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.nearest import nearest_particles
from homolog_app.pictures import outward_displacement

__all__ = ["SurfaceCarrier"]


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceCarrier:
    """The mean surface of a result and how it follows the particles.

    Attributes
    ----------
    mesh : TriangleMesh
        The mean surface.
    operator : (V, n) array
        Thin-plate weights of the particles that carry it.
    centres : (n,) int array
        Which particles those are.
    nearest : (V,) int array
        The particle nearest to each vertex, of those on its side of a wall.
    """

    mesh: TriangleMesh
    operator: FloatArray
    centres: IntArray
    nearest: IntArray

    @classmethod
    def of(cls, result: Result) -> "SurfaceCarrier":
        """Prepare the mean surface of a result."""
        mean = result.world.mean(axis=0)
        centres = farthest_points(mean, MOST_CENTRES)
        vertices = result.mean_surface.vertices
        operator = thin_plate_operator(mean[centres], vertices, smoothing=result.smoothing[centres])
        nearest = nearest_particles(result.mean_surface, mean)
        return cls(result.mean_surface, operator, centres, nearest)

    def mean_of(self, comparison: Comparison) -> TriangleMesh:
        """Return the mean surface of the subjects of a comparison."""
        return TriangleMesh(self.moved(comparison.mean), self.mesh.faces)

    def moved(self, particles: FloatArray) -> FloatArray:
        """Return vertices (..., V, 3) for positions or displacements of particles (..., N, 3)."""
        vertices: FloatArray = self.operator @ particles[..., self.centres, :]
        return vertices

    def significant(self, comparison: Comparison, level: float) -> BoolArray:
        """Return whether the effect is significant at each vertex, corrected for all that is tested, (V,)."""
        significant: BoolArray = comparison.p_fwe[self.nearest] <= level
        return significant

    def discriminant_is_firm(self, comparison: Comparison) -> BoolArray:
        """Return where the discriminant's map is unlike zero, (V,); nowhere if no whole shape differs."""
        assert comparison.discriminant is not None
        mesh = self.mean_of(comparison)
        maps = [outward_displacement(mesh, self.moved(mode)) for mode in comparison.discriminant.modes]
        low, high = comparison.discriminant.bounds(np.array(maps))
        return np.asarray(((low > 0.0) | (high < 0.0)) & (comparison.p_adjusted <= LEVEL))

    def outward_at_particles(self, comparison: Comparison, displacement: FloatArray) -> FloatArray:
        """Return the outward part of displacements of the particles (..., N, 3) [mm], shape (..., N)."""
        outward: FloatArray = (displacement * self.normals_at_particles(comparison)).sum(axis=-1)
        return outward

    def normals_at_particles(self, comparison: Comparison) -> FloatArray:
        """Return the outward unit normals of the comparison's mean surface at the particles, (N, 3)."""
        mesh = self.mean_of(comparison)
        vertex = np.asarray(KDTree(mesh.vertices).query(comparison.mean)[1], dtype=np.int64)
        normals: FloatArray = mesh.vertex_normals[vertex]
        return normals
