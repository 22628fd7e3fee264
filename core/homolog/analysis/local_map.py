"""Local maps: a test at every particle, corrected over the surface.

Each particle's position is tested by Hotelling's T² (Wilks' lambda for several columns). Over the surface,
family-wise error is held by the permutation distribution of the largest statistic (Westfall and Young 1993)
and the false discovery rate by Benjamini and Hochberg (1995).
"""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from homolog.analysis.checks import checked_particles
from homolog.analysis.design import Design
from homolog.analysis.permutation import Relabelling, counted_p, relabellings
from homolog.analysis.threads import on_one_thread
from homolog.analysis.wilks import wilks_p
from homolog.arrays import FloatArray, frozen
from homolog.errors import InputError
from homolog.progress import Tick, no_tick

__all__ = ["LocalMap", "LocalStatistic", "local_map"]

_CHUNK_VALUES = 2_000_000
_FLAT = 1e-12
"""Part of the largest variance below which a direction at a particle holds no variation."""


@dataclass(frozen=True, slots=True, eq=False)
class LocalMap:
    """Tests at each particle. Arrays are read-only.

    Attributes
    ----------
    effect : (d, N, 3) array
        Coefficients of the tested columns: group differences, or change per unit [mm].
    explained : (N,) array
        1 - Wilks' lambda, the statistic: share of variance explained, in [0, 1].
    p : (N,) array
        Parametric, for each particle by itself, not corrected.
    p_family : (N,) array
        Corrected: chance that any particle of the surface shows such a statistic without an effect.
    q : (N,) array
        Benjamini-Hochberg: false discovery rate at which the particle is found.
    permutations : int
        Number of relabellings.
    """

    effect: FloatArray
    explained: FloatArray
    p: FloatArray
    p_family: FloatArray
    q: FloatArray
    permutations: int

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in ("effect", "explained", "p", "p_family", "q"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.float64))


class LocalStatistic:
    """1 - Wilks' lambda at every particle for any relabelling of a design.

    Parameters
    ----------
    residuals : (M, N, 3) array
        Positions with the nuisance columns of the design regressed out [mm].
    """

    def __init__(self, residuals: FloatArray) -> None:
        # Whitened positions: 1 - lambda doesn't depend on the axes, and their scatter is the identity.
        scatter = np.einsum("mni,mnj->nij", residuals, residuals)
        values, vectors = np.linalg.eigh(scatter)
        kept = values > _FLAT * max(float(values.max()), np.finfo(float).tiny)
        scale = np.where(kept, 1.0 / np.sqrt(np.where(kept, values, 1.0)), 0.0)
        white = np.einsum("mni,nij->jmn", residuals, vectors * scale[:, None, :])
        self._white = np.ascontiguousarray(white)
        self.variables = int(kept.sum(axis=1).max())
        self.particles = residuals.shape[1]

    def explained(self, relabelling: Relabelling) -> FloatArray:
        """Return 1 - Wilks' lambda, shape (c, N)."""
        total = self._left_over(_squares(self._across(relabelling.covariates)))
        both = np.concatenate([relabelling.covariates, relabelling.tested], axis=2)
        error = self._left_over(_squares(self._across(both)))
        explained: FloatArray = 1.0 - np.clip(error / np.maximum(total, np.finfo(float).tiny), 0.0, 1.0)
        return explained

    def _across(self, columns: FloatArray) -> list[FloatArray]:
        """Inner products of the columns (c, M, q) with each whitened axis: three arrays (q, c, N)."""
        across = np.ascontiguousarray(columns.transpose(2, 0, 1))
        return [across @ axis for axis in self._white]

    @staticmethod
    def _left_over(squares: FloatArray) -> FloatArray:
        """Return the determinant of identity minus the scatter taken out, (6, c, N) to (c, N)."""
        xx, yy, zz, xy, xz, yz = squares
        a, b, c = 1.0 - xx, 1.0 - yy, 1.0 - zz
        determinant: FloatArray = a * b * c - 2.0 * xy * xz * yz - a * yz**2 - b * xz**2 - c * xy**2
        return determinant


@on_one_thread
def local_map(
    particles: FloatArray,
    design: Design,
    *,
    permutations: int = 10_000,
    seed: int = 0,
    tick: Tick = no_tick,
) -> LocalMap:
    """Test every particle for the effect of a design.

    Parameters
    ----------
    particles : (M, N, 3) array_like
        Aligned positions, or differences of pairs [mm].
    design : Design
        What is tested.
    permutations : int
        Relabellings for the correction over the surface.
    seed : int
        Same seed, same result.
    tick : Tick
        Progress and cancelling.

    Raises
    ------
    InputError
        If there are too few subjects to test a position in three dimensions.
    """
    shapes = checked_particles(particles)
    if design.error_dof < 3:
        raise InputError(
            f"local maps need at least 3 degrees of freedom for the error, not {design.error_dof}; "
            "use more subjects or fewer covariates"
        )
    rows = shapes.reshape(len(shapes), -1)
    statistic = LocalStatistic(design.residuals(rows).reshape(shapes.shape))
    explained = statistic.explained(Relabelling(design.tested[None], design.covariates[None]))[0]
    largest = np.empty(permutations)
    done = 0
    chunk = max(1, _CHUNK_VALUES // (statistic.particles * design.tested.shape[1]))
    for some in relabellings(design, permutations, chunk=chunk, seed=seed):
        tick(done / permutations, "permutations of the local map")
        largest[done : done + len(some.tested)] = statistic.explained(some).max(axis=1)
        done += len(some.tested)
    p = wilks_p(1.0 - explained, statistic.variables, design.tested.shape[1], design.error_dof)
    return LocalMap(
        effect=design.coefficients(rows).reshape(-1, *shapes.shape[1:]),
        explained=explained,
        p=p,
        p_family=counted_p(explained, largest),
        q=stats.false_discovery_control(p),
        permutations=permutations,
    )


def _squares(across: list[FloatArray]) -> FloatArray:
    """Return xx, yy, zz, xy, xz, yz summed over columns, shape (6, c, N)."""
    x, y, z = across
    pairs = ((x, x), (y, y), (z, z), (x, y), (x, z), (y, z))
    return np.stack([np.einsum("qcn,qcn->cn", one, other) for one, other in pairs])
