"""Which font writes what, and what is written where no font has a sign."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

from homolog_app.pictures import write_picture
from homolog_app.plots import draw_discriminant, new_figure
from homolog_app.rendering import text as fonts
from homolog_app.rendering.colour_bar import scale_height, scale_picture
from homolog_app.rendering.colours import GREY, LIGHT_SCHEME, displacement_scale

HAN = "王"


@pytest.fixture
def nothing_installed(monkeypatch):
    """A system without fonts."""
    fonts.font_file.cache_clear()
    monkeypatch.setattr(fonts, "system_files", tuple)
    yield
    fonts.font_file.cache_clear()


def test_latin_and_greek_words_are_written_by_the_usual_font():
    assert fonts.font_file("Müller Ωμέγα, 5.2 mm²").name == "DejaVuSans.ttf"


def test_the_first_font_that_has_all_signs_is_taken(monkeypatch, nothing_installed):
    signs = {"usual": "ab", "half": "ab王", "whole": "ab王明"}
    monkeypatch.setattr(fonts, "usual_file", lambda: "usual")
    monkeypatch.setattr(fonts, "system_files", lambda: ("half", "whole"))
    monkeypatch.setattr(fonts, "signs_lacking", lambda path, text: frozenset(text) - frozenset(signs[path]))
    assert [fonts.font_file(text) for text in ("ab", "a王", "a王明")] == ["usual", "half", "whole"]


def test_a_sign_that_no_font_has_is_a_box(nothing_installed):
    assert fonts.legible(f"a{HAN}b") == "a□b"
    assert fonts.written(f"{HAN}\n{HAN}", fonts.font_file()) == "□\n□"


def test_names_that_no_font_has_or_that_look_like_formulas_are_written_without_a_warning(
    nothing_installed, tmp_path
):
    figure, names = new_figure(4.0, 2.0, LIGHT_SCHEME), (HAN, r"b$\foo$")
    draw_discriminant(figure.subplots(), np.arange(4.0), np.arange(4) > 1, names, names, LIGHT_SCHEME)
    figure.text(0.5, 0.5, f"{HAN} $\\frac$")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        write_picture(figure, tmp_path / "names.svg")
    assert (tmp_path / "names.svg").stat().st_size > 0


def test_matplotlib_writes_with_the_font_that_has_the_sign(monkeypatch, tmp_path):
    text = Figure().text(0.0, 0.0, "a\u16a0")  # a rune, which stands for what the usual font lacks
    usual, other = fonts.font_file(), fonts.font_file().with_name("DejaVuSerif.ttf")
    monkeypatch.setattr(fonts, "font_file", lambda texts="": other if "\u16a0" in texts else usual)
    monkeypatch.setattr(fonts, "signs_lacking", lambda path, message: frozenset())
    fonts.complete_text(text)
    assert text.get_fontfamily() == ["DejaVu Sans", "DejaVu Serif"]


def test_numbers_are_typeset_with_minus_signs_and_stay_beside_their_units():
    from homolog_app.rendering.text import typeset

    text = "HCM - NOR: -0.05 mm (95 % CI -1 to +4.2), F(4, 17) = 9.9, p < 0.001; sub-01 of 2026-11-24"
    assert typeset(text) == (
        "HCM − NOR: −0.05\u00a0mm (95\u00a0%\u00a0CI\u00a0−1 to +4.2), F(4,\u00a017)\u00a0=\u00a09.9, "
        "p\u00a0<\u00a00.001; sub-01 of 2026-11-24"
    )


def test_the_title_of_a_colour_scale_gets_smaller_letters_before_it_is_cut():
    scale = displacement_scale(6.0, "Outward difference from healthy to infarct, adjusted for age and sex")
    picture = scale_picture(scale, LIGHT_SCHEME, 400, 1.0)
    title = (picture[:20] != picture[0, 0]).any(axis=(0, 2))
    assert title.any()
    assert not title[[0, 1, -2, -1]].any()


def test_the_labels_at_the_ends_of_a_colour_scale_are_whole():
    ends = {"low_label": "toward the centre", "high_label": "away from the centre of the shape"}
    picture = scale_picture(replace(displacement_scale(6.0, "Difference"), **ends), LIGHT_SCHEME, 700, 1.0)
    written = (picture[24:36] != picture[0, 0]).any(axis=(0, 2))
    assert written.any()
    assert not written[[0, 1, -2, -1]].any()


def test_a_scale_whose_title_is_wide_explains_grey_in_a_line_of_its_own():
    title = "Outward difference from healthy to infarct"
    scale = replace(displacement_scale(6.0, title), grey_label="p > 0.05")
    pictures = [scale_picture(scale, LIGHT_SCHEME, width, 1.0) for width in (900, 300)]
    heights = [scale_height(scale, width, 1.0) for width in (900, 300)]
    assert [len(picture) for picture in pictures] == heights
    first = [
        np.flatnonzero((picture[:, :, :3] == GREY).all(axis=2).any(axis=1)).min() for picture in pictures
    ]
    assert first[1] - first[0] == heights[1] - heights[0] > 10
