"""Several structures in one surface: their colours, visibility and names in pictures."""

import numpy as np

from homolog.surfaces.mesh import TriangleMesh, joined
from homolog_app.rendering.camera import Canvas, Layer
from homolog_app.rendering.colours import structure_colour
from homolog_app.rendering.content import Content, ViewContents
from homolog_app.rendering.draw import with_opengl
from homolog_app.rendering.grid import drawn

TETRAHEDRON = TriangleMesh(
    [[0.0, 0.0, 0.0], [9.0, 0.0, 0.0], [0.0, 9.0, 0.0], [0.0, 0.0, 9.0]],
    [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]],
)


def content():
    both = joined([TETRAHEDRON, TETRAHEDRON.placed(np.eye(4) + 20.0 * np.eye(4, k=3))])
    return Content("a", None, both, None, np.eye(4), structures={"near": 4, "far": 8})


def pixels(**display):
    shown = ViewContents([content()], 1, None, {})
    return with_opengl(drawn, shown, Canvas(width=200, height=160, letters=False, scale_bar=False, **display))


def has(picture, colour):
    """Return whether a picture has a colour, in any light."""
    near = picture[..., :3] / np.maximum(picture[..., :3].max(axis=-1, keepdims=True), 1.0)
    return bool((np.abs(near - np.array(colour) / max(colour)).max(axis=-1) < 0.04).sum() > 150)


def test_a_joined_surface_falls_into_the_structures_that_it_was_made_of():
    first, second = content().groomed.parts
    np.testing.assert_array_equal(first.faces, TETRAHEDRON.faces)
    np.testing.assert_array_equal(second.faces, TETRAHEDRON.faces)
    np.testing.assert_array_equal(second.vertices - first.vertices, [[20.0, 0.0, 0.0]] * 4)


def test_each_structure_has_its_own_colour_and_can_be_hidden_and_recoloured():
    near, far = structure_colour(0), structure_colour(1)
    assert near != far
    usual = pixels()
    assert has(usual, near)
    assert has(usual, far)
    hidden = pixels(layers=(Layer(name="near", shown=False),))
    assert not has(hidden, near)
    assert has(hidden, far)
    assert has(pixels(layers=(Layer(name="near", colour="#ff0000"),)), (255, 0, 0))


def test_a_picture_names_the_structures_that_it_shows():
    whole = pixels()
    assert len(whole) > 160  # the names are below the views
    without = pixels(layers=(Layer(name="near", shown=False), Layer(name="far", shown=False)))
    assert len(without) == 160


def test_a_particle_belongs_to_a_structure_in_each_stage_of_a_run():
    own = content()
    np.testing.assert_array_equal(own.owners(12), [0] * 4 + [1] * 8)
    np.testing.assert_array_equal(own.owners(6), [0] * 2 + [1] * 4)
    np.testing.assert_array_equal(own.owners(5), [-1] * 5)
