"""What the views show while something is measured: a shape with a line between two particles."""

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from homolog.arrays import FloatArray
from homolog_app.rendering.colours import ColourScale, displacement_scale, viridis
from homolog_app.rendering.scene import Arrows
from homolog_app.rendering.text import short, signed
from homolog_app.views.content import Content, ViewContents
from homolog_app.window.explore.model_content import DisplayOptions, model_content, untitled
from homolog_app.window.explore.view_states import MeasureView

if TYPE_CHECKING:
    from homolog_app.window.explore.model_shape import ModelShape

__all__ = ["deviations_of", "measured_scene"]

_PIN = 0.07
_NEARLY_ALL, _ROOM = 95.0, 1.25  # subjects differ from the mean shape


def deviations_of(view: MeasureView) -> FloatArray:
    """Return how far the shape is along each of the first modes [SD]."""
    deviations = np.zeros(view.mode + 1)
    deviations[-1] = view.at
    return deviations


def measured_scene(view: MeasureView, shape: "ModelShape", subjects: Mapping[str, Content]) -> ViewContents:
    """Return the shape, or two side by side, with both particles marked.

    Parameters
    ----------
    view : MeasureView
    shape : ModelShape
    subjects : mapping of str to Content
        The subjects that the view names.
    """
    names = [view.subject] if view.beside in (None, view.subject) else [view.subject, view.beside]
    contents, particles, scale = [], {}, None
    for name in names:
        content, points = _measured(view, shape, subjects.get(name))
        if view.map != "none" and content.groomed is not None:
            content, scale = _coloured(view, content, shape)
        contents.append(content)
        particles[content.name] = points
    return ViewContents(contents, len(contents), scale, particles)


def _measured(view: MeasureView, shape: "ModelShape", subject: Content | None) -> tuple[Content, FloatArray]:
    """Return the shape, or the own surface of a subject, and its particles (N, 3)."""
    if subject is None:
        deviations = deviations_of(view)
        particles = shape.model.instance(deviations)
        ends = particles[list(view.particles)]
        distance = short(float(np.linalg.norm(ends[1] - ends[0])))
        text = f"mode {view.mode + 1}: {signed(view.at)} SD · distance {distance} mm"
        content = model_content(shape, shape.title, text, shape.moved(deviations), DisplayOptions())
        return _with_pins(untitled(content, [shape]), ends), particles
    particles = shape.result.world[shape.result.names.index(subject.name)]
    return replace(subject, lines=particles[None, list(view.particles)], through=True), particles


def _coloured(view: MeasureView, content: Content, shape: "ModelShape") -> tuple[Content, ColourScale]:
    """Colour a surface by the thickness of its wall, in its own size, or by its distance from the mean."""
    from homolog.surfaces.closest import signed_distances_to
    from homolog.surfaces.walls import wall_thickness

    mesh = content.groomed
    assert mesh is not None
    if view.map == "thickness":
        values = wall_thickness(mesh)
        scale = _thickness_scale(wall_thickness(shape.mean))
    else:
        alignment = content.alignment
        values = signed_distances_to(shape.mean, mesh.vertices @ alignment[:3, :3].T + alignment[:3, 3])
        scale = displacement_scale(shape.limit, "Distance from the mean surface")
        scale = replace(scale, low_words="inside it", high_words="outside")
    scale, unknown = scale.within(view.colour_range), np.isnan(values)
    if unknown.any():
        scale = replace(scale, grey_words="no opposite side")
    colours = scale.colours(np.where(unknown, scale.low, values), unknown)
    return replace(content, colours=colours, coarse=None), scale


def _thickness_scale(thickness: FloatArray) -> ColourScale:
    """Return a scale from 0 to what nearly all of the mean shape's wall stays below, with some room."""
    known = thickness[~np.isnan(thickness)]
    high = _ROOM * float(np.percentile(known, _NEARLY_ALL)) if len(known) else 1.0
    return ColourScale("Wall thickness", "mm", 0.0, float(f"{high:.2g}"), viridis(), "thin", "thick")


def _with_pins(content: Content, ends: FloatArray) -> Content:
    """Mark two places of a surface with pins from outside, and the straight way between them."""
    assert content.groomed is not None
    assert content.normals is not None
    vertices = content.groomed.vertices
    at = [int(np.square(vertices - end).sum(axis=1).argmin()) for end in ends]
    pins = -_PIN * float(np.ptp(vertices, axis=0).max()) * np.asarray(content.normals, np.float64)[at]
    return replace(content, arrows=Arrows(ends - pins, pins), lines=ends[None], through=True)
