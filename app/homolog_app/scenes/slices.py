"""Slices of scans and label maps in three planes, with contours and grey-value windows."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations
from pathlib import Path

import numpy as np
from scipy import ndimage

from homolog.arrays import Array, Float32Array, FloatArray
from homolog.geometry import transform_points
from homolog.io.images import Segmentation
from homolog.io.scans import Scan
from homolog.surfaces.mesh import TriangleMesh
from homolog_app.rendering.text import edge_letters

__all__ = [
    "AUTOMATIC",
    "PRESETS",
    "GreyWindow",
    "Grid",
    "Outline",
    "Plane",
    "Section",
    "SliceScene",
    "first_preset",
    "mask_contour",
    "planes_of",
    "section_of",
]


AUTOMATIC = "Automatic"
_CT_AIR = -500.0
"""Only in CT do many voxels have grey values as low as this [HU]."""


@dataclass(frozen=True, slots=True)
class GreyWindow:
    """A grey-value window: its width from black to white, and the level in the middle."""

    width: float
    level: float

    @classmethod
    def between(cls, low: float, high: float) -> "GreyWindow":
        """Return the window with `low` as black and `high` as white."""
        return cls(high - low, 0.5 * (low + high))

    def dragged(self, right: float, down: float) -> "GreyWindow":
        """Return the window after a drag (fractions of the widget): wider to the right, darker downwards."""
        return GreyWindow(max(self.width * float(np.exp(2.0 * right)), 1e-6), self.level + self.width * down)

    def shades(self, values: Float32Array) -> Array:
        """Return grey values as uint8 from black to white."""
        low = self.level - 0.5 * self.width
        scaled = np.clip((values - low) * (255.0 / self.width), 0.0, 255.0)
        return np.asarray(np.nan_to_num(scaled).astype(np.uint8))


PRESETS = {
    "CT bone": GreyWindow(1800.0, 400.0),
    "CT soft tissue": GreyWindow(400.0, 40.0),
    "CT lung": GreyWindow(1500.0, -600.0),
    "CT brain": GreyWindow(80.0, 40.0),
}
"""Standard windows of CT [HU]; MR has no units, so its window is derived from the scan (`AUTOMATIC`)."""


def first_preset(scan: Scan) -> str:
    """Return the initial window of a scan: soft tissue if its values are those of CT."""
    low = scan.values[:: max(1, len(scan.values) // 16)].min() * scan.slope + scan.intercept
    return "CT soft tissue" if low <= _CT_AIR else AUTOMATIC


_MOST_SAMPLES = 1024
"""Samples per side of a slice for the contour of a mask."""


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """A surface that is drawn as a contour.

    Attributes
    ----------
    title : str
        Name in the legend.
    mesh : TriangleMesh
        In the coordinates of the file, LPS [mm].
    colours : (V, 3) uint8 array or None
        Colours of its vertices; None for the scheme's colour.
    note : str
        Meaning of the colours.
    """

    title: str
    mesh: TriangleMesh
    colours: Array | None = None
    note: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class SliceScene:
    """Content of the planes.

    Attributes
    ----------
    name : str
        The subject's name; empty if none is selected.
    image : Path or None
        Its scan; None if it has none.
    voxels : Segmentation or None
        Its structure; None for surfaces.
    outlines : sequence of Outline
    """

    name: str
    image: Path | None = None
    voxels: Segmentation | None = None
    outlines: Sequence[Outline] = ()

    @property
    def points(self) -> FloatArray:
        """Points of the structure, LPS [mm], (P, 3); none if it has neither surfaces nor voxels."""
        if self.outlines:
            return self.outlines[0].mesh.vertices
        if self.voxels is None:
            return np.empty((0, 3))
        return transform_points(Grid.of_mask(self.voxels).matrix, np.argwhere(self.voxels.mask).astype(float))


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """A voxel grid: the (4, 4) matrix from indices to LPS [mm], and the number of voxels along each axis."""

    matrix: FloatArray
    shape: tuple[int, ...]

    @classmethod
    def of_mask(cls, voxels: Segmentation) -> "Grid":
        """Return the grid of a segmentation."""
        matrix = np.eye(4)
        matrix[:3, :3] = voxels.rotation * voxels.spacing
        matrix[:3, 3] = voxels.origin
        return cls(matrix, voxels.mask.shape)

    @classmethod
    def of_scan(cls, scan: Scan) -> "Grid":
        """Return the grid of a scan."""
        return cls(scan.index_to_world, scan.values.shape)

    @property
    def spacing(self) -> FloatArray:
        """Distance of neighbouring voxels along each axis [mm], (3,)."""
        return np.asarray(np.linalg.norm(self.matrix[:3, :3], axis=0))

    def indices(self, points: FloatArray) -> FloatArray:
        """Return points (P, 3) [mm] as indices."""
        return transform_points(np.asarray(np.linalg.inv(self.matrix)), points)

    def box_of(self, points: FloatArray) -> FloatArray:
        """Return the lowest and highest indices (2, 3) of points (P, 3) [mm]; without points, of the grid."""
        if not len(points):
            return np.stack([np.zeros(3), np.array(self.shape) - 1.0])
        indices = self.indices(points)
        return np.stack([indices.min(axis=0), indices.max(axis=0)])


@dataclass(frozen=True, slots=True)
class Plane:
    """One of the three planes.

    Attributes
    ----------
    title : str
        The closest of Axial, Coronal and Sagittal.
    axis, across, down : int
        Axes of the grid: through the plane, to the right and down on the screen.
    turned_across, turned_down : bool
        Whether indices decrease to the right, and downwards.
    letters : tuple of str
        Of the patient's directions at the left, right, bottom and top.
    """

    title: str
    axis: int
    across: int
    down: int
    turned_across: bool
    turned_down: bool
    letters: tuple[str, str, str, str]

    def picture(self, values: Array) -> Array:
        """Turn a slice from the order of the grid's axes to that of the screen: (down, across)."""
        if self.across < self.down:
            values = values.T
        return values[:: -1 if self.turned_down else 1, :: -1 if self.turned_across else 1]

    def places(self, indices: FloatArray, shape: Sequence[int]) -> FloatArray:
        """Return positions of indices (…, 3) in the picture, in voxels right and down from its corner."""
        result: FloatArray = indices[..., [self.across, self.down]] + 0.5
        for column, (axis, turned) in enumerate(self._sides):
            if turned:
                result[..., column] = shape[axis] - result[..., column]
        return result

    def moved(self, index: FloatArray, place: tuple[float, float], shape: Sequence[int]) -> FloatArray:
        """Return an index (3,) whose components in the plane are replaced by a position in the picture."""
        result = np.array(index, np.float64)
        for value, (axis, turned) in zip(place, self._sides, strict=True):
            result[axis] = (shape[axis] - value if turned else value) - 0.5
        return result

    @property
    def _sides(self) -> tuple[tuple[int, bool], tuple[int, bool]]:
        return (self.across, self.turned_across), (self.down, self.turned_down)


