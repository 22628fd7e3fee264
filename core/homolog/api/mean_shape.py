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
from homolog.statistics.reconstruction import Parts, warp_surface
from homolog.statistics.relative_pose import RelativePoses, relative_poses
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
    pieces : sequence of pairs of slices
        Particles and vertices of each of several structures; empty for a single one.
    """

    particles: FloatArray
    surface: TriangleMesh
    smoothing: FloatArray
    pieces: Parts = ()


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
    @abstractmethod
    def _own(self) -> Mapping[str, slice]:
        """The particles of each of several structures, by name; empty for a single one."""

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
        vertices = mean.surface.vertices
        moved = warp_surface(mean.particles, vertices, move[None], mean.smoothing, mean.pieces)[0]
        return TriangleMesh(vertices + moved, mean.surface.faces)

    def relative_poses(self, reference: str | None = None) -> RelativePoses:
        """Return how the structures lie to each other, apart from their shapes.

        Parameters
        ----------
        reference : str, optional
            Structure from which the others are seen; by default the first.

        Raises
        ------
        InputError
            If the model has a single structure, or none of this name.

        Examples
        --------
        Test whether the pose of a tibia differs between groups, with the tests for shapes:

        >>> poses = project.relative_poses("femur")  # doctest: +SKIP
        >>> turn_and_shift = poses.displacements("tibia")  # doctest: +SKIP
        >>> hl.compare_groups(turn_and_shift, project.groups, alignment="as-it-lies")  # doctest: +SKIP
        """
        own = self._own
        if not own or (reference is not None and reference not in own):
            listed = ", ".join(own) or "there is a single structure"
            raise InputError(f"relative poses need another structure than {reference}: {listed}")
        names = list(own)
        particles = [self.aligned[:, rows] for rows in own.values()]
        return relative_poses(particles, names, names.index(reference or names[0]))


def _cells(texts: Sequence[str]) -> Sequence[object]:
    """Return a column of a table as numbers if it has no words, missing values as None."""
    cells = [None if is_missing(text) else text for text in texts]
    try:
        values = numbers([cell for cell in cells if cell is not None])
    except InputError:  # commas may be thousands separators
        return cells
    known = iter([] if values is None else values.tolist())
    return cells if values is None else [None if cell is None else next(known) for cell in cells]
