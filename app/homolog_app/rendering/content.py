"""Contents of the views, as values that can be stored in a file."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, overload

import numpy as np
from pydantic import AliasChoices, BaseModel, ConfigDict, Field

from homolog.arrays import Array, FloatArray, IntArray
from homolog.errors import InputError
from homolog.io.arrays import read_arrays, write_arrays
from homolog.surfaces.mesh import TriangleMesh
from homolog_app.rendering.camera import Canvas
from homolog_app.rendering.colours import ColourScale
from homolog_app.rendering.scene import Arrows

__all__ = [
    "KEPT",
    "MOST",
    "Content",
    "Numbers",
    "SubjectContents",
    "ViewContents",
    "open_page",
    "read_shown",
    "write_shown",
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
    numbers : Numbers, optional
        Drawn in front of everything.
    titled : bool
        Whether the caption begins with the name.
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
    numbers: Numbers | None = None
    titled: bool = True

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


KEPT = ".views.npz"
"""End of the names of such files."""

_SURFACES = ("raw", "groomed", "coarse")
_EACH = ("colours", "normals", "lines")
_Arrays = dict[str, Array]


class _Scale(BaseModel):
    """Attributes of a `ColourScale` other than its table."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    title: str
    unit: str
    low: float
    high: float
    low_label: str = Field(validation_alias=AliasChoices("low_label", "low_words"))  # name in files of 0.2
    high_label: str = Field(validation_alias=AliasChoices("high_label", "high_words"))
    note: str
    grey_label: str = Field("", validation_alias=AliasChoices("grey_label", "grey_words"))


