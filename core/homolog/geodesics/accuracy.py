"""How far a geodesic table is from the exact distances on the mesh, from sampled sources."""

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
    """Relative errors of a table over the pairs with an exact distance up to d_max.

    Attributes
    ----------
    sources, pairs : int
        Sampled sources, and pairs compared.
    mean, p99, worst : float
        Mean, 99th percentile and maximum of |D / exact - 1|.
    worst_far : float
        Maximum over pairs farther than three mean edges apart.
    bias : float
        Mean of D / exact - 1.
    missing : int
        Pairs nearer than d_max, by more than 1 %, that the table lacks.
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
        """Return a line for people, errors in percent."""
        return (
            f"{self.pairs} pairs of {self.sources} sources: error mean {100 * self.mean:.3f} %, "
            f"p99 {100 * self.p99:.3f} %, max {100 * self.worst:.2f} % (beyond {FAR_EDGES:.0f} edges "
            f"{100 * self.worst_far:.2f} %), bias {100 * self.bias:+.3f} %, missing {self.missing}"
        )


def measure_accuracy(
    mesh: TriangleMesh, table: GeodesicTable, n_sources: int = 32, seed: int = 0, tick: Tick = no_tick
) -> Accuracy:
    """Compare rows of a table with the exact polyhedral distances (Mitchell, Mount, Papadimitriou 1987).

    Parameters
    ----------
    mesh : TriangleMesh
    table : GeodesicTable
        Of the mesh.
    n_sources : int
        Vertices whose rows are compared; all if there are fewer.
    seed : int
        Which vertices; same seed, same ones.
    tick : Tick
        Called once per source.

    Returns
    -------
    Accuracy

    Raises
    ------
    InputError
        If the exact solver is not installed.
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
