"""A frozen ensemble: the statistics of positions and normals of many shapes, for fits of further shapes.

Covariances are stored as leading modes, so that the size does not depend on the number of subjects.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import overload

import numpy as np
from scipy.sparse.linalg import eigsh

from homolog.arrays import Array, Float32Array, FloatArray, frozen
from homolog.geometry import scale_of, transform_points
from homolog.memory import Store, in_memory
from homolog.settings import OptimizeSettings

__all__ = ["Ensemble", "ShapeState", "StateArrays", "generalization_error", "make_ensemble"]

_MOST_MODES = 256
_FOLDS, _COMPARED_MODES = 5, 10
_NEGLIGIBLE = 0.02
"""Modes of less variance than this fraction of the last regularization have no effect and are left out."""
_DENSE = 1500
"""Largest Gram matrix [rows] that is decomposed as a whole."""
_PARTICLES, _SUBJECTS = 32, 256
"""Largest number of particles or subjects for which float64 values of all others are in memory."""


@dataclass(frozen=True, slots=True, eq=False)
class ShapeState:
    """One shape's particles and their data for the ensemble.

    Attributes
    ----------
    local : (n, 3) float64 array
        In file coordinates [mm].
    aligned : (n, 3) float32 array
        As posed, in the optimizer's coordinates.
    normals : (n, 3) float32 array
        Outward unit normals, as posed.
    openings : (n,) float32 array
        Weighted opening angles.
    placement : (4, 4) float64 array
        From file to the optimizer's coordinates; a reflection for a mirrored subject.
    """

    local: FloatArray
    aligned: Float32Array
    normals: Float32Array
    openings: Float32Array
    placement: FloatArray


class StateArrays(Sequence[ShapeState]):
    """The states of many shapes, as arrays with a first axis of shapes, which may be memory-mapped.

    Parameters
    ----------
    count, particles : int
    store : Store
        Storage of the arrays.

    Attributes
    ----------
    local, aligned, normals, openings, placement : arrays
        See `ShapeState`.
    """

    def __init__(self, count: int, particles: int, store: Store = in_memory) -> None:
        self.local = store(np.empty((count, particles, 3)))
        self.aligned = store(np.empty((count, particles, 3), np.float32))
        self.normals = store(np.empty((count, particles, 3), np.float32))
        self.openings = store(np.empty((count, particles), np.float32))
        self.placement = store(np.empty((count, 4, 4)))

    @classmethod
    def of(cls, states: Sequence[ShapeState]) -> "StateArrays":
        """Return the arrays of some states."""
        arrays = cls(len(states), len(states[0].local))
        for index, state in enumerate(states):
            arrays[index] = state
        return arrays

    def __len__(self) -> int:
        """Return the number of shapes."""
        return len(self.local)

    @overload
    def __getitem__(self, index: int) -> ShapeState: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[ShapeState]: ...

    def __getitem__(self, index: int | slice) -> ShapeState | Sequence[ShapeState]:
        """Return the state of a shape, or of several; views, not copies."""
        if isinstance(index, slice):
            return [self[place] for place in range(len(self))[index]]
        return ShapeState(**{field.name: getattr(self, field.name)[index] for field in fields(ShapeState)})

    def __setitem__(self, index: int, state: ShapeState) -> None:
        """Copy the state of a shape into the arrays."""
        for field in fields(ShapeState):
            getattr(self, field.name)[index] = getattr(state, field.name)

    @property
    def scale(self) -> float:
        """Geometric mean of the scales of the placements."""
        return float(np.exp(np.log(scale_of(self.placement)).mean()))

    def rescale(self, scale: float) -> None:
        """Scale the placements to a mean scale, about the centre of all particles."""
        growth, centre = scale / self.scale, self.aligned.mean(axis=(0, 1), dtype=np.float64)
        step = np.eye(4)
        step[:3, :3] *= growth
        step[:3, 3] = (1.0 - growth) * centre
        self.placement[:] = step @ np.asarray(self.placement)
        for index in range(len(self)):
            self.aligned[index] = transform_points(step, self.aligned[index].astype(np.float64))

    def extrapolate(self, newer: "StateArrays", factor: float) -> None:
        """Replace aligned particles, normals and opening angles by newer ones plus a share of the motion."""
        for index in range(len(self)):
            for name in ("aligned", "normals", "openings"):
                before, now = getattr(self, name)[index], getattr(newer, name)[index]
                getattr(self, name)[index] = now + np.float32(factor) * (now - before)
            lengths = np.linalg.norm(self.normals[index], axis=1, keepdims=True)
            self.normals[index] /= np.maximum(lengths, 1e-12)


@dataclass(frozen=True, slots=True, eq=False)
class Ensemble:
    """Means and modes of many shapes, in the optimizer's coordinates. Arrays are read-only.

    Attributes
    ----------
    unit : (1,) array
        Optimizer's unit of length [mm of the world frame].
    area : (1,) array
        Surface area of every shape if sizes are removed, else 0.
    opening_scale : (1,) array
        Factor of the opening angles.
    subjects : (1,) array
        Number of shapes from which the covariances are computed.
    mean, normals : (n, 3) arrays
        Mean positions and mean unit normals.
    openings : (n,) array
        Mean opening angles, weighted.
    angles : (n,) array
        Median angle between a shape's normal and the mean one [rad].
    position_modes, normal_modes : (r, 3n) float32 arrays
        Modes, as unit rows.
    position_variances, normal_variances : (r,) arrays
        Variances along the modes, per particle.
    templates : (K, n, 3) float32 array
        Aligned particles of some shapes, which are transferred to new shapes as first particles.
    placements : (K, 4, 4) array
        Placements of the templates, from file coordinates.
    """

    unit: FloatArray
    area: FloatArray
    opening_scale: FloatArray
    subjects: FloatArray
    mean: FloatArray
    normals: FloatArray
    openings: FloatArray
    angles: FloatArray
    position_modes: Float32Array
    position_variances: FloatArray
    normal_modes: Float32Array
    normal_variances: FloatArray
    templates: Float32Array
    placements: FloatArray

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in self.__dataclass_fields__:
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @property
    def arrays(self) -> Mapping[str, Array]:
        """All fields by name, as `Ensemble` takes them."""
        return {name: getattr(self, name) for name in self.__dataclass_fields__}

    @property
    def scale(self) -> float:
        """Number of particles times subjects, which covariances are divided by."""
        return float(len(self.mean) * self.subjects[0])

    def rest_of_positions(self, row: FloatArray, regularization: float) -> FloatArray:
        """Return a (S + aI)^-1 y of deviations from the mean (3n,): what the modes do not explain."""
        return _rest(row, self.position_modes, self.position_variances, regularization)

    def rest_of_normals(self, row: FloatArray, regularization: float) -> FloatArray:
        """Return the same of Logs of normals (3n,)."""
        return _rest(row, self.normal_modes, self.normal_variances, regularization)

    def deviation(self, aligned: FloatArray) -> FloatArray:
        """Return positions (n, 3) minus the mean, flat."""
        return np.asarray(aligned - self.mean, np.float64).ravel()

    def logs(self, normals: FloatArray, openings: FloatArray) -> FloatArray:
        """Return the Logs of unit normals (..., n, 3), with opening angles along the mean normals."""
        tangential = log_maps(self.normals, np.asarray(normals, np.float64))
        return tangential + (openings - self.openings)[..., None] * self.normals


def make_ensemble(
    states: Sequence[ShapeState],
    settings: OptimizeSettings,
    *,
    unit: float,
    area: float,
    opening_scale: float,
    templates: Sequence[int],
    workspace: Float32Array | None = None,
) -> Ensemble:
    """Return the ensemble of some shapes.

    Parameters
    ----------
    states : sequence of M ShapeState
        All aligned with each other.
    settings : OptimizeSettings
        Of the run.
    unit, area, opening_scale
        See `Ensemble`.
    templates : sequence of int
        Indices of the shapes that become templates.
    workspace : (M, 3n) float32 array, optional
        Overwritten; may be memory-mapped.
    """
    arrays = states if isinstance(states, StateArrays) else StateArrays.of(states)
    aligned, normals, openings = arrays.aligned, arrays.normals, arrays.openings
    count, n = aligned.shape[:2]
    rows = np.empty((count, 3 * n), np.float32) if workspace is None else workspace
    mean = aligned.mean(axis=0, dtype=np.float64)
    mean_normals = _mean_normals(normals)
    middle = openings.mean(axis=0, dtype=np.float64)
    for index in range(count):  # one at a time: all in float64 would need twice the memory
        rows[index] = (aligned[index] - mean).ravel()
    least = _NEGLIGIBLE * settings.regularization_end
    position = _modes(rows, float(n * max(count - 1, 1)), least)
    for index in range(count):
        tangential = log_maps(mean_normals, normals[index].astype(np.float64))
        rows[index] = (tangential + (openings[index] - middle)[:, None] * mean_normals).ravel()
    normal = _modes(rows, float(n * max(count - 1, 1)), 1e-5)
    chosen = list(templates)
    return Ensemble(
        unit=np.array([unit]),
        area=np.array([area]),
        opening_scale=np.array([opening_scale]),
        subjects=np.array([float(count)]),
        mean=mean,
        normals=mean_normals,
        openings=middle,
        angles=_median_angles(normals, mean_normals),
        position_modes=position[0],
        position_variances=position[1],
        normal_modes=normal[0],
        normal_variances=normal[1],
        templates=aligned[chosen],
        placements=np.array([states[index].placement for index in chosen]).reshape(-1, 4, 4),
    )


def generalization_error(aligned: Float32Array, workspace: Float32Array | None = None) -> float:
    """Return the distance of subjects from the first modes of the others, root mean square per particle.

    Parameters
    ----------
    aligned : (M, n, 3) float32 array
        Each fifth of the subjects is compared with the ten leading modes of all others.
    workspace : (M, 3n) float32 array, optional
        Overwritten; may be memory-mapped.
    """
    count, n = aligned.shape[:2]
    rows, fold, total = aligned.reshape(count, -1), np.arange(count) % _FOLDS, 0.0
    room = np.empty_like(rows) if workspace is None else workspace
    for left_out in range(min(_FOLDS, count)):
        others = np.flatnonzero(fold != left_out)
        known = room[: len(others)]
        for place, index in enumerate(others):
            known[place] = rows[index]
        mean = known.mean(axis=0, dtype=np.float64)
        for place in range(len(known)):
            known[place] = known[place] - mean
        modes, _ = _modes(known, float(n * max(len(known) - 1, 1)), 0.0)
        modes, own = modes[:_COMPARED_MODES], np.flatnonzero(fold == left_out)
        for start in range(0, len(own), _SUBJECTS):
            apart = rows[own[start : start + _SUBJECTS]] - mean
            total += float(np.square(apart - (apart @ modes.T) @ modes).sum())
    return float(np.sqrt(total / (count * n)))


def log_maps(means: FloatArray, normals: FloatArray) -> FloatArray:
    """Return Logs (..., n, 3) of unit normals at mean normals (n, 3)."""
    cosine = np.clip(np.einsum("...ni,ni->...n", normals, means), -1.0 + 1e-4, 1.0)
    angle = np.arccos(cosine)
    factor = np.where(angle > 1e-4, angle / np.maximum(np.sin(angle), 1e-12), 1.0)
    result: FloatArray = factor[..., None] * (normals - cosine[..., None] * means)
    return result


def _mean_normals(normals: Float32Array) -> FloatArray:
    """Return the Fréchet means of unit normals (M, n, 3) over the shapes, (n, 3)."""
    mean = normals.sum(axis=0, dtype=np.float64)
    mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-12)
    for _ in range(5):
        shift = np.zeros_like(mean)
        for normal in normals:
            shift += log_maps(mean, normal.astype(np.float64))
        shift /= len(normals)
        angle = np.linalg.norm(shift, axis=1, keepdims=True)
        mean = np.cos(angle) * mean + np.sinc(angle / np.pi) * shift
        mean /= np.linalg.norm(mean, axis=1, keepdims=True)
    return np.asarray(mean, np.float64)


def _median_angles(normals: Float32Array, mean_normals: FloatArray) -> FloatArray:
    """Return the median angles of unit normals (M, n, 3) to their means (n, 3) over the shapes, (n,)."""
    angles = np.empty(len(mean_normals))
    for start in range(0, len(angles), _PARTICLES):
        some = slice(start, start + _PARTICLES)
        cosines = np.einsum("mni,ni->mn", normals[:, some], mean_normals[some])
        angles[some] = np.median(np.arccos(np.clip(cosines, -1.0, 1.0)), axis=0)
    return angles


def _modes(rows: Float32Array, divisor: float, least: float) -> tuple[Float32Array, FloatArray]:
    """Return the leading modes of centred rows (M, P), (r, P), and their variances (r,)."""
    dual = rows.shape[0] <= rows.shape[1]
    gram = np.zeros((min(rows.shape), min(rows.shape)))
    width = max(rows.shape)
    for start in range(0, width, 2048):  # float64 of a block at a time
        part = rows[:, start : start + 2048] if dual else rows[start : start + 2048].T
        wide = part.astype(np.float64)
        gram += wide @ wide.T
    gram /= divisor
    if len(gram) <= _DENSE:
        variances, vectors = np.linalg.eigh(gram)
    else:
        begin = np.random.default_rng(0).standard_normal(len(gram))
        variances, vectors = eigsh(gram, _MOST_MODES, which="LA", v0=begin)
    order = np.argsort(variances)[::-1][:_MOST_MODES]
    order = order[variances[order] > max(least, 1e-9 * float(variances.max()))]
    variances, vectors = variances[order], vectors[:, order]
    modes = vectors.T @ rows if dual else vectors.T
    modes = modes / np.maximum(np.linalg.norm(modes, axis=1, keepdims=True), 1e-30)
    return modes.astype(np.float32), np.asarray(variances, np.float64)


def _rest(row: FloatArray, modes: Float32Array, variances: FloatArray, regularization: float) -> FloatArray:
    along = modes @ row.astype(np.float32)
    explained = (variances / (variances + regularization) * along).astype(np.float32) @ modes
    return np.asarray(row - explained, np.float64)
