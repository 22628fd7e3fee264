"""Colours of several structures in one surface."""

import numpy as np

from homolog_app.rendering.colours import structure_colours


def test_each_structure_has_a_colour_of_its_own():
    colours = structure_colours([slice(0, 4), slice(4, 6), slice(6, 9)])
    assert colours.shape == (9, 3)
    assert len(np.unique(colours, axis=0)) == 3
    assert (colours[:4] == colours[0]).all()
    assert (colours[4:6] == colours[4]).all()
