"""What the views show while something is measured: a shape with a line between two particles."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from homolog.arrays import FloatArray
from homolog_app.window.explore.chosen import MeasureView
from homolog_app.window.explore.model_content import Look, model_content
from homolog_app.window.quantities import signed
from homolog_app.window.scene.content import Arrows, Content, Shown

if TYPE_CHECKING:
    from homolog_app.window.explore.model_shape import ModelShape

__all__ = ["deviations_of", "measured_scene"]

_PIN = 0.12


def deviations_of(view: MeasureView) -> FloatArray:
    """Return how far the shape is along each of the first modes [SD]."""
    deviations = np.zeros(view.mode + 1)
    deviations[-1] = view.at
    return deviations


def measured_scene(view: MeasureView, shape: "ModelShape") -> Shown:
    """Return the shape with both particles marked."""
    deviations = deviations_of(view)
    local = shape.model.instance(deviations)
    words = f"mode {view.mode + 1}: {signed(view.at)} SD"
    content = model_content(shape, shape.title, words, shape.moved(deviations), Look())
    return Shown([_with_pins(content, local[list(view.particles)])], 1, None, {shape.title: local})


def _with_pins(content: Content, ends: FloatArray) -> Content:
    """Mark two places of a surface with pins from outside, and the straight way between them."""
    assert content.groomed is not None
    assert content.normals is not None
    vertices = content.groomed.vertices
    at = [int(np.square(vertices - end).sum(axis=1).argmin()) for end in ends]
    pins = -_PIN * float(np.ptp(vertices, axis=0).max()) * np.asarray(content.normals, np.float64)[at]
    return replace(content, arrows=Arrows(ends - pins, pins), lines=ends[None], through=True)
