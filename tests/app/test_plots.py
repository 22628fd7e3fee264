import io

import numpy as np
import pytest

from homolog_app.plots import plot_discriminant, plot_energies, plot_quality, plot_scores, plot_scree
from homolog_app.rendering.colours import DARK, LIGHT


def _svg(figure):
    text = io.StringIO()
    figure.savefig(text, format="svg")
    return text.getvalue()


def _inside(figure):
    """Whether everything drawn lies on the page."""
    figure.canvas.draw()
    drawn = figure.get_tightbbox()
    width, height = figure.get_size_inches()
    return drawn.x0 >= 0.0 and drawn.y0 >= 0.0 and drawn.x1 <= width and drawn.y1 <= height


def _figures(theme):
    generator = np.random.default_rng(0)
    eigenvalues = np.sort(generator.random(30))[::-1]
    return {
        "scree": plot_scree(eigenvalues, np.full(30, 0.5), 12, 95.0, theme=theme),
        "scores": plot_scores(
            generator.normal(size=(9, 3)), np.array([0.5, 0.3, 0.2]), ["NOR", "HCM", "DCM"] * 3, theme=theme
        ),
        "discriminant": plot_discriminant(
            generator.normal(size=9), np.arange(9) < 4, ("a long group name", "b"), theme=theme
        ),
        "energies": plot_energies(
            np.arange(50.0), {"sampling": generator.normal(size=50), "ensemble": np.arange(50.0)}, theme=theme
        ),
        "quality": plot_quality(
            np.linspace(0.4, 1.0, 8), np.linspace(2.0, 1.0, 7), ([1, 4, 8], np.ones(3)), theme=theme
        ),
    }


@pytest.mark.parametrize("theme", [LIGHT, DARK])
def test_every_plot_fits_its_page_and_is_vector_graphics(theme):
    for name, figure in _figures(theme).items():
        assert _inside(figure), name
        svg = _svg(figure)
        assert "<path" in svg, name
        assert "<image" not in svg, name


def test_the_scree_plot_draws_shares_and_marks_the_modes_above_chance():
    figure = plot_scree(np.array([6.0, 3.0, 1.0]), np.array([4.0, 2.0, 2.0]), 2, 95.0)
    axes = figure.axes[0]
    assert [bar.get_height() for bar in axes.patches] == pytest.approx([60.0, 30.0, 10.0])
    assert (
        axes.patches[0].get_facecolor() == axes.patches[1].get_facecolor() != axes.patches[2].get_facecolor()
    )
    assert axes.lines[0].get_ydata() == pytest.approx([40.0, 20.0, 20.0])
    assert axes.get_title() == "2 modes above chance"


def test_the_score_plot_shows_each_group_once_with_its_size():
    scores = np.arange(10.0).reshape(5, 2)
    figure = plot_scores(scores, np.array([0.7, 0.3]), ["a", "b", "a", "a", "b"])
    axes = figure.axes[0]
    assert [get_text.get_text() for get_text in axes.get_legend().get_texts()] == ["a (3)", "b (2)"]
    np.testing.assert_array_equal(axes.collections[0].get_offsets(), scores[[0, 2, 3]])
    assert axes.get_xlabel() == "mode 1 (70 %), score (mm)"


def test_the_discriminant_plot_keeps_the_groups_apart():
    scores = np.array([-2.0, -1.0, 1.0, 2.0])
    axes = plot_discriminant(scores, np.array([False, False, True, True]), ("n", "h")).axes[0]
    np.testing.assert_array_equal(axes.collections[0].get_offsets()[:, 0], [-2.0, -1.0])
    np.testing.assert_array_equal(axes.collections[1].get_offsets()[:, 0], [1.0, 2.0])
    assert [get_yticklabel.get_text() for get_yticklabel in axes.get_yticklabels()] == ["n", "h"]
