"""Shapes of the model as surfaces, quickly: one small matrix product from sliders to vertices.

A thin-plate spline with fixed centres is linear in its targets, so the displacement of every vertex along
every mode is computed once. Any mixture of modes is then their sum.
"""

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from homolog.analysis.parallel import ParallelAnalysis, parallel_analysis
from homolog.analysis.reconstruction import MOST_CENTRES, spread_centres, thin_plate_moved
from homolog.analysis.shape_model import ShapeModel, fit_shape_model
from homolog.arrays import Float32Array, FloatArray, IntArray, frozen
from homolog.files.results import Result
from homolog.progress import Tick, no_tick, part_of
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["ModelShape", "fit_model_shape"]


@dataclass(frozen=True, slots=True, eq=False)
class ModelShape:
    """The mean surface of a result and how it follows the modes. Arrays are read-only.

    Attributes
    ----------
    result : Result
    model : ShapeModel
    parallel : ParallelAnalysis
        Which modes are above chance.
    mean : TriangleMesh
        The mean surface, V vertices.
    moves : (K, 3 V) float32 array
        Displacement of the vertices for one standard deviation of each mode [mm].
    corners : (V, F) sparse float32 array
        One where a vertex is a corner of a face: sums face normals at vertices.
    """

    result: Result
    model: ShapeModel
    parallel: ParallelAnalysis
    mean: TriangleMesh
    moves: Float32Array
    corners: "sparse.csr_array"

    def vertices(self, deviations: FloatArray) -> Float32Array:
        """Return the vertices (V, 3) [mm] at multiples (k,) of the first modes' standard deviations."""
        flat = np.asarray(deviations, dtype=np.float32) @ self.moves[: len(deviations)]
        moved: Float32Array = flat.reshape(-1, 3) + self.mean.vertices.astype(np.float32)
        return moved

    def normals(self, vertices: Float32Array) -> Float32Array:
        """Return unit normals (V, 3) of the surface with these vertices (V, 3), outward."""
        a, b, c = (vertices[self.mean.faces[:, corner]] for corner in range(3))
        one, other = b - a, c - a
        across = np.empty_like(a)
        for axis, (left, right) in enumerate(((1, 2), (2, 0), (0, 1))):
            across[:, axis] = one[:, left] * other[:, right] - one[:, right] * other[:, left]
        sums: Float32Array = self.corners @ across
        sums /= np.maximum(np.sqrt(np.einsum("ij,ij->i", sums, sums)), 1e-30)[:, None]
        return sums

    def carried(self, displacement: FloatArray) -> Float32Array:
        """Return displacements of the vertices (V, 3) for those of the particles (N, 3) [mm].

        Exact for what lies in the space of the subjects: differences of groups, discriminants, modes.
        """
        scores = np.tensordot(self.model.modes, displacement, axes=2) / self.model.standard_deviations
        carried: Float32Array = (scores.astype(np.float32) @ self.moves).reshape(-1, 3)
        return carried


def fit_model_shape(result: Result, tick: Tick = no_tick) -> ModelShape:
    """Fit the shape model of a result and carry its modes to the mean surface.

    Parameters
    ----------
    result : Result
    tick : Tick
        Progress and cancelling.
    """
    model = fit_shape_model(result.world, names=result.names)
    parallel = parallel_analysis(result.world, tick=part_of(tick, 0.0, 0.6))
    tick(0.6, "carrying the modes to the mean surface")
    mesh = result.mean_surface
    centres = spread_centres(model.mean, MOST_CENTRES)
    targets = (model.modes * model.standard_deviations[:, None, None])[:, centres]
    moves = thin_plate_moved(model.mean[centres], mesh.vertices, targets)
    flat = frozen(moves.reshape(len(moves), -1), np.float32)
    return ModelShape(result, model, parallel, mesh, flat, _corners(mesh.faces, len(mesh.vertices)))


def _corners(faces: IntArray, vertices: int) -> "sparse.csr_array":
    rows, columns = faces.ravel(), np.repeat(np.arange(len(faces)), 3)
    ones = np.ones(len(rows), dtype=np.float32)
    return sparse.csr_array((ones, (rows, columns)), shape=(vertices, len(faces)))
