"""The manual's pictures: made by one command, all shown, none empty, every page of the window in them."""

import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

DOCS = Path(__file__).parents[1] / "docs"
PICTURES = DOCS / "images" / "manual"
TEXT = (DOCS / "manual.md").read_text(encoding="utf-8")
PROGRAMS = "\n".join(path.read_text(encoding="utf-8") for path in sorted(PICTURES.glob("*.py")))
WINDOW, DIALOGS = (1280, 800), {"export", "palette"}
COLOURS, EMPTY = 500, 10.0


def test_the_pictures_that_are_made_are_those_that_are_there_and_those_that_the_manual_shows():
    made = set(re.findall(r'keep\(\s*"(\w+)"', PROGRAMS)) | set(re.findall(r'"(check_\w+)"', PROGRAMS))
    assert {path.stem for path in PICTURES.glob("*.png")} == made
    assert set(re.findall(r"\(images/manual/(\w+)\.png\)", TEXT)) == made


@pytest.mark.parametrize("path", sorted(PICTURES.glob("*.png")), ids=lambda path: path.stem)
def test_a_picture_has_the_size_of_the_window_and_shows_something(path):
    with Image.open(path) as picture:
        colours = picture.convert("RGB")
    if path.stem not in DIALOGS:
        assert colours.size == WINDOW
    assert colours.getcolors(COLOURS) is None  # as there are more
    assert np.asarray(colours.convert("L")).std() > EMPTY


def test_every_step_and_every_page_of_explore_is_in_a_picture_and_in_the_manual():
    from homolog_app.window.commands import COMMANDS

    pages = [entry for entry in COMMANDS if entry.menu == "Explore" and entry.shortcut.startswith("F")]
    assert len(pages) == 5
    for page in pages:
        assert f'"{page.id}"' in PROGRAMS, page.title
        assert f"*Explore > {page.title}*" in TEXT, page.title
    for step in ("groom", "correspond", "explore"):
        assert f'show_step("{step}")' in PROGRAMS
