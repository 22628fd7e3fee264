from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.text import Text

from homolog.patient.distribution import percentile
from homolog.statistics.welch import compare_measure
from homolog_app.pictures.layout import write_picture
from homolog_app.plots import (
    discriminant_points,
    draw_all_names,
    draw_boxes,
    draw_discriminant,
    draw_energies,
    draw_measure,
    draw_percentiles,
    draw_place,
    draw_quality,
    draw_scores,
    draw_scree,
    draw_slope,
    draw_subjects,
    group_order,
    group_style,
    new_figure,
    percentile_rows,
)
from homolog_app.plots.model import fitting, width_of
from homolog_app.rendering.colours import DARK, LIGHT, LIGHT_SCHEME, page_colours

COLOURS = LIGHT_SCHEME
LABELS = ("mode 1, SD", "mode 2, SD")


def _axes(width=4.6, height=3.0, colours=COLOURS):
    return new_figure(width, height, colours).subplots()


def _inside(figure):
    """Whether everything drawn lies on the page."""
    figure.canvas.draw()
    drawn = figure.get_tightbbox()
    width, height = figure.get_size_inches()
    return drawn.x0 >= 0.0 and drawn.y0 >= 0.0 and drawn.x1 <= width and drawn.y1 <= height


def _figures(colours):
    generator = np.random.default_rng(0)
    numbers, groups = generator.normal(size=(9, 4)), ["NOR", "HCM", "a group with quite a long name"] * 3
    eigenvalues = np.sort(generator.random(30))[::-1]
    row = {"colours": colours}
    drawn = {
        name: new_figure(4.0, 3.0, colours)
        for name in ("scree", "scores", "discriminant", "slope", "boxes", "measure")
    } | {name: new_figure(7.2, 2.5, colours) for name in ("energies", "quality")}
    draw_scree(drawn["scree"].subplots(), eigenvalues, np.full(30, 0.5), 12, 95.0, **row)
    draw_scores(drawn["scores"].subplots(), numbers[:, :2], groups, LABELS, **row, ellipses=True)
    second = np.arange(9) < 4
    draw_discriminant(
        drawn["discriminant"].subplots(),
        numbers[:, 0],
        second,
        ("a long group name", "b"),
        ["b", "a long group name"],
        **row,
    )
    draw_slope(drawn["slope"].subplots(), numbers[:, 0], numbers[:, 1], groups, "age", 0.1, **row)
    measure = compare_measure(numbers[:, 0], [*("a" * 3), *("b" * (len(numbers) - 3))])
    draw_boxes(drawn["boxes"].subplots(), measure, "Volume", "ml", places=range(2), **row)
    draw_measure(drawn["measure"].subplots(), np.arange(9.0), numbers[:, 0], "Volume", "mode 1 (SD)", **row)
    draw_energies(drawn["energies"].subplots(1, 3), numbers, **row)
    draw_quality(
        drawn["quality"].subplots(1, 3),
        np.linspace(0.4, 1.0, 8),
        np.linspace(2.0, 1.0, 7),
        ([1, 4, 8], np.ones(3)),
        **row,
    )
    return drawn


@pytest.mark.parametrize("theme", [LIGHT, DARK])
def test_every_plot_fits_its_page_and_is_vector_graphics_with_texts(theme, tmp_path):
    for name, figure in _figures(page_colours(theme)).items():
        assert _inside(figure), name
        write_picture(figure, tmp_path / "plot.svg")
        svg = (tmp_path / "plot.svg").read_text("utf-8")
        assert "<path" in svg, name
        assert "<text" in svg, name
        assert "<image" not in svg, name


@pytest.mark.parametrize("theme", [LIGHT, DARK])
def test_plots_of_reports_have_the_ground_of_the_pictures_beside_them(theme):
    figure = new_figure(2.0, 2.0, page_colours(theme))
    assert figure.get_facecolor()[:3] == pytest.approx(theme.background, abs=0.003)


def test_the_scree_plot_draws_shares_and_marks_the_retained_modes():
    axes = _axes()
    draw_scree(axes, np.array([6.0, 3.0, 1.0]), np.array([4.0, 2.0, 2.0]), 2, 95.0, COLOURS)
    assert [bar.get_height() for bar in axes.patches] == pytest.approx([60.0, 30.0, 10.0])
    first, second, third = (bar.get_facecolor() for bar in axes.patches)
    assert first == second != third
    assert axes.lines[0].get_ydata() == pytest.approx([40.0, 20.0, 20.0])
    assert axes.get_title(loc="left") == "2 modes retained"