class _Texts(BaseModel):
    """Data that are not arrays: names and notes of the contents, columns, scale, canvas."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    names: list[str]
    notes: list[str]
    columns: Annotated[int, Field(ge=1, le=MOST)] | None
    scale: _Scale | None
    canvas: Canvas


def open_page(shown: ViewContents, canvas: Canvas) -> tuple[ViewContents, Canvas]:
    """Return only the contents of the views' open page, with the canvas of that page."""
    if shown.columns is not None:
        return shown, canvas
    last = max(0, -(-len(shown.contents) // canvas.layout) - 1)
    first = min(canvas.page, last) * canvas.layout
    contents = shown.contents[first : first + canvas.layout]
    return replace(shown, contents=contents), canvas.model_copy(update={"page": 0})


def write_shown(path: Path, shown: ViewContents, canvas: Canvas) -> None:
    """Write the contents of the views' open page, with the canvas.

    Parameters
    ----------
    path : Path
    shown : ViewContents
        With its particles and their colours.
    canvas : Canvas

    Raises
    ------
    InputError
        If the file can't be written.
    """
    shown, canvas = open_page(shown, canvas)
    contents, scale = shown.contents, shown.scale
    texts = _Texts(
        names=[content.name for content in contents],
        notes=[content.note for content in contents],
        columns=shown.columns,
        scale=_Scale(**{name: getattr(scale, name) for name in _Scale.model_fields}) if scale else None,
        canvas=canvas,
    )
    arrays: _Arrays = {"words": np.array(texts.model_dump_json())}
    if scale is not None:
        arrays["scale"] = scale.table
    for number, content in enumerate(contents):
        arrays |= {f"{number}.{name}": value for name, value in _arrays_of(content, shown).items()}
    write_arrays(path, arrays)


def read_shown(path: Path) -> tuple[ViewContents, Canvas]:
    """Read a file of `write_shown`.

    Raises
    ------
    InputError
        If the file is missing, damaged, or of another kind.
    """
    arrays = read_arrays(path)
    try:
        texts = _Texts.model_validate_json(str(arrays["words"]))
        count, columns = len(texts.names), texts.columns or 1
        if -(-count // columns) * columns > MOST:
            raise ValueError(columns)
        table = _table(arrays, "scale", 256 if texts.scale else 0, kind="u1")
        scale = ColourScale(**texts.scale.model_dump(), table=table) if texts.scale else None
        parts = [_inside(arrays, f"{number}.") for number in range(count)]
        contents = [_content(*content) for content in zip(texts.names, texts.notes, parts, strict=True)]
        balls = dict(zip(texts.names, map(_particles, parts), strict=True))
    except (KeyError, ValueError, np.linalg.LinAlgError) as error:  # pydantic's errors are ValueErrors
        raise InputError(f"{path}: is not a views file of Homolog; save the screenshot again") from error
    particles = {name: points for name, (points, _) in balls.items() if len(points)}
    tints = {name: colours for name, (_, colours) in balls.items() if len(colours)}
    return ViewContents(contents, texts.columns, scale, particles, tints), texts.canvas


def _arrays_of(content: Content, shown: ViewContents) -> _Arrays:
    """Return the arrays of a content and of its particles by name."""
    arrays: _Arrays = {"alignment": content.alignment}
    for name in _SURFACES:
        mesh: TriangleMesh | None = getattr(content, name)
        if mesh is not None:
            arrays |= {f"{name}.vertices": mesh.vertices, f"{name}.faces": mesh.faces}
    if content.arrows is not None:
        arrays |= {"arrows.points": content.arrows.points, "arrows.vectors": content.arrows.vectors}
    if (numbers := content.numbers) is not None:
        arrays |= {f"numbers.{name}": getattr(numbers, name) for name in ("values", "places", "colours")}
        arrays["numbers.beside"] = np.array([numbers.beside])
    if content.through:
        arrays["through"] = np.array(True)
    if content.overlaid:
        arrays["overlaid"] = np.array(True)
    if not content.titled:
        arrays["untitled"] = np.array(True)
    arrays |= {name: array for name in _EACH if (array := getattr(content, name)) is not None}
    if shown.particles and content.name in shown.particles:
        arrays["particles"] = shown.particles[content.name]
        tints = shown.tints.get(content.name) if isinstance(shown.tints, Mapping) else shown.tints
        if tints is not None:
            arrays["tints"] = tints
    return arrays


def _inside(arrays: _Arrays, prefix: str) -> _Arrays:
    return {name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)}


def _content(name: str, note: str, arrays: _Arrays) -> Content:
    """Return a content; sizes of arrays are checked, because VTK does not check them."""
    meshes = {surface: _mesh(arrays, surface) for surface in _SURFACES}
    points = len(mesh.vertices) if (mesh := meshes["groomed"]) else 0
    arrows = None
    if "arrows.points" in arrays:
        begin = _table(arrays, "arrows.points")
        arrows = Arrows(begin, _table(arrays, "arrows.vectors", len(begin)))
    lines = _table(arrays, "lines", shape=(2, 3)) if "lines" in arrays else None
    return Content(
        name,
        alignment=_table(arrays, "alignment", 4, (4,)),
        note=note,
        arrows=arrows,
        lines=lines,
        **meshes,
        colours=_table(arrays, "colours", points, kind="u1") if "colours" in arrays else None,
        normals=_table(arrays, "normals", points) if "normals" in arrays else None,
        through="through" in arrays,
        overlaid="overlaid" in arrays,
        titled="untitled" not in arrays,
        numbers=_numbers(arrays),
    )


def _numbers(arrays: _Arrays) -> Numbers | None:
    if "numbers.places" not in arrays:
        return None
    places = _table(arrays, "numbers.places")
    values = _table(arrays, "numbers.values", len(places), (), "i8")
    beside = float(_table(arrays, "numbers.beside", 1, ())[0])
    return Numbers(values, places, _table(arrays, "numbers.colours", len(places), kind="u1"), beside)


def _mesh(arrays: _Arrays, name: str) -> TriangleMesh | None:
    if f"{name}.vertices" not in arrays:
        return None
    vertices, faces = _table(arrays, f"{name}.vertices"), _table(arrays, f"{name}.faces", kind="i4")
    if not len(faces) or faces.min() < 0 or faces.max() >= len(vertices):
        raise ValueError(name)
    return TriangleMesh(vertices, faces)


def _particles(arrays: _Arrays) -> tuple[Array, Array]:
    """Return particles and their colours; empty arrays if there are none."""
    places = _table(arrays, "particles")
    return places, _table(arrays, "tints", len(places) if "tints" in arrays else 0, kind="u1")


def _table(
    arrays: _Arrays, name: str, count: int | None = None, shape: tuple[int, ...] = (3,), kind: str = "f8"
) -> Array:
    """Return an array of finite numbers with `count` rows of a shape; an empty one if it is missing."""
    array = arrays.get(name, np.empty((0, *shape), kind))
    fits = array.dtype.kind == kind[0] and array.shape[1:] == shape and count in (None, len(array))
    if not fits or not np.isfinite(array).all():
        raise ValueError(name)
    return array
