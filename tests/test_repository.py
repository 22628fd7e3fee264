"""The repository as a whole: boundaries, types, style, what the wheel holds, what an import loads."""

import importlib
import os
import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

from homolog import __version__

ROOT = Path(__file__).parents[1]
PATHS = ":".join(str(ROOT / folder) for folder in ("core", "app", "resources"))


def run(*command):
    """Run a Python module's command in the repository; returns its output, fails with it."""
    done = subprocess.run(
        [sys.executable, *command],
        cwd=ROOT,
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=False,
        env={**os.environ, "PYTHONPATH": PATHS},
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_style_rules_hold():
    run("-m", "ruff", "check", ".")


def test_every_file_is_formatted():
    run("-m", "ruff", "format", "--check", ".")


@pytest.mark.timeout(300)
def test_types_are_strict_and_hold():
    run("-m", "mypy")


def test_layers_import_downwards_only():
    run("-c", "from importlinter.cli import lint_imports_command; lint_imports_command()")


@pytest.mark.parametrize("package", ["homolog.run", "homolog.statistics", "homolog.io.results"])
def test_the_core_loads_neither_qt_nor_a_renderer(package):
    loaded = run("-c", f"import sys, {package}; print(*sys.modules)").split()
    heads = {name.split(".")[0] for name in loaded}
    assert not heads & {"PySide6", "qtpy", "pyvista", "pyvistaqt", "vtkmodules", "matplotlib", "homolog_app"}


def test_help_answers_without_the_heavy_libraries():
    loaded = run("-c", "import sys, homolog_app.cli as c; c.command_parser(); print(*sys.modules)").split()
    heads = {name.split(".")[0] for name in loaded}
    assert not heads & {"warp", "SimpleITK", "vtkmodules", "pyvista", "matplotlib", "PySide6", "scipy"}


def test_the_list_of_commands_imports_none_of_them():
    loaded = run("-c", "import sys, homolog_app.cli as c; c.command_parser([]); print(*sys.modules)").split()
    assert not {name for name in loaded if name.startswith("homolog_app.cli.")}
    assert "numpy" not in loaded


@pytest.mark.timeout(300)
def test_the_wheel_holds_the_three_packages_and_a_desktop_entry_and_nothing_else(tmp_path):
    run("-m", "build", "--wheel", "--no-isolation", "--outdir", str(tmp_path), str(ROOT))
    (wheel,) = tmp_path.glob("*.whl")
    everything = zipfile.ZipFile(wheel).namelist()
    shared = {name.split(".data/data/")[1] for name in everything if ".data/data/" in name}
    assert shared == {"share/applications/homolog.desktop", "share/icons/hicolor/scalable/apps/homolog.svg"}
    names = [name for name in everything if ".data/" not in name]
    tops = {name.split("/")[0] for name in names if ".dist-info/" not in name}
    assert tops == {"homolog", "homolog_app", "homolog_resources"}
    sources = {
        str(path.relative_to(ROOT / folder))
        for folder, package in (
            ("core", "homolog"),
            ("app", "homolog_app"),
            ("resources", "homolog_resources"),
        )
        for path in (ROOT / folder / package).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    commit = {"homolog/commit.txt"} if (ROOT / ".git").exists() else set()
    assert {name for name in names if ".dist-info/" not in name} == sources | commit


@pytest.mark.timeout(300)
def test_library_and_command_line_have_a_wheel_that_needs_all_but_window_and_films(tmp_path):
    run("-m", "build", "--wheel", "--no-isolation", "--outdir", str(tmp_path), str(ROOT / "core"))
    (wheel,) = tmp_path.glob(f"homolog_core-{__version__}-*.whl")
    names = zipfile.ZipFile(wheel).namelist()
    tops = {name.split("/")[0] for name in names if ".dist-info/" not in name}
    assert tops == {"homolog", "homolog_app", "homolog_resources"}
    whole, library = (
        tomllib.loads((folder / "pyproject.toml").read_text("utf-8"))["project"]
        for folder in (ROOT, ROOT / "core")
    )
    left_out = {"PySide6-Essentials", "pyvista", "pyvistaqt", "imageio-ffmpeg"}
    needed = [item for item in whole["dependencies"] if re.match(r"[\w-]+", item).group() not in left_out]
    assert library["dependencies"] == needed
    for extra, requirements in library["optional-dependencies"].items():
        assert requirements == whole["optional-dependencies"][extra]


def test_citation_and_changelog_name_the_present_version():
    citation = (ROOT / "CITATION.cff").read_text("utf-8")
    assert re.findall(r"(?m)^version: (.+)$", citation) == [__version__]
    released = re.findall(r"(?m)^## \[?(\d[\d.]*)", (ROOT / "CHANGELOG.md").read_text("utf-8"))
    assert released[0] == __version__


def test_the_desktop_entry_starts_a_script_that_is_installed():
    entry = (ROOT / "resources/homolog_resources/homolog.desktop").read_text("utf-8")
    scripts = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["gui-scripts"]
    (command,) = re.findall(r"(?m)^Exec=(\S+)", entry)
    module, _, function = scripts[command].partition(":")
    assert callable(getattr(importlib.import_module(module), function))


@pytest.mark.parametrize(
    "page", sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")], key=str), ids=lambda page: page.name
)
def test_links_between_pages_lead_somewhere(page):
    text = re.sub(r"```.*?```", "", page.read_text("utf-8"), flags=re.DOTALL)
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        name, _, anchor = target.partition("#")
        if "://" in target:
            continue
        other = (page.parent / name) if name else page
        assert other.exists(), target
        if anchor:
            headings = re.findall(r"(?m)^#+ (.+)$", other.read_text("utf-8"))
            anchors = {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}
            assert anchor in anchors, target