def test_the_score_plot_shows_each_group_once_with_its_size():
    scores, axes = np.arange(10.0).reshape(5, 2), _axes()
    draw_scores(axes, scores, ["a", "b", "a", "a", "b"], LABELS, COLOURS)
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["a (3)", "b (2)"]
    np.testing.assert_array_equal(axes.collections[0].get_offsets(), scores[[0, 2, 3]])
    assert axes.get_xlabel() == LABELS[0]


def test_an_ellipse_holds_95_percent_of_a_normal_group():
    points, axes = np.random.default_rng(1).normal(size=(4000, 2)) @ [[2.0, 1.0], [0.0, 0.5]], _axes()
    draw_scores(axes, points, ["a"] * len(points), LABELS, COLOURS, ellipses=True)
    (ellipse,) = axes.patches
    inside = ellipse.get_path().contains_points(ellipse.get_patch_transform().inverted().transform(points))
    assert inside.mean() == pytest.approx(0.95, abs=0.01)


def test_groups_differ_in_colour_and_marker_and_keep_them_beside_subjects_without_a_group():
    assert group_order(["b", "", "a", "b"]) == ["a", "b", ""]
    assert group_order(["HCM", "NOR", ""]) == ["NOR", "HCM", ""]
    styles = [group_style(index, COLOURS) for index in range(14)]
    assert len(set(styles)) == 14
    assert len({colour for colour, _ in styles[:7]}) == len({marker for _, marker in styles[:7]}) == 7


def test_the_discriminant_plot_keeps_the_groups_apart():
    places, second, axes = np.array([-2.0, -1.0, 1.0, 2.0]), np.array([False, False, True, True]), _axes()
    draw_discriminant(axes, places, second, ("n", "h"), ["h", "n"], COLOURS)
    np.testing.assert_array_equal(axes.collections[0].get_offsets()[:, 0], [-2.0, -1.0])
    np.testing.assert_array_equal(axes.collections[1].get_offsets()[:, 0], [1.0, 2.0])
    assert [label.get_text() for label in axes.get_yticklabels()] == ["n (2)", "h (2)"]
    heights = discriminant_points(places, second)[:, 1]
    assert heights[:2].min() > 0.5 > heights[2:].max()


def _boxes(axes):
    axes.figure.draw_without_rendering()
    return [Text.get_window_extent(text) for text in axes.texts]


def test_names_cover_neither_each_other_nor_marks_and_those_of_selected_subjects_go_first():
    axes, points = _axes(), np.array([[0.02 * k, 0.0] for k in range(6)] + [[2.0, 2.0]])
    axes.set(xlim=(-3.0, 3.0), ylim=(-3.0, 3.0))
    axes.figure.draw_without_rendering()
    names = ["subject a", "subject b", "subject c", "subject d", "subject e", "subject f", "alone"]
    drawn = draw_subjects(axes, points, names, ["subject f"], COLOURS)
    shown = [text.get_text() for text in axes.texts]
    assert shown[0] == "subject f"
    assert "alone" in shown
    boxes = _boxes(axes)
    assert len(boxes) > 4
    assert all(boxes[k].count_overlaps(boxes[:k]) == 0 for k in range(len(boxes)))
    assert not any(box.count_contains(axes.transData.transform(points)) for box in boxes)
    for artist in drawn:
        artist.remove()
    assert not axes.texts
    assert not axes.lines
    draw_subjects(axes, points, names, names, COLOURS)
    assert len(axes.lines) == len(names)  # each has its ring


def test_a_name_covers_no_mean_of_a_group():
    axes, points = _axes(), np.array([[-0.3, 0.0], [1.1, 0.4]])
    draw_scores(axes, points, ["a", "a"], LABELS, COLOURS)
    axes.set(xlim=(-3.0, 3.0), ylim=(-3.0, 3.0))
    axes.figure.draw_without_rendering()
    draw_subjects(axes, points, ["a very long name", "another long name"], [], COLOURS)
    assert len(axes.texts) == 2
    assert not any(box.count_contains(axes.transData.transform([[0.4, 0.2]])) for box in _boxes(axes))


