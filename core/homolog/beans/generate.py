"""The synthetic cohort of the paper's section 4: ellipsoids with a slot that moves and widens.

Lengths are voxels of the generated volumes, one millimetre each.
"""

from dataclasses import dataclass

import numpy as np

from homolog.arrays import BoolArray, FloatArray

__all__ = ["NARROW", "WIDE", "Bean", "BeanGeometry", "draw_beans", "draw_moments", "voxelize"]

_PADDING = 6
_WIDTH_MEAN, _WIDTH_SD = 8.0, 2.0


@dataclass(frozen=True, slots=True)
class BeanGeometry:
    """Common geometry of a cohort of beans, which the paper does not specify.

    Attributes
    ----------
    name : str
        Name on the command line.
    body : tuple of 3 float
        Semi-axes A, B, C of the large ellipsoid at the origin, along x, y, z [mm].
    slot_length, slot_depth : float
        Semi-axes a and c of the slot ellipsoid along x and z [mm]. Its centre is (0, position, C).
    width_is_semi_axis : bool
        Whether the drawn width is the slot's semi-axis b along y (else the full width 2b).
    width_range : tuple of 2 float
        Limits of the truncated normal distribution of widths [mm].
    """

    name: str
    body: tuple[float, float, float]
    slot_length: float
    slot_depth: float
    width_is_semi_axis: bool
    width_range: tuple[float, float]


WIDE = BeanGeometry("wide", (40.0, 30.0, 20.0), 28.0, 14.0, True, (3.0, 13.0))
"""Slots of different beans overlap, so that corresponding points exist. This geometry is used for
comparisons."""

NARROW = BeanGeometry("narrow", (40.0, 30.0, 20.0), 24.0, 12.0, False, (4.0, 12.0))
"""The positions of slots vary by more than their width; no method is expected to track them."""


@dataclass(frozen=True, slots=True)
class Bean:
    """One bean: the large ellipsoid minus the slot ellipsoid.

    Attributes
    ----------
    geometry : BeanGeometry
        Geometry of the cohort.
    position : float
        The slot's centre along y [mm].
    width : float
        The slot's width [mm], in the sense of ``geometry.width_is_semi_axis``.
    """

    geometry: BeanGeometry
    position: float
    width: float

    @property
    def body_axes(self) -> FloatArray:
        """Semi-axes of the large ellipsoid [mm], shape (3,)."""
        return np.array(self.geometry.body)

    @property
    def slot_axes(self) -> FloatArray:
        """Semi-axes of the slot ellipsoid [mm], shape (3,)."""
        half_width = self.width if self.geometry.width_is_semi_axis else self.width / 2.0
        return np.array([self.geometry.slot_length, half_width, self.geometry.slot_depth])

    @property
    def slot_centre(self) -> FloatArray:
        """Centre of the slot ellipsoid [mm], shape (3,)."""
        return np.array([0.0, self.position, self.geometry.body[2]])


def draw_beans(shapes: int = 10, seed: int = 5, geometry: BeanGeometry = WIDE) -> list[Bean]:
    """Draw a cohort: positions uniform in [-B/3, B/3], widths normal(8, 2) within the geometry's range.

    The same seed gives the same cohort with every version of numpy. Ten draws rarely have the nominal
    moments: publish the seed, and see `draw_moments`.

    Parameters
    ----------
    shapes : int
        Number of beans.
    seed : int
        Same seed, same beans.
    geometry : BeanGeometry
        Range of the parameters.

    Returns
    -------
    list of Bean
    """
    random = np.random.default_rng(seed)
    reach = geometry.body[1] / 3.0
    positions = random.uniform(-reach, reach, shapes)
    low, high = geometry.width_range
    widths: list[float] = []
    while len(widths) < shapes:
        width = random.normal(_WIDTH_MEAN, _WIDTH_SD)
        if low <= width <= high:
            widths.append(width)
    return [
        Bean(geometry, float(position), float(width))
        for position, width in zip(positions, widths, strict=True)
    ]


def draw_moments(beans: list[Bean]) -> tuple[float, float, float]:
    """Return the sample standard deviations of position and width [mm], and their correlation."""
    position = np.array([bean.position for bean in beans])
    width = np.array([bean.width for bean in beans])
    correlation = np.corrcoef(position, width)[0, 1]
    return float(position.std(ddof=1)), float(width.std(ddof=1)), float(correlation)


def voxelize(bean: Bean) -> tuple[BoolArray, FloatArray]:
    """Return the binary volume of a bean.

    Returns
    -------
    inside : (I, J, K) bool array
        Whether a voxel's centre is in the bean, with six voxels of padding; indexed [i, j, k] along
        x, y, z. All beans of a geometry share one grid.
    index_to_world : (4, 4) array
        From indices to millimetres: a shift, as the voxels are 1 mm.
    """
    half = np.ceil(bean.body_axes).astype(int) + _PADDING
    grid = np.meshgrid(*(np.arange(-h, h + 1.0) for h in half), indexing="ij", sparse=True)

    def level(centre: FloatArray, axes: FloatArray) -> FloatArray:
        total = sum(((x - c) / a) ** 2 for x, c, a in zip(grid, centre, axes, strict=True))
        return np.asarray(total)

    inside = (level(np.zeros(3), bean.body_axes) <= 1.0) & (level(bean.slot_centre, bean.slot_axes) >= 1.0)
    index_to_world = np.eye(4)
    index_to_world[:3, 3] = -half
    return inside, index_to_world