def planes_of(grid: Grid) -> tuple[Plane, Plane, Plane]:
    """Return the axial, coronal and sagittal plane of a grid, along the grid's axes.

    In the radiological convention, left or back is at the right, and head (in axial planes front) at the top.
    """
    directions = grid.matrix[:3, :3] / grid.spacing
    left, back, head = max(
        permutations(range(3)),
        key=lambda axes: sum(abs(directions[row, axis]) for row, axis in enumerate(axes)),
    )
    rows = {left: 0, back: 1, head: 2}

    def plane(title: str, axis: int, across: int, down: int) -> Plane:
        turned_across = bool(directions[rows[across], across] < 0.0)
        turned_down = bool((directions[rows[down], down] > 0.0) == (down == head))
        right = directions[:, across] * (-1.0 if turned_across else 1.0)
        low = directions[:, down] * (-1.0 if turned_down else 1.0)
        letters = edge_letters(np.eye(3), right, -low)
        return Plane(title, axis, across, down, turned_across, turned_down, letters)

    return (
        plane("Axial", head, left, back),
        plane("Coronal", back, left, head),
        plane("Sagittal", left, back, head),
    )


@dataclass(frozen=True, slots=True, eq=False)
class Section:
    """The intersection of a plane and a surface: segments (S, 2, 3) as indices, and their colours (S, 3)."""

    segments: FloatArray
    colours: Array | None


