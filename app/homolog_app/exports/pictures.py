"""Pictures of a result as files: plots, stills, films (MP4, GIF, folders of PNG)."""

import errno
import os
import subprocess
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from homolog.comparison.places import SurfaceCarrier
from homolog.comparison.sample import column_of
from homolog.errors import InputError, NumericalError
from homolog.io.atomic import atomic_write, replace_folder
from homolog.io.project import ProjectFolder
from homolog.io.results import Result, read_result
from homolog.progress import Tick, no_tick
from homolog.statistics.parallel import parallel_analysis
from homolog.statistics.shape_model import ShapeModel
from homolog_app.exports.motion import mode_motions
from homolog_app.exports.settings import Background, Plot, PlotSettings
from homolog_app.exports.tables import compare
from homolog_app.pictures import DARK, LIGHT, ModeSurfaces, Theme, draw_modes
from homolog_app.pictures.png import png_of
from homolog_app.report.figures import (
    discriminant_figure,
    energies_figure,
    map_figure,
    quality_figure,
    scores_figure,
    scree_figure,
)

__all__ = ["FILM_SUFFIXES", "draw_plot", "write_film", "write_still"]

FILM_SUFFIXES = (".mp4", ".gif", "")
"""Suffixes of films; a name without suffix is a folder of numbered pictures."""

_PALETTE_FRAMES = 8
_H264 = [
    "-c:v",
    "libx264",
    "-preset",
    "medium",
    "-crf",
    "18",
    "-pix_fmt",
    "yuv420p",
    "-movflags",
    "+faststart",
]
_UNDATED = ["-map_metadata", "-1", "-fflags", "+bitexact", "-flags:v", "+bitexact"]
_Picture = NDArray[np.uint8]


def write_film(
    path: Path, draw: Callable[[int], _Picture], frames: int, fps: int, tick: Tick = no_tick
) -> None:
    """Write a film: widely supported H.264, an endless GIF, or numbered pictures.

    Parameters
    ----------
    path : Path
        File that ends in .mp4 or .gif, or a folder to create. A folder that is not empty is refused.
    draw : function of the frame's index
        Returns the frame, (height, width, 4) in 0 ... 255; all have the same even size.
    frames : int
        Number of frames.
    fps : int
        Frames per second.
    tick : Tick
        Progress and cancellation; if it raises, partial output is removed.

    Raises
    ------
    InputError
        If the suffix is unknown, the folder is in use, or the disk is full.
    """
    suffix = path.suffix.lower()
    if suffix not in FILM_SUFFIXES:
        raise InputError(f"{path}: use .mp4 or .gif, or no suffix for a folder of PNG frames")

    def counted() -> Iterable[bytes]:
        for index in range(frames):
            tick(index / frames, f"frame {index + 1} of {frames}")
            yield _rgb(draw(index))

    if not suffix:
        with replace_folder(path) as folder:
            for index in range(frames):
                tick(index / frames, f"frame {index + 1} of {frames}")
                (folder / f"{index + 1:0{len(str(frames))}d}.png").write_bytes(png_of(draw(index)))
        return
    height, width = draw(0).shape[:2]
    source = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", str(fps), "-i", "-"]
    with atomic_write(path) as part:
        if suffix == ".mp4":
            _encode([*source, *_H264, *_UNDATED], counted(), part)
            return
        colours = part.with_suffix(".png")
        try:
            sampled = np.linspace(0, frames - 1, min(frames, _PALETTE_FRAMES)).astype(int)
            _encode([*source, "-vf", "palettegen"], (_rgb(draw(int(index))) for index in sampled), colours)
            mapped = ["-lavfi", "[0:v][1:v]paletteuse=dither=sierra2_4a", "-loop", "0"]
            _encode([*source, "-i", str(colours), *mapped, *_UNDATED], counted(), part)
        finally:
            colours.unlink(missing_ok=True)


def write_still(path: Path, picture: _Picture) -> None:
    """Write one picture as PNG, atomically; raises InputError if it can't be written."""
    if path.suffix.lower() != ".png":
        raise InputError(f"{path}: pictures are written as .png; use that suffix")
    with atomic_write(path) as part:
        part.write_bytes(png_of(picture))


def _rgb(picture: _Picture) -> bytes:
    return picture[..., :3].tobytes()


