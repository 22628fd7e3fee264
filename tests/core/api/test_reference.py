"""The reference of the Python API is made from the docstrings, and is up to date."""

import runpy
from pathlib import Path

import pytest

import homolog as hl

DOCS = Path(__file__).parents[3] / "docs"


@pytest.fixture(scope="module")
def made():
    """Return the names of the program that makes the reference."""
    return runpy.run_path(str(DOCS / "make_api.py"))


def test_the_reference_is_that_of_the_docstrings(made):
    written = (DOCS / "api.md").read_text("utf-8")
    assert written == made["reference"](), "run: python docs/make_api.py"


def test_the_reference_has_every_public_name(made):
    shown = {member.__name__ for members in made["GROUPS"].values() for member in members}
    assert set(hl.__all__) <= shown
