"""What results in memory and in folders share: mean surface, its warp to any particles, tables, drawings."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from homolog.arrays import ArrayLike, FloatArray, data_frame, html_of
from homolog.comparison.sample import at_own_size
from homolog.errors import InputError
from homolog.statistics.checks import finite_numbers
from homolog.statistics.design import is_missing, numbers
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

    names: tuple[str, ...]
    groups: tuple[str | None, ...]
    covariates: Mapping[str, tuple[str, ...]]
    aligned: FloatArray
    alignments: FloatArray
    notes: tuple[str, ...]

    @property
    @abstractmethod
    def _mean_shape(self) -> MeanShape: ...

    @property
    def sizes(self) -> FloatArray:
        """Root mean square distance of each subject's particles from their centroid, unscaled [mm], (M,)."""
        return rms_radii(at_own_size(self.aligned, self.alignments))

    @abstractmethod
    def _surfaces(self) -> Sequence[TriangleMesh]: ...

    def to_dataframe(self) -> Any:  # noqa: ANN401 - pandas is imported when it is needed
        """Return a `pandas.DataFrame` with a row for each subject: group, covariates and size [mm]."""
        columns = {"group": self.groups, **{name: _cells(cells) for name, cells in self.covariates.items()}}
        return data_frame(columns | {"size": self.sizes}, self.names, "name")

    def to_pyvista(self) -> Any:  # noqa: ANN401 - the core does not depend on pyvista
        """Return the subjects' surfaces in the common frame, a `pyvista.MultiBlock` with a block for each."""
        placed = zip(self.names, self._surfaces(), self.alignments, strict=True)
        blocks = {name: mesh.placed(alignment).to_pyvista() for name, mesh, alignment in placed}
        return import_module("pyvista").MultiBlock(blocks)

    def _repr_html_(self) -> str:
        """Return the summary that notebooks show."""
        return html_of(repr(self), self.to_dataframe(), self.notes)

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


def _cells(texts: Sequence[str]) -> Sequence[object]:
    """Return a column of a table as numbers if it has no words, missing values as None."""
    cells = [None if is_missing(text) else text for text in texts]
    try:
        values = numbers([cell for cell in cells if cell is not None])
    except InputError:  # commas may be thousands separators
        return cells
    known = iter([] if values is None else values.tolist())
    return cells if values is None else [None if cell is None else next(known) for cell in cells]