def section_of(corners: FloatArray, faces: Array, colours: Array | None, axis: int, index: float) -> Section:
    """Cut a surface with a plane of the grid.

    Parameters
    ----------
    corners : (V, 3) array
        Vertices as indices of the grid.
    faces : (F, 3) int array
    colours : (V, 3) uint8 array or None
    axis : int
        Axis of the grid through the plane.
    index : float
        Index of the plane on this axis.
    """
    above = corners[:, axis] - index
    is_above = above > 0.0
    sides = is_above[faces]
    cut = faces[sides.any(axis=1) & ~sides.all(axis=1)]
    sides = is_above[cut]
    lone = np.where(sides.sum(axis=1) == 1, sides.argmax(axis=1), (~sides).argmax(axis=1))
    row = np.arange(len(cut))
    start = cut[row, lone]
    ends = np.stack([cut[row, (lone + 1) % 3], cut[row, (lone + 2) % 3]], axis=1)
    share = (above[start, None] / (above[start, None] - above[ends]))[..., None]
    segments = (1.0 - share) * corners[start, None] + share * corners[ends]
    if colours is None:
        return Section(segments, None)
    tints = ((1.0 - share) * colours[start, None] + share * colours[ends]).mean(axis=1)
    return Section(segments, tints.astype(np.uint8))


def mask_contour(voxels: Segmentation, grid: Grid, axis: int, index: int) -> list[FloatArray]:
    """Return the border of a segmentation in a slice of a grid, which may differ from its own.

    The mask is sampled only in the slice and within the mask's bounding box.

    Parameters
    ----------
    voxels : Segmentation
    grid : Grid
    axis, index : int
        Axis and index of the slice.

    Returns
    -------
    list of (K, 3) array
        Lines, as indices of the grid.
    """
    from skimage.measure import find_contours

    own = Grid.of_mask(voxels)
    ends = np.array(list(np.ndindex(2, 2, 2))) * (np.array(own.shape) - 1.0)
    box = grid.box_of(transform_points(own.matrix, ends))
    if not box[0, axis] - 0.5 <= index <= box[1, axis] + 0.5:
        return []
    rest = [other for other in range(3) if other != axis]
    step = np.minimum(voxels.spacing.min() / grid.spacing, 1.0)
    samples = [
        np.linspace(
            low := np.floor(box[0, other]) - 1.0,
            high := np.ceil(box[1, other]) + 1.0,
            int(min(round((high - low) / step[other]), _MOST_SAMPLES)) + 1,
        )
        for other in rest
    ]
    places = np.empty((len(samples[0]), len(samples[1]), 3))
    places[..., axis] = index
    places[..., rest[0]], places[..., rest[1]] = np.meshgrid(*samples, indexing="ij")
    between = np.linalg.inv(own.matrix) @ grid.matrix
    nodes = transform_points(between, places.reshape(-1, 3))
    values = ndimage.map_coordinates(voxels.mask, nodes.T, np.float32, order=1).reshape(places.shape[:2])
    lines = []
    for line in find_contours(values, 0.5):
        whole = np.full((len(line), 3), float(index))
        for column, (other, side) in enumerate(zip(rest, samples, strict=True)):
            whole[:, other] = np.interp(line[:, column], np.arange(len(side)), side)
        lines.append(whole)
    return lines