def test_a_crowded_plot_says_how_many_names_it_shows_and_a_large_one_shows_all():
    points = np.random.default_rng(3).normal(size=(20, 2))
    names, notes, counts = [f"subject {k:02d}" for k in range(20)], [], []
    for size in ((3.0, 1.8), (10.0, 6.7)):
        figure = new_figure(*size, COLOURS)
        axes = figure.subplots()
        draw_scores(axes, points, [""] * 20, LABELS, COLOURS)
        axes.set(xlim=(-4.0, 4.0), ylim=(-4.0, 4.0))
        draw_all_names(axes, points, names, ["subject 07"], COLOURS)
        boxes, marks = _boxes(axes), axes.transData.transform(points)
        assert not any(box.count_contains(marks) for box in boxes)
        counts.append(len(boxes))
        notes.append(figure.get_supxlabel())
    assert 3 < counts[0] < counts[1] == 20
    assert notes[0].startswith(f"{counts[0]} of 20 names")
    assert not notes[1]


def test_a_label_is_shortened_to_its_room_only():
    text = "Distance outside the modes"
    assert fitting(text, width_of(text)) == text
    short = fitting(text, 60.0)
    assert 40.0 < width_of(short) <= 60.0
    assert short.startswith("Dis")


def test_the_name_of_a_selected_subject_covers_no_other_subject():
    axes, points = _axes(), np.array([[0.0, 0.0], [0.4, 0.3], [0.5, -0.3], [-0.4, 0.3]])
    axes.set(xlim=(-3.0, 3.0), ylim=(-3.0, 3.0))
    draw_subjects(axes, points, ["chosen", "a", "b", "c"], ["chosen"], COLOURS, others=False)
    (text,) = axes.texts
    axes.figure.canvas.draw()
    box = text.get_window_extent(axes.figure.canvas.get_renderer())
    assert text.get_text() == "chosen"
    assert not box.count_contains(axes.transData.transform(points))


@pytest.mark.parametrize("y", [5.0, None])
def test_the_place_of_the_shape_that_is_shown_moves_no_limit(y):
    axes = _axes()
    draw_measure(axes, np.arange(3.0), np.arange(3.0), "Volume", "mode 1 (SD)", COLOURS)
    before = axes.get_xlim(), axes.get_ylim()
    assert draw_place(axes, 50.0, y, COLOURS).get_xdata()[0] == 50.0
    assert (axes.get_xlim(), axes.get_ylim()) == before


def test_a_part_of_the_objective_that_does_not_count_says_so():
    figure, rows = new_figure(7.0, 2.0, COLOURS), np.ones((5, 4))
    rows[:, 0], rows[:, 3] = np.arange(5), 0.0
    draw_energies(figure.subplots(1, 3), rows, COLOURS)
    assert [bool(axes.texts) for axes in figure.axes] == [False, False, True]


def test_nearly_equal_measures_look_nearly_equal():
    axes = _axes()
    measure = compare_measure(np.array([79.55, 79.551, 79.56, 79.562]), ["a", "a", "b", "b"])
    draw_boxes(axes, measure, "Distance", "mm", COLOURS, range(2))
    low, high = axes.get_ylim()
    assert high - low > 1.0
    assert low < 79.55 < 79.562 < high
    axes = _axes()
    draw_measure(axes, np.array([-1.0, 1.0]), np.array([79.2, 79.22]), "Distance", "mode 1 (SD)", COLOURS)
    assert np.diff(axes.get_ylim())[0] > 1.0


@pytest.mark.parametrize(("largest", "colour"), [(5.0, COLOURS.accent), (6.0, COLOURS.danger)])
def test_a_patient_beyond_the_limit_is_red_even_if_few_controls_do_not_allow_a_small_p(largest, colour):
    controls = np.linspace(2.0, 4.5, 12)
    usual = {name: percentile(3.0, controls) for name in ("mahalanobis", "outside", "size")}
    comparison = SimpleNamespace(**usual, local=percentile(largest, controls))
    values = dict.fromkeys(("mahalanobis", "outside", "size", "maxima"), controls)
    figure = new_figure(6.6, 2.6, COLOURS)
    rows = percentile_rows(comparison, SimpleNamespace(**values, limit=5.5))
    draw_percentiles(figure.subplots(4, 1), rows, COLOURS)
    marks = [axes.lines[-1].get_color() for axes in figure.axes]
    assert marks == [COLOURS.accent] * 3 + [colour]
