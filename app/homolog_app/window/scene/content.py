"""What a view can show: a subject's surfaces or a shape of the model, with colours, arrows and lines."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from homolog.arrays import Array, FloatArray, IntArray
from homolog.surfaces.mesh import TriangleMesh
from homolog_app.rendering.colours import ColourScale
from homolog_app.rendering.scene import Arrows

__all__ = ["Content", "Numbers", "ViewContents"]


@dataclass(frozen=True, slots=True, eq=False)
class Numbers:
    """Numbers that stand next to places, such as those of particles.

    Attributes
    ----------
    values : (k,) int array
    places : (k, 3) array
        [mm], in the coordinates that are shown.
    colours : (k, 3) uint8 array
        Red, green, blue.
    beside : float
        Distance of the number from its place [mm].
    """

    values: IntArray
    places: FloatArray
    colours: Array
    beside: float


@dataclass(frozen=True, slots=True, eq=False)
class Content:
    """One view: a subject's surfaces, or a shape of the model as its `groomed` surface.

    A content whose surface has the faces of the one shown before is moved in place, which is quick: so a
    shape is animated by handing over one content after the other.

    Attributes
    ----------
    name : str
    raw : TriangleMesh or None
        The input as it is, in the coordinates of the file.
    groomed, coarse : TriangleMesh or None
        The groomed surface and a light one for quick drawing, in the coordinates of the file.
    alignment : (4, 4) array
        From those coordinates to the common ones that are shown.
    note : str
        Second line of the caption.
    colours : (V, 3) uint8 array, optional
        Red, green and blue of each vertex of `groomed`, such as a `ColourScale` gives them.
    normals : (V, 3) array, optional
        Unit normals of `groomed` where they are known already; computed if not given.
    arrows : Arrows, optional
    lines : (S, 2, 3) array, optional
        Line segments [mm] in the coordinates that are shown, such as the border of a region.
    through : bool
        Whether arrows and lines that lie behind the surface are seen faintly through it.
    overlaid : bool
        Whether `groomed` is seen transparent over `raw`, whatever the user has switched on.
    numbers : Numbers, optional
        Seen in front of everything.
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

    @property
    def patient_axes(self) -> FloatArray:
        """Directions of the patient's left, back and head as shown: the columns of a rotation."""
        left, _, right = np.linalg.svd(self.alignment[:3, :3])
        return np.asarray(left @ right)


@dataclass(frozen=True, slots=True, eq=False)
class ViewContents:
    """Everything that the views show at a time.

    Attributes
    ----------
    contents : sequence of Content
    columns : int or None
        All contents in rows of so many views; None pages through them in the layout that the user chose.
    scale : ColourScale or None
        What the colours mean; drawn below the views.
    particles : mapping of str to (N, 3) array, or None
        Particles [mm] of each content by name, in the coordinates that are shown; None are those of the run.
    tints : (N, 3) uint8 array, mapping of str to such arrays, or None
        Colours of the particles, the same on all contents or of each by name; None gives each its colour by
        place.
    stays : bool
        Whether a close-up of what was shown before stays, if that said so too.
    """

    contents: Sequence[Content]
    columns: int | None = None
    scale: ColourScale | None = None
    particles: Mapping[str, FloatArray] | None = None
    tints: Array | Mapping[str, Array] | None = None
    stays: bool = False
