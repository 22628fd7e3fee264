"""Parallel analysis: the number of modes with more variance than uncorrelated data (Horn 1965)."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from homolog.arrays import FloatArray, frozen
from homolog.progress import Tick, no_tick
from homolog.threads import on_one_thread

__all__ = ["Null", "ParallelAnalysis", "parallel_analysis"]


MOST = 400
"""Largest size of the Gram matrix of null data; of larger null data a part is drawn."""


class Null(StrEnum):
    """How null data are generated."""

    PERMUTATION = "permutation"
    """Each coordinate is permuted separately among the subjects: this removes only correlations."""
    GAUSSIAN = "gaussian"
    """Each coordinate is drawn from a normal distribution with its variance in the data."""
    SIGNS = "signs"
    """Each coordinate of each subject gets a random sign: the null of differences about zero."""


@dataclass(frozen=True, slots=True, eq=False)
class ParallelAnalysis:
    """Eigenvalues of the data and of data without correlation. Arrays are read-only.

    Attributes
    ----------
    eigenvalues : (K,) array
        Eigenvalues of the data [mm²].
    threshold : (K,) array
        Percentile of each eigenvalue under the null [mm²].
    null_mean : (K,) array
        Mean of each eigenvalue under the null [mm²].
    n_retained : int
        Number of leading modes above the threshold, up to the first below it.
    null : Null
        The kind of null data.
    percentile : float
        Percentile of the threshold, in percent.
    repeats : int
        Number of null data sets.
    """

    eigenvalues: FloatArray
    threshold: FloatArray
    null_mean: FloatArray
    n_retained: int
    null: Null
    percentile: float
    repeats: int

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in ("eigenvalues", "threshold", "null_mean"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.float64))


@on_one_thread
def parallel_analysis(
    data: FloatArray,
    *,
    nuisance: FloatArray | None = None,
    null: Null = Null.PERMUTATION,
    repeats: int = 200,
    percentile: float = 95.0,
    seed: int = 0,
    tick: Tick = no_tick,
) -> ParallelAnalysis:
    """Count the modes whose variance exceeds that of the same mode in uncorrelated data.

    The spectrum of large uncorrelated data depends only on the variances of the coordinates and on the number
    of coordinates per subject (Marchenko and Pastur 1967). For large cohorts each null data set therefore
    uses a random fraction of the subjects and the same fraction of the coordinates, and its eigenvalues are
    interpolated. The largest eigenvalues then vary more than those of whole data: the threshold is some
    tenths of a percent higher.

    Parameters
    ----------
    data : (M, N, 3) or (M, P) array
        One row for each subject [mm].
    nuisance : (M, q) array, optional
        Orthonormal columns that are regressed out of data and null data; by default the intercept, which
        centres the rows. Without columns rows are unchanged.
    null : Null
        How null data are generated.
    repeats : int
        Number of null data sets.
    percentile : float
        A mode is retained above this percentile of its null distribution.
    seed : int
        Same seed, same result.
    tick : Tick
        Progress and cancellation.

    Returns
    -------
    ParallelAnalysis
    """
    subjects = len(data)
    if nuisance is None:
        nuisance = np.full((subjects, 1), 1.0 / np.sqrt(subjects))
    rows = _without(np.asarray(data, dtype=np.float64).reshape(subjects, -1), nuisance)
    dof = subjects - nuisance.shape[1]
    modes = min(dof, rows.shape[1])
    # Regressing covariates out of shuffled residuals removes their share of the variance a second time.
    restored = (subjects - 1) / dof if nuisance.shape[1] else 1.0
    generator = np.random.default_rng(seed)
    null_eigenvalues = np.empty((repeats, modes))
    part = _Part.of(rows, nuisance)
    for repeat in range(repeats):
        tick(repeat / repeats, "parallel analysis")
        if part is not None:
            null_eigenvalues[repeat] = restored * part.eigenvalues(null, generator, modes)
            continue
        null_rows = _without(_null_rows(rows, null, generator), nuisance)
        null_eigenvalues[repeat] = _spectrum(null_rows)[:modes] * (restored / dof)
    eigenvalues = _spectrum(rows)[:modes] / dof
    threshold = np.percentile(null_eigenvalues, percentile, axis=0)
    above = eigenvalues > threshold
    n_retained = modes if above.all() else int(above.argmin())
    null_mean = null_eigenvalues.mean(axis=0)
    return ParallelAnalysis(eigenvalues, threshold, null_mean, n_retained, null, percentile, repeats)


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """Draws null data of a part of the subjects and of the coordinates.

    Attributes
    ----------
    rows : (M, P) array
        Coordinates in the order of their variance.
    nuisance : (M, q) array
    factor : float
        Ratio of all subjects and coordinates to those drawn.
    """

    rows: FloatArray
    nuisance: FloatArray
    factor: float

    @classmethod
    def of(cls, rows: FloatArray, nuisance: FloatArray) -> "_Part | None":
        """Return the part for some data; None if they are small enough to be drawn as a whole."""
        factor = min(rows.shape) / MOST
        if factor <= 1.0:
            return None
        order = np.argsort(np.square(rows).sum(axis=0), kind="stable")
        return cls(rows[:, order], nuisance, factor)

    def eigenvalues(self, null: Null, generator: np.random.Generator, modes: int) -> FloatArray:
        """Return the eigenvalues of a null data set, (modes,)."""
        subjects, width = (round(size / self.factor) for size in self.rows.shape)
        chosen = np.sort(generator.choice(len(self.rows), subjects, replace=False))
        places = (np.arange(width) + generator.random(width)) * (self.rows.shape[1] / width)
        sample = self.rows[np.ix_(chosen, np.minimum(places.astype(np.int64), self.rows.shape[1] - 1))]
        nuisance = np.linalg.qr(self.nuisance[chosen])[0]
        squares = _spectrum(_without(_null_rows(sample, null, generator), nuisance))
        values = squares[: subjects - nuisance.shape[1]] / (subjects - nuisance.shape[1])
        at = (np.arange(len(values)) + 0.5) * self.factor - 0.5
        interpolated: FloatArray = np.interp(np.arange(modes), at, values)
        return interpolated


def _null_rows(rows: FloatArray, null: Null, generator: np.random.Generator) -> FloatArray:
    drawn: FloatArray
    if null is Null.PERMUTATION:
        drawn = generator.permuted(rows, axis=0)
    elif null is Null.GAUSSIAN:
        drawn = generator.standard_normal(rows.shape) * rows.std(axis=0, ddof=1)
    else:
        drawn = rows * generator.choice([-1.0, 1.0], size=rows.shape)
    return drawn


def _without(rows: FloatArray, nuisance: FloatArray) -> FloatArray:
    rest: FloatArray = rows - nuisance @ (nuisance.T @ rows)
    return rest


def _spectrum(rows: FloatArray) -> FloatArray:
    """Squared singular values in descending order, none below zero."""
    gram = rows @ rows.T if len(rows) <= rows.shape[1] else rows.T @ rows
    squares: FloatArray = np.clip(np.linalg.eigvalsh(gram)[::-1], 0.0, None)
    return squares
