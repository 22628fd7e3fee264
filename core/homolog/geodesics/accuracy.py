"""Errors of a geodesic table against exact distances, from a sample of source vertices."""

from dataclasses import dataclass

import numpy as np

from homolog.errors import InputError
from homolog.geodesics.table import GeodesicTable
from homolog.progress import Tick, no_tick
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["Accuracy", "measure_accuracy"]

FAR_EDGES = 3.0


@dataclass(frozen=True, slots=True)
class Accuracy:
    """Relative errors of a geodesic table over the sampled pairs whose exact distance is at most d_max.

    Attributes
    ----------
    sources, pairs : int
        Number of sampled sources, and of the pairs compared.
    mean, p99, worst : float
        Mean, 99th percentile and maximum of |D / exact - 1| (fractions, not percent).
    worst_far : float
        Maximum over the pairs that are more than three mean edges apart.
    bias : float
        Mean of D / exact - 1.
    missing : int
        Number of pairs closer than 0.99 d_max that the table lacks.
    """

    sources: int
    pairs: int
    mean: float
    p99: float
    worst: float
    worst_far: float
    bias: float
    missing: int

    def __str__(self) -> str:
        """Return one line with the errors in percent."""
        return (
            f"{self.pairs} pairs of {self.sources} sources: error mean {100 * self.mean:.3f} %, "
            f"p99 {100 * self.p99:.3f} %, max {100 * self.worst:.2f} % (beyond {FAR_EDGES:.0f} edges "
            f"{100 * self.worst_far:.2f} %), bias {100 * self.bias:+.3f} %, missing {self.missing}"
        )


def measure_accuracy(
    mesh: TriangleMesh, table: GeodesicTable, n_sources: int = 32, seed: int = 0, tick: Tick = no_tick
) -> Accuracy:
    """Compare rows of a geodesic table with exact polyhedral distances.

    Parameters
    ----------
    mesh : TriangleMesh
        The mesh of the table.
    table : GeodesicTable
        The table to check.
    n_sources : int
        Number of vertices whose rows are compared; all vertices if there are fewer.
    seed : int
        Seed of the random choice of vertices.
    tick : Tick
        Progress and cancelling, called once per source.

    Returns
    -------
    Accuracy

    Raises
    ------
    InputError
        If the exact solver, tvb-gdist, is not installed.

    References
    ----------
    J. S. B. Mitchell, D. M. Mount and C. H. Papadimitriou, "The discrete geodesic problem", SIAM Journal on
    Computing 16 (1987) 647-668.
    """
    try:
        import gdist
    except ImportError as absent:
        raise InputError(
            "comparing with exact distances needs tvb-gdist: pip install 'homolog[bench]'"
        ) from absent
    n = len(mesh.vertices)
    sources = np.random.default_rng(seed).choice(n, min(n_sources, n), replace=False)
    rows = table.to_csr()[sources].toarray()
    everywhere = np.arange(n, dtype=np.int32)
    faces = mesh.faces.astype(np.int32)
    limit = table.d_max if np.isfinite(table.d_max) else 1e100
    errors, distances, missing = [], [], 0
    for k, source in enumerate(sources):
        tick(k / len(sources), "exact distances")
        exact = gdist.compute_gdist(
            mesh.vertices, faces, np.array([source], np.int32), everywhere, max_distance=limit
        )
        there = rows[k] > 0.0
        near = (exact > 0.0) & (exact <= limit)
        missing += int(np.count_nonzero(near & (exact < 0.99 * limit) & ~there))
        both = near & there
        errors.append(rows[k][both] / exact[both] - 1.0)
        distances.append(exact[both])
    tick(1.0, "exact distances")
    error, distance = np.concatenate(errors), np.concatenate(distances)
    size = np.abs(error)
    return Accuracy(
        sources=len(sources),
        pairs=len(error),
        mean=float(size.mean()),
        p99=float(np.percentile(size, 99)),
        worst=float(size.max()),
        worst_far=float(size[distance > FAR_EDGES * mesh.mean_edge].max(initial=0.0)),
        bias=float(error.mean()),
        missing=missing,
    )
