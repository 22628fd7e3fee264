"""Shapes of the model as the views show them: moved, coloured by displacement, with arrows."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from homolog.arrays import Array, BoolArray, FloatArray
from homolog.surfaces.mesh import TriangleMesh
from homolog_app.rendering.colours import ColourScale
from homolog_app.rendering.scene import Arrows
from homolog_app.views.content import Content

if TYPE_CHECKING:
    from homolog_app.window.explore.model_shape import ModelShape

__all__ = [
    "DisplayOptions",
    "arrow_factor",
    "model_content",
    "outward_sign",
    "region_border",
    "single_subject",
    "untitled",
]

_ARROW_SHARE = 0.09
_FACTORS = (1.0, 2.0, 5.0)


@dataclass(frozen=True, slots=True, eq=False)
class DisplayOptions:
    """How displacements are shown.

    Attributes
    ----------
    scale : ColourScale or None
        Colours; plain surfaces without.
    arrows : float
        How many times their length arrows are drawn; 0 draws none.
    from_middle : bool
        Whether values count as positive away from the middle of the shape, not out of the tissue.
    """

    scale: ColourScale | None = None
    arrows: float = 0.0
    from_middle: bool = False


def model_content(
    shape: "ModelShape",
    name: str,
    note: str,
    moved: Array,
    look: DisplayOptions,
    *,
    values: Array | None = None,
    ways: Array | None = None,
    faded: BoolArray | None = None,
    alignment: FloatArray | None = None,
) -> Content:
    """Return a shape of the model.

    Parameters
    ----------
    shape : ModelShape
    name, note : str
        The caption's lines.
    moved : (V, 3) array
        Way of the vertices from the mean surface to where they are drawn [mm].
    look : Look
    values : (V,) array, optional
        What the colours show [mm]; the outward part of `moved` if not given.
    ways : (V, 3) array, optional
        What the arrows show [mm]; `moved` if not given.
    faded : (V,) bool array, optional
        Vertices drawn grey, without arrows, and with a line around them.
    alignment : (4, 4) array, optional
        Motion of the whole shape, to lie beside another.
    """
    placed = np.eye(4) if alignment is None else alignment
    vertices: Array = shape.mean.vertices.astype(np.float32) + moved
    normals = shape.normals(vertices)
    colours = None
    if look.scale is not None:
        outward = shape.outward(moved) if values is None else values
        if look.from_middle:
            outward = outward * outward_sign(shape.mean.vertices, shape.mean_normals)
        colours = look.scale.colours(outward, faded)
    arrows = None
    if look.arrows:
        at = shape.arrows_at if faded is None else shape.arrows_at[~faded[shape.arrows_at]]
        arrows = _arrows(
            vertices[at], normals[at], look.arrows * (moved if ways is None else ways)[at], placed
        )
    lines = None if faded is None else _placed(region_border(vertices, shape.mean.faces, faded), placed)
    mesh = TriangleMesh(vertices, shape.mean.faces)
    return Content(name, None, mesh, None, placed, note, colours, normals, arrows, lines)


def outward_sign(vertices: Array, normals: Array) -> Array:
    """Return 1 for vertices (V, 3) whose outward normal points away from their middle, -1 for others."""
    away = np.einsum("vi,vi->v", vertices - vertices.mean(axis=0), normals)
    return np.where(away >= 0.0, 1.0, -1.0)


def untitled(content: Content, models: "Sequence[ModelShape]") -> Content:
    """Return a shape of a model without the project's name, unless another project's is beside it."""
    if len(models) > 1:
        return content
    mirrored = models[0].result.mirrored
    note = f"{content.note} · {mirrored} mirrored" if mirrored else content.note
    return replace(content, note=note, titled=False)


def single_subject(subject: Content) -> Content:
    """Return a subject with its groomed surface only, which the caption names."""
    return replace(subject, raw=None, note="groomed surface")


def arrow_factor(shape: "ModelShape", limit: float) -> float:
    """Return a round factor that makes arrows of a displacement (limit, mm) well visible; at least 1."""
    wanted = _ARROW_SHARE * float(np.ptp(shape.mean.vertices, axis=0).mean()) / limit
    if wanted <= 1.0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(max(factor for factor in _FACTORS if factor * power <= wanted) * power)


def region_border(vertices: Array, faces: Array, inside: BoolArray) -> FloatArray:
    """Return the segments (S, 2, 3) between the vertices of a region and the others, through edge middles."""
    marks = inside[faces]
    count = marks.sum(axis=1)
    mixed = (count == 1) | (count == 2)
    corners, marks = faces[mixed], marks[mixed]
    odd = np.where(count[mixed] == 1, marks.argmax(axis=1), marks.argmin(axis=1))
    rows = np.arange(len(corners))
    apex = vertices[corners[rows, odd]]
    ends = [vertices[corners[rows, (odd + step) % 3]] for step in (1, 2)]
    return np.asarray(np.stack([(apex + end) / 2.0 for end in ends], axis=1))


def _arrows(points: Array, normals: Array, vectors: Array, placed: FloatArray) -> Arrows:
    """Arrows outside of the surface: those inward end on it, the others begin on it."""
    inward = np.einsum("ai,ai->a", vectors, normals) < 0.0
    starts = points - np.where(inward[:, None], vectors, 0.0)
    return Arrows(_placed(starts, placed), vectors @ placed[:3, :3].T)


def _placed(points: Array, placed: FloatArray) -> FloatArray:
    return np.asarray(points @ placed[:3, :3].T + placed[:3, 3])
