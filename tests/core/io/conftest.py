"""A model to give away."""

import json

import pytest


@pytest.fixture
def exported(finished_run, tmp_path):
    """Return the ``.swproj`` file that the finished run was written to."""
    from homolog.io.shapeworks_export import write_shapeworks

    return write_shapeworks(finished_run, tmp_path / "out")


@pytest.fixture
def content(exported):
    return json.loads(exported.read_text(encoding="utf-8"))
