"""The mean surface of a model and its warp to any particles, for results in memory and in folders."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

from homolog.arrays import ArrayLike, FloatArray
from homolog.comparison.sample import at_own_size
from homolog.errors import InputError
from homolog.statistics.checks import finite_numbers
from homolog.statistics.procrustes import rms_radii
from homolog.statistics.reconstruction import warp_surface
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["HasMeanShape", "MeanShape"]


@dataclass(frozen=True, slots=True, eq=False)
class MeanShape:
    """Mean particles with the surface that they deform.

    Attributes
    ----------
    particles : (N, 3) float64 array
        Mean particles in the common frame [mm].
    surface : TriangleMesh
        The mean surface in the same frame.
    smoothing : (N,) float64 array
        Smoothing of the spline that warps the surface, at each particle [mm]; see
        `homolog.statistics.reconstruction.warp_surface`.
    """

    particles: FloatArray
    surface: TriangleMesh
    smoothing: FloatArray


class HasMeanShape(ABC):
    """Base of objects with a mean shape, which gives the surface of any particles in the common frame."""

    aligned: FloatArray
    alignments: FloatArray

    @property
    @abstractmethod
    def _mean_shape(self) -> MeanShape: ...

    @property
    def sizes(self) -> FloatArray:
        """Root mean square distance of each subject's particles from their centroid, unscaled [mm], (M,)."""
        return rms_radii(at_own_size(self.aligned, self.alignments))

    def surface(self, particles: ArrayLike | None = None) -> TriangleMesh:
        """Return the surface of aligned particles: the mean surface, warped to them.

        Parameters
        ----------
        particles : (N, 3) array_like, optional
            Aligned particles [mm], such as ``ShapeModel.instance([2.0])``; by default the mean of `aligned`.

        Returns
        -------
        TriangleMesh
            The surface in the common frame, with the same faces for all particles.

        Raises
        ------
        InputError
            If the particles have another shape than (N, 3), or are not finite numbers.
        NumericalError
            If particles coincide, so that they define no warp of the surface.
        """
        mean = self._mean_shape
        if particles is None:
            return mean.surface
        positions = finite_numbers(particles, "particles")
        if positions.shape != mean.particles.shape:
            raise InputError(f"particles need the shape {mean.particles.shape}, not {positions.shape}")
        move = positions - mean.particles
        moved = warp_surface(mean.particles, mean.surface.vertices, move[None], mean.smoothing)[0]
        return TriangleMesh(mean.surface.vertices + moved, mean.surface.faces)
