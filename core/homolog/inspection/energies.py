"""The three terms of the objective, by particle."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from homolog.arrays import Float32Array, FloatArray, frozen
from homolog.geometry import scale_of
from homolog.inspection.located_particles import LocatedParticles
from homolog.inspection.neighbourhood import Neighbourhood
from homolog.registration.entropy import covariance
from homolog.settings import OptimizeSettings

__all__ = ["ParticleEnergies", "particle_energies", "shared_entropy"]

_WIDTH_ROUNDS = 30
_EVEN_WIDTH = 1.0 / np.sqrt(np.pi)
"""Parzen width of an even layout, in spacings; as in the optimizer, widths are limited to these fractions of
it:"""
_NARROWEST, _WIDEST = 0.1, 1.2
_NORMALS_REGULARIZATION = 0.01
"""Regularization of the normals at the end of a run [rad²]."""


@dataclass(frozen=True, slots=True, eq=False)
class ParticleEnergies:
    """Contribution of each particle to the energies, (M, N) each, read-only; lower is better.

    Attributes
    ----------
    sampling : array
        log A - 3 log s from geodesic distances in spacings: large where particles are dense.
    ensemble, normals : array
        Contributions to H(Z) and H(V), whose mean over particles and subjects is the entropy: large where
        positions, or normals, have individual differences between subjects.
    """

    sampling: FloatArray
    ensemble: FloatArray
    normals: FloatArray


def particle_energies(
    located: LocatedParticles, consensus: Neighbourhood, settings: OptimizeSettings
) -> ParticleEnergies:
    """Return the contribution of each particle to the energies of a result.

    Parameters
    ----------
    located : LocatedParticles
        Particles of the result, with their normals.
    consensus : Neighbourhood
        Consensus of all subjects.
    settings : OptimizeSettings
        Settings of the run.

    Returns
    -------
    ParticleEnergies
    """
    positions = (located.world - located.world.mean(axis=0)) / _length(located)
    cosine = np.clip(np.einsum("mni,ni->mn", located.normals, consensus.normals), -1.0 + 1e-9, 1.0)
    factor = 1.0 / np.sinc(np.arccos(cosine) / np.pi)
    logs = factor[:, :, None] * (located.normals - cosine[:, :, None] * consensus.normals)
    return ParticleEnergies(
        frozen(_sampling(located.distances)),
        frozen(shared_entropy(positions, settings.regularization_end)),
        frozen(shared_entropy(logs, _NORMALS_REGULARIZATION)),
    )


def _areas(located: LocatedParticles) -> FloatArray:
    """Return the areas of the aligned surfaces [mm²], (M,)."""
    return np.array([mesh.area for mesh in located.meshes]) * scale_of(located.alignments) ** 2


def _length(located: LocatedParticles) -> float:
    """Return the optimizer's unit of length [mm]."""
    return 0.01 * float(np.sqrt(_areas(located).mean()))


def shared_entropy(rows: FloatArray, regularization: float) -> FloatArray:
    """Decompose the optimizer's entropy (M-1)/2M log det(I + C/a) by particles, (M, N, 3) to (M, N).

    With C = Y Y'/(N (M-1)) and G = C^-1 log(I + C/a) the trace of G C is the logarithm of the determinant, a
    sum over subjects and particles of (G Y) times Y. The contributions are scaled so that their mean is the
    entropy.
    """
    shapes = len(rows)
    flat: Float32Array = rows.reshape(shapes, -1).astype(np.float32)
    values, vectors = np.linalg.eigh(covariance(flat))
    values = np.maximum(values, 0.0)
    small = 1e-9 * regularization
    slopes = np.where(
        values > small, np.log1p(values / regularization) / np.maximum(values, small), 1 / regularization
    )
    pulled = ((vectors * slopes) @ vectors.T @ rows.reshape(shapes, -1)).reshape(rows.shape)
    return np.asarray(0.5 * np.einsum("mni,mni->mn", pulled, rows))


def _sampling(distances: Sequence[csr_array]) -> FloatArray:
    return np.stack([_crowding(distance) for distance in distances])


def _crowding(distances: csr_array) -> FloatArray:
    """Return log A - 3 log s of each particle with s at its fixed point s² = Σ w d² / 3 Σ w."""
    n = distances.shape[0]
    rows = np.repeat(np.arange(n), np.diff(distances.indptr))
    squared = np.square(distances.data)
    width = np.full(n, _EVEN_WIDTH)
    for _ in range(_WIDTH_ROUNDS):
        weight = np.exp(-0.5 * squared / np.square(width)[rows])
        mass = np.bincount(rows, weight, n)
        spread = np.bincount(rows, weight * squared, n)
        radius = np.where(mass > 1e-12, np.sqrt(spread / np.maximum(3.0 * mass, 1e-12)), np.inf)
        width = np.clip(0.5 * (width + radius), _NARROWEST * _EVEN_WIDTH, _WIDEST * _EVEN_WIDTH)
    weight = np.exp(-0.5 * squared / np.square(width)[rows])
    return np.asarray(np.log(np.maximum(np.bincount(rows, weight, n), 1e-12)) - 3.0 * np.log(width))
