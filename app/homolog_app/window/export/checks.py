"""What keeps an export from being started, in words."""

from pathlib import Path

from pydantic import BaseModel

from homolog_app.exports.settings import PlotSettings
from homolog_app.films.settings import FilmSettings
from homolog_app.window.export.choosers import GroupChooser, MotionChooser

__all__ = ["content_problem", "place_problem"]


def content_problem(chooser: MotionChooser | GroupChooser, settings: BaseModel | None) -> str:
    """Return what is wrong with what is chosen to be exported, or nothing."""
    at_rest = isinstance(chooser, MotionChooser) and chooser.kind == "mean"
    if isinstance(settings, FilmSettings) and at_rest and not settings.turntable:
        return "The mean shape does not move: switch the turntable on."
    if isinstance(settings, PlotSettings):
        named = bool(chooser.arguments())
        if named != settings.kind.needs_groups:
            return "This plot compares no groups." if named else "Choose two groups to compare."
    return chooser.problem


def place_problem(out: Path | None, suffixes: tuple[str, ...]) -> str:
    """Return what is wrong with the place of a file with one of the suffixes, or of a folder, or nothing."""
    if out is None:
        return "Choose where to save."
    if suffixes and out.suffix.lower() not in suffixes:
        kinds = ", ".join(suffix or "no ending for a folder of pictures" for suffix in suffixes)
        return f"The name must end in {kinds}."
    is_folder = not suffixes or not out.suffix
    if is_folder and out.exists() and (not out.is_dir() or any(out.iterdir())):
        return "That folder already exists; choose a new name."
    return ""
