"""The pictures of a finished project: mean, modes, and every subject with its particles."""

from matplotlib.figure import Figure

from homolog.analysis.shape_model import ShapeModel
from homolog.files.atomic import atomic_write
from homolog.files.project import ProjectFolder
from homolog.files.results import read_modes, read_result, read_surfaces
from homolog.progress import Tick, no_tick
from homolog_app.pictures import ModeSurfaces, draw_modes, draw_particles, draw_subjects, write_picture

__all__ = ["draw_figures"]

_MODES = 3


def draw_figures(project: ProjectFolder, tick: Tick = no_tick) -> None:
    """Draw a project's result into its ``figures`` folder.

    Parameters
    ----------
    project : ProjectFolder
    tick : Tick

    Raises
    ------
    InputError
        If there is no result, or a picture can't be written.
    """
    tick(0.0, "pictures")
    result, record = read_result(project), project.read().result
    assert record is not None, "a result was read"
    aside = f" ({record.mirrored_words})" if record.mirrored_words else ""
    _write(
        project,
        "mean.png",
        draw_particles(result.mean_surface, result.world.mean(axis=0), title=f"Mean shape{aside}"),
    )
    tick(0.2, "pictures of the modes")
    moves = read_modes(project, result.mean_surface)
    shares = ShapeModel.fit(result.world).explained_variance_ratio[: len(moves)]
    if len(moves):  # identical shapes have no modes
        modes = ModeSurfaces(result.mean_surface, moves, shares)
        _write(
            project,
            "modes.png",
            draw_modes({"": modes}, modes=range(min(_MODES, len(moves))), title=f"Modes of variation{aside}"),
        )
    surfaces = read_surfaces(project)
    tick(0.4, "pictures of the subjects")
    names = [
        f"{subject.name}, mirrored" if subject.is_mirrored else subject.name for subject in record.subjects
    ]
    for page, figure in enumerate(draw_subjects(names, surfaces, result.world), start=1):
        _write(project, f"subjects_{page:02d}.png", figure)
        tick(0.4 + 0.6 * min(12 * page / len(surfaces), 1.0), "pictures of the subjects")


def _write(project: ProjectFolder, name: str, figure: Figure) -> None:
    with atomic_write(project.figures / name) as part:
        write_picture(figure, part)
