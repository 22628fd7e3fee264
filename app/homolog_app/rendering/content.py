"""Contents of the views."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import overload

import numpy as np

from homolog.arrays import Array, FloatArray, IntArray
from homolog.surfaces.mesh import TriangleMesh
from homolog_app.rendering.camera import Canvas
from homolog_app.rendering.colours import ColourScale
from homolog_app.rendering.scene import Arrows

__all__ = [
    "MOST",
    "Content",
    "Numbers",
    "SubjectContents",
    "ViewContents",
    "open_page",
]

MOST = 16
"""Largest number of views."""


@dataclass(frozen=True, slots=True, eq=False)
class Numbers:
    """Numbers next to points, such as particle numbers.

    Attributes
    ----------
    values : (k,) int array
    places : (k, 3) array
        [mm], in display coordinates.
    colours : (k, 3) uint8 array
        Red, green, blue.
    beside : float
        Distance of the number from its point [mm].
    """

    values: IntArray
    places: FloatArray
    colours: Array
    beside: float


@dataclass(frozen=True, slots=True, eq=False)
class Content:
    """One view: a subject's surfaces, or a shape of the model as its `groomed` surface.

    A content whose surface has the same faces as the previous one is moved in place, which is fast: a
    shape is animated by handing over one content after the other.

    Attributes
    ----------
    name : str
    raw : TriangleMesh or None
        The input as it is, in the coordinates of the file.
    groomed, coarse : TriangleMesh or None
        The groomed surface and a simplified one for fast drawing, in the coordinates of the file.
    alignment : (4, 4) array
        From those coordinates to the display coordinates, which all contents share.
    note : str
        Second line of the caption.
    colours : (V, 3) uint8 array, optional
        Red, green and blue of each vertex of `groomed`, such as those of a `ColourScale`.
    normals : (V, 3) array, optional
        Unit normals of `groomed`; computed if not given.
    arrows : Arrows, optional
    lines : (S, 2, 3) array, optional
        Line segments [mm] in display coordinates, such as the border of a region.
    through : bool
        Whether arrows and lines behind the surface are faintly visible through it.
    overlaid : bool
        Whether `groomed` is drawn transparent over `raw`, regardless of the user's choice of surfaces.
    faded : bool
        Whether `raw` is what was cut away of `groomed`; it is drawn faintly, whatever the user chose to see.
    numbers : Numbers, optional
        Drawn in front of everything.
    titled : bool
        Whether the caption begins with the name.
    structures : mapping of str to int
        Number of particles of each of several structures, in the order of the surfaces' parts; empty for a
        single one.
    """

    name: str
    raw: TriangleMesh | None
    groomed: TriangleMesh | None
    coarse: TriangleMesh | None
    alignment: FloatArray
    note: str = ""
    colours: Array | None = None
    normals: Array | None = None
    arrows: Arrows | None = None
    lines: FloatArray | None = None
    through: bool = False
    overlaid: bool = False
    faded: bool = False
    numbers: Numbers | None = None
    titled: bool = True
    structures: Mapping[str, int] = field(default_factory=dict)

    def owners(self, particles: int) -> IntArray:
        """Return the place of the structure of each particle, -1 if unknown; a run begins with fewer."""
        counts = np.array(list(self.structures.values()), dtype=np.intp)
        while counts.sum() > max(particles, len(counts)):
            counts = (counts + 1) // 2  # as particles are split
        if counts.sum() != particles:
            return np.full(particles, -1)
        return np.repeat(np.arange(len(counts)), counts)

    @property
    def caption(self) -> list[str]:
        """Lines of text at the top of the view."""
        return [line for line in (self.name if self.titled else "", self.note) if line]

    @property
    def patient_axes(self) -> FloatArray:
        """The patient's left, back and head in display coordinates: the columns of a rotation."""
        left, _, right = np.linalg.svd(self.alignment[:3, :3])
        return np.asarray(left @ right)


class SubjectContents(Sequence[Content]):
    """The contents of all subjects, each made when it is shown.

    Parameters
    ----------
    names : sequence of str
        The subjects.
    make : callable
        Returns the content of a subject by its index.
    """

    def __init__(self, names: Sequence[str] = (), make: Callable[[int], Content] | None = None) -> None:
        self._places = {name: place for place, name in enumerate(names)}
        self._make = make

    def __len__(self) -> int:
        """Return the number of subjects."""
        return len(self._places)

    @overload
    def __getitem__(self, index: int) -> Content: ...

    @overload
    def __getitem__(self, index: slice) -> list[Content]: ...

    def __getitem__(self, index: int | slice) -> Content | list[Content]:
        """Make the content of a subject, or of those of a slice."""
        chosen = range(len(self))[index]
        assert self._make is not None, "no index is valid without subjects"
        return self._make(chosen) if isinstance(chosen, int) else [self._make(place) for place in chosen]

    def place_of(self, name: str) -> int | None:
        """Return the index of a subject; None if there is no such subject."""
        return self._places.get(name)

    def named(self, name: str) -> Content | None:
        """Return the content of a subject; None if there is no such subject."""
        place = self.place_of(name)
        return None if place is None else self[place]

    def changed(self, change: Callable[[Content], Content]) -> "SubjectContents":
        """Return contents to which a function is applied when they are shown."""
        return SubjectContents(list(self._places), lambda place: change(self[place]))


@dataclass(frozen=True, slots=True, eq=False)
class ViewContents:
    """All contents of the views.

    Attributes
    ----------
    contents : sequence of Content
    columns : int or None
        Number of views in a row, with all contents on one page; None for pages in the user's layout.
    scale : ColourScale or None
        Meaning of the colours; drawn below the views.
    particles : mapping of str to (N, 3) array, or None
        Particles [mm] of each content by name, in display coordinates; None for those of the run.
    tints : (N, 3) uint8 array, mapping of str to such arrays, or None
        Colours of the particles, common to all contents or for each by name; None for colours by
        position.
    frame : (n, 3) array, optional
        Points [mm] that fit into the views beside the contents, such as the shapes that a slider reaches.
    stays : bool
        Whether the camera of a close-up remains when the contents change; required of the old and the new
            ones.
    """

    contents: Sequence[Content]
    columns: int | None = None
    scale: ColourScale | None = None
    particles: Mapping[str, FloatArray] | None = None
    tints: Array | Mapping[str, Array] | None = None
    frame: Array | None = None
    stays: bool = False


def open_page(shown: ViewContents, canvas: Canvas) -> tuple[ViewContents, Canvas]:
    """Return only the contents of the views' open page, with the canvas of that page."""
    if shown.columns is not None:
        return shown, canvas
    last = max(0, -(-len(shown.contents) // canvas.layout) - 1)
    first = min(canvas.page, last) * canvas.layout
    contents = shown.contents[first : first + canvas.layout]
    return replace(shown, contents=contents), canvas.model_copy(update={"page": 0})