def _encode(arguments: list[str], frames: Iterable[bytes], path: Path) -> None:
    """Pipe frames through FFmpeg; its process ends with this function in any case."""
    from imageio_ffmpeg import get_ffmpeg_exe

    command = [get_ffmpeg_exe(), "-loglevel", "error", "-y", *arguments, str(path)]
    # Python ignores SIGXFSZ. FFmpeg must ignore it, too, so that it reports the error
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stderr=subprocess.PIPE, restore_signals=False
    ) as encoder:
        assert encoder.stdin is not None
        assert encoder.stderr is not None
        try:
            for frame in frames:
                encoder.stdin.write(frame)
            encoder.stdin.close()
        except BrokenPipeError:
            pass  # it has ended early; its message follows below
        except BaseException:
            encoder.kill()
            raise
        message = encoder.stderr.read().decode(errors="replace").strip()
    if encoder.returncode:
        for number in (errno.ENOSPC, errno.EFBIG, errno.EDQUOT):
            if os.strerror(number) in message:
                raise OSError(number, os.strerror(number))
        raise NumericalError(f"{path.name}: encoding failed: {message or encoder.returncode}")


def draw_plot(
    project: ProjectFolder,
    settings: PlotSettings,
    groups: tuple[str, str, str] | None = None,
    colour_by: str = "group",
    tick: Tick = no_tick,
) -> Figure:
    """Draw one plot of a project's result.

    Parameters
    ----------
    project : ProjectFolder
        A project with a result.
    settings : PlotSettings
        The kind of plot and its settings.
    groups : (str, str, str), optional
        Column and two groups, for plots that compare them.
    colour_by : str
        Column that determines colours and markers of scores.
    tick : Tick
        Progress and cancellation.

    Raises
    ------
    InputError
        If there is no result, no such column, group or mode, or a comparison lacks its groups.
    """
    theme = DARK if settings.background is Background.DARK else LIGHT
    if settings.kind.needs_groups != (groups is not None):
        raise InputError(
            f"the plot {settings.kind} compares groups; give a column and two of its groups"
            if groups is None
            else f"the plot {settings.kind} compares no groups; omit them"
        )
    result = read_result(project)
    if groups is not None:
        return _comparison(result, settings, groups, theme, tick)
    if settings.kind is Plot.ENERGIES:
        return energies_figure(project, theme)
    tick(0.2, f"plot of {settings.kind}")
    if settings.kind is Plot.SCREE:
        return scree_figure(parallel_analysis(result.world), theme)
    if settings.kind is Plot.MODES:
        return _modes(result, settings.modes, theme)
    model = ShapeModel().fit(result.world, names=result.names)
    if settings.kind is Plot.SCORES:
        _check_modes(settings, len(model.explained_variance_))
        axes = settings.horizontal - 1, settings.vertical - 1
        return scores_figure(model, column_of(result, colour_by), axes, theme)
    if len(result.names) < 3:
        raise InputError("quality is measured by leave-one-out and needs three or more subjects")
    return quality_figure(result, model, theme)


def _check_modes(settings: PlotSettings, count: int) -> None:
    for mode in (settings.horizontal, settings.vertical):
        if mode > count:
            raise InputError(f"mode {mode}: the result has {count} modes; choose one from 1 to {count}")


def _modes(result: Result, most: int, theme: Theme) -> Figure:
    model = ShapeModel().fit(result.world, names=result.names)
    shown = range(min(most, len(model.explained_variance_)))
    moves = [
        mode_motion.displacement for mode_motion in mode_motions(result, [mode + 1 for mode in shown], 1.0)
    ]
    surfaces = ModeSurfaces(result.mean_surface, np.stack(moves), model.explained_variance_ratio_)
    return draw_modes({"": surfaces}, modes=shown, theme=theme)


def _comparison(
    result: Result, settings: PlotSettings, groups: tuple[str, str, str], theme: Theme, tick: Tick
) -> Figure:
    study = compare(result, groups, settings.permutations, settings.seed, tick)
    if settings.kind is Plot.DIFFERENCE:
        return map_figure(study.overall, SurfaceCarrier.of(result), theme)
    if study.overall.discriminant is None:
        raise InputError("no discriminant: parallel analysis retains no mode")
    return discriminant_figure(study, study.overall, theme)
