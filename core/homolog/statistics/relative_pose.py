"""Relative pose of structures, apart from their shapes.

Each structure is aligned with its like without scaling, which leaves its form (shape and size). The
similarity from its mean to a subject, seen from that of a reference structure, is its relative pose. In units
of the displacement of particles, pose and form add up to the total variance:

    sum over particles of |w x x + t|^2 = n |t|^2 + w' I w,    I = sum of |x|^2 - x x'

for a rotation vector w and a translation t about the centre of the mean particles x.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import sqrtm
from scipy.spatial.transform import Rotation

from homolog.arrays import FloatArray, frozen
from homolog.geometry import fit_similarity, rotation_of, scale_of
from homolog.statistics.procrustes import align
from homolog.statistics.shape_model import principal_components

__all__ = ["Components", "RelativePoses", "relative_poses"]

_STEPS, _STEADY = 50, 1e-12  # of the mean rotation: at most, and the angle [rad] of a last one


@dataclass(frozen=True, slots=True, eq=False)
class Components:
    """Principal components of poses and forms together. Arrays are read-only.

    Attributes
    ----------
    parts : tuple of str
        ``pose NAME`` for each structure but the reference, then ``shape NAME`` for each.
    variances : (P,) array
        Variance in each part, per particle of all structures [mm²]; their sum is the total.
    standard_deviations : (K,) array
        Of the components [mm], root mean square over the particles.
    shares : (K, P) array
        Share of each part in the variance of a component; each row sums to 1.
    scores : (M, K) array
        Of the subjects [mm].
    """

    parts: tuple[str, ...]
    variances: FloatArray
    standard_deviations: FloatArray
    shares: FloatArray
    scores: FloatArray

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in ("variances", "standard_deviations", "shares", "scores"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.float64))


@dataclass(frozen=True, slots=True, eq=False)
class RelativePoses:
    """Poses of S structures of M subjects against that of a reference structure. Arrays are read-only.

    Attributes
    ----------
    names : tuple of S str
    reference : int
        Index of the reference structure; its rotations and translations are 0.
    rotations : (M, S, 3) array
        Rotation vectors from the mean relative pose [degrees], along the axes of the aligned reference.
    translations : (M, S, 3) array
        Displacements of the centres from their mean place [mm], along the same axes.
    sizes : (M, S) array
        Sizes of the structures relative to their geometric mean, over that of the reference; for the
        reference, over its geometric mean.
    forms : tuple of S (M, n, 3) arrays
        Particles of each structure, aligned with its like [mm].
    """

    names: tuple[str, ...]
    reference: int
    rotations: FloatArray
    translations: FloatArray
    sizes: FloatArray
    forms: tuple[FloatArray, ...]

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in ("rotations", "translations", "sizes"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.float64))
        object.__setattr__(self, "forms", tuple(frozen(form, np.float64) for form in self.forms))

    def moved(self, name: str) -> FloatArray:
        """Return the mean of a structure, moved by each subject's relative pose alone, (M, n, 3) [mm].

        Whatever compares shapes compares poses on it, if these are taken as they lie.
        """
        index = self.names.index(name)
        points = self.forms[index].mean(axis=0)
        centre = points.mean(axis=0)
        turns = Rotation.from_rotvec(self.rotations[:, index], degrees=True).as_matrix()
        turned: FloatArray = np.einsum("mij,nj->mni", turns, points - centre)
        return np.asarray(turned + (centre + self.translations[:, index])[:, None])

    def components(self) -> Components:
        """Return the principal components of all relative poses and forms."""
        features, parts = [], []
        for index, name in enumerate(self.names):
            if index != self.reference:
                parts.append(f"pose {name}")
                moves = np.sqrt(self.forms[index].shape[1]) * self.displacements(name)
                features.append(moves.reshape(len(moves), -1))
        for name, form in zip(self.names, self.forms, strict=True):
            parts.append(f"shape {name}")
            features.append((form - form.mean(axis=0)).reshape(len(form), -1))
        count = sum(form.shape[1] for form in self.forms)
        rows = np.concatenate(features, axis=1) / np.sqrt(count)
        scores, modes, variances = principal_components(rows)
        ends = np.cumsum([0] + [item.shape[1] for item in features])
        squares = np.add.reduceat(np.square(modes), ends[:-1], axis=1)
        shares = squares / squares.sum(axis=1, keepdims=True)
        own = np.array([item.var(axis=0, ddof=1).sum() for item in features]) / count
        return Components(tuple(parts), own, np.sqrt(variances), shares, scores)

    def leverage(self, name: str) -> FloatArray:
        """Return the matrix (3, 3) from a rotation vector to displacements of a structure's particles.

        Its product with a rotation vector [radians] has as length their root mean square [mm].
        """
        points = self.forms[self.names.index(name)].mean(axis=0)
        points = points - points.mean(axis=0)
        inertia = np.square(points).sum() * np.eye(3) - points.T @ points
        return np.asarray(np.real(sqrtm(inertia / len(points))))

    def displacements(self, name: str) -> FloatArray:
        """Return each subject's turn and shift of a structure, (M, 2, 3) [mm].

        Their squares sum to the mean square displacement of the structure's particles. Whatever compares
        shapes compares them as two points, if these are taken as they lie.
        """
        index = self.names.index(name)
        turns = np.radians(self.rotations[:, index]) @ self.leverage(name)
        return np.stack([turns, self.translations[:, index]], axis=1)


def relative_poses(
    structures: Sequence[FloatArray], names: Sequence[str], reference: int = 0
) -> RelativePoses:
    """Separate the relative poses of structures from their forms.

    Parameters
    ----------
    structures : sequence of S (M, n, 3) arrays
        Particles of each structure of all subjects, as they lie to each other [mm].
    names : sequence of S str
    reference : int
        Index of the structure from which the others are seen.

    Returns
    -------
    RelativePoses
    """
    forms = [align(item, scaling=False) for item in structures]
    fits = np.array(
        [
            [fit_similarity(form.mean(axis=0), own, scaling=True) for own in item]
            for form, item in zip(forms, structures, strict=True)
        ]
    )  # (S, M, 4, 4)
    turns, scales = rotation_of(fits), scale_of(fits)
    centres = np.array([item.mean(axis=1) for item in structures])  # (S, M, 3)
    base = turns[reference]
    rotations, translations = [], []
    for turn, centre in zip(turns, centres, strict=True):
        seen = Rotation.from_matrix(np.einsum("mji,mjk->mik", base, turn))
        rotations.append((seen * _mean_of(seen).inv()).as_rotvec(degrees=True))
        place = np.einsum("mji,mj->mi", base, centre - centres[reference])
        translations.append(place - place.mean(axis=0))
    sizes = scales / np.exp(np.log(scales).mean(axis=1, keepdims=True))
    sizes = np.where(np.arange(len(sizes))[:, None] == reference, sizes, sizes / sizes[reference])
    return RelativePoses(
        tuple(names),
        reference,
        np.stack(rotations, axis=1),
        np.stack(translations, axis=1),
        sizes.T,
        tuple(forms),
    )


def _mean_of(turns: Rotation) -> Rotation:
    """Return the Fréchet mean of rotations, from which their rotation vectors sum to 0."""
    mean = turns.mean()
    for _ in range(_STEPS):
        step = (turns * mean.inv()).as_rotvec().mean(axis=0)
        mean = Rotation.from_rotvec(step) * mean
        if np.linalg.norm(step) < _STEADY:
            break
    return mean
