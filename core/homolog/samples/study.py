"""A sample study: shapes with common faces, and the parameters that generated them."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from homolog.arrays import FloatArray
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["SampleStudy", "SampleSubject", "Waves", "bump", "step", "turned"]


@dataclass(frozen=True, slots=True)
class SampleSubject:
    """One generated shape.

    Attributes
    ----------
    name : str
        Name of the subject and of its file.
    columns : mapping of str to str
        Columns of the table: group, age, sex, side.
    parameters : mapping of str to float
        Its parameters, with units in the names.
    mesh : TriangleMesh
        Its exact surface in the frame of the file [mm]; vertices correspond across subjects.
    """

    name: str
    columns: Mapping[str, str]
    parameters: Mapping[str, float]
    mesh: TriangleMesh


@dataclass(frozen=True, slots=True)
class SampleStudy:
    """Subjects of one anatomy in two groups.

    Attributes
    ----------
    kind : str
        Anatomy: ``"hearts"``, ``"vertebrae"`` or ``"femora"``.
    subjects : tuple of SampleSubject
        Subjects in the order of their names.
    reference, affected : TriangleMesh
        The average subject without and with the effect of the second group, in one frame [mm].
    voxel : float or None
        Edge of the voxels that subjects are written as [mm]; None if they are written as meshes.
    """

    kind: str
    subjects: tuple[SampleSubject, ...]
    reference: TriangleMesh
    affected: TriangleMesh
    voxel: float | None

    @property
    def effect(self) -> FloatArray:
        """Outward displacement of the second group's surface relative to the first's [mm], (V,)."""
        moved = self.affected.vertices - self.reference.vertices
        return np.asarray((moved * self.reference.vertex_normals).sum(axis=1))


class Waves:
    """A smooth random field in space: the sum of a few waves.

    Parameters
    ----------
    random : numpy.random.Generator
        Random generator.
    length : float
        Typical distance over which it changes [mm].
    scale : float
        Standard deviation of each component.
    components : int
        Number of components of its values.
    """

    def __init__(self, random: np.random.Generator, length: float, scale: float, components: int = 3) -> None:
        count = 24
        self._waves = random.normal(scale=1.0 / length, size=(count, 3))
        self._phases = random.uniform(0.0, 2.0 * np.pi, count)
        self._moves = random.normal(scale=scale * np.sqrt(2.0 / count), size=(count, components))

    def __call__(self, points: FloatArray) -> FloatArray:
        """Return values (N, components) at points (N, 3)."""
        return np.asarray(np.sin(points @ self._waves.T + self._phases) @ self._moves)


def step(values: FloatArray, start: float, end: float) -> FloatArray:
    """Return a smooth step from 0 at `start` to 1 at `end`."""
    x = np.clip((values - start) / (end - start), 0.0, 1.0)
    return np.asarray(x * x * x * (10.0 - 15.0 * x + 6.0 * x * x))


def bump(points: FloatArray, centre: FloatArray, width: float) -> FloatArray:
    """Return a Gaussian of standard deviation `width` [mm] around a point, (N,)."""
    return np.asarray(np.exp(-0.5 * ((points - centre) ** 2).sum(axis=1) / width**2))


def turned(points: FloatArray, centre: FloatArray, axis: int, angle: FloatArray | float) -> FloatArray:
    """Return points rotated about a coordinate axis through a point.

    Parameters
    ----------
    points : (N, 3) array
        Positions [mm].
    centre : (3,) array
        A point on the axis [mm].
    axis : int
        0, 1 or 2.
    angle : (N,) array or float
        Angle of each point [rad].

    Returns
    -------
    (N, 3) array [mm]
    """
    from scipy.spatial.transform import Rotation

    vectors = np.zeros((len(points), 3))
    vectors[:, axis] = angle
    return np.asarray(Rotation.from_rotvec(vectors).apply(np.asarray(points - centre)) + centre)
