"""Both schemes can be read."""

import pytest

from homolog_app.rendering.colours import DARK_SCHEME, LIGHT_SCHEME, rgb

TEXT, GRAPHICS = 4.5, 3.0  # WCAG 2.2, level AA


def contrast(item, other):
    first, second = (
        sum(
            part * (x / 12.92 if x <= 0.03928 else ((x + 0.055) / 1.055) ** 2.4)
            for part, x in zip((0.2126, 0.7152, 0.0722), rgb(colour), strict=True)
        )
        for colour in (item, other)
    )
    return (max(first, second) + 0.05) / (min(first, second) + 0.05)


@pytest.mark.parametrize("colours", [LIGHT_SCHEME, DARK_SCHEME], ids=["light", "dark"])
@pytest.mark.parametrize("ink", ["text", "dim", "accent", "danger", "warning"])
@pytest.mark.parametrize(
    "ground", ["window", "surface", "raised", "sunken", "field", "zebra", "selected", "scene"]
)
def test_texts_stand_out_from_every_ground(colours, ink, ground):
    assert contrast(getattr(colours, ink), getattr(colours, ground)) >= TEXT


@pytest.mark.parametrize("colours", [LIGHT_SCHEME, DARK_SCHEME], ids=["light", "dark"])
def test_markers_of_groups_stand_out_from_the_plot_and_text_from_buttons(colours):
    assert min(contrast(colour, colours.surface) for colour in colours.groups) >= GRAPHICS
    assert contrast(colours.on_accent, colours.accent) >= TEXT


@pytest.mark.parametrize("colours", [LIGHT_SCHEME, DARK_SCHEME], ids=["light", "dark"])
def test_arrows_stand_out_from_the_views_and_from_white_surfaces(colours):
    assert contrast(colours.mark, colours.scene) >= GRAPHICS
    assert contrast(colours.mark, "#ffffff") >= GRAPHICS
