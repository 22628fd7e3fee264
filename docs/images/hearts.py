"""Draw the README's picture: how infarcts thin the wall of the sample hearts, in truth and as found.

homolog sample hearts --out HEARTS
homolog run HEARTS --out PROJECT --particles 512
homolog run HEARTS --out OTHER --particles 512 --device cuda
python docs/images/hearts.py HEARTS PROJECT OTHER

The picture is of the first project; hearts.csv has the README's figures of all.
"""

import sys
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import homolog as hl
from homolog.arrays import FloatArray
from homolog.comparison.findings import share_of_surface
from homolog.io.project import ProjectFolder
from homolog.io.tables import write_table
from homolog.surfaces.walls import wall_thickness
from homolog_app.pictures import View, write_picture
from homolog_app.pictures.layout import Panel, arrange
from homolog_app.rendering.camera import frame_around
from homolog_app.rendering.colours import diverging_colours
from homolog_app.rendering.draw import draw
from homolog_app.rendering.rays import shaded
from homolog_app.rendering.scene import Scene

LIMIT = 4.0  # mm
MOST = 13.0  # mm: at the rim, rays run along the wall
GREY = 0.62
PIXELS = 430
VIEWS = (
    View((0.5, 0.87, 0.1), (0.0, 0.0, 1.0), "outer wall"),
    View((-0.34, -0.59, 0.73), (0.0, 0.0, 1.0), "into the cavity"),
)


def main(study: Path, folder: Path, *others: Path) -> None:
    """Draw the true change of the wall's thickness next to the change between the group means."""
    rows = [figures(item) for item in (folder, *others)]
    write_table(Path(__file__).with_suffix(".csv"), list(rows[0]), (list(row.values()) for row in rows))
    project = hl.Project(folder)
    reference, affected = (
        hl.read_mesh(study / "truth" / f"{name}.ply") for name in ("reference", "affected")
    )
    centred = reference.vertices - reference.vertices.mean(axis=0)
    groups = np.array(project.groups)
    healthy, infarct = (
        project.surface(project.aligned[groups == group].mean(axis=0)) for group in ("healthy", "infarct")
    )
    exact = exact_mean(study, project)
    upright, _ = Rotation.align_vectors(centred, exact - exact.mean(axis=0))
    maps = (
        (hl.TriangleMesh(centred, reference.faces), thinning(reference, affected)),
        (
            hl.TriangleMesh(upright.apply(healthy.vertices - exact.mean(axis=0)), healthy.faces),
            thinning(healthy, infarct),
        ),
    )
    frames = [frame_around([mesh.vertices for mesh, _ in maps], view) for view in VIEWS]
    panels = [
        Panel(draw(Scene((shaded(mesh, colours),)), frame, PIXELS), frame.view.name)
        for mesh, colours in maps
        for frame in frames
    ]
    headings = ("true change of the wall", f"change found in {len(project.names)} segmentations")
    figure = arrange([panels], headings=headings, limit=LIMIT)
    for text, end in zip(figure.axes[-1].texts, ("thicker\n(mm)", "thinner\n(mm)"), strict=True):
        text.set_text(end)
    write_picture(figure, Path(__file__).with_suffix(".png"))


def figures(folder: Path) -> dict[str, str | float]:
    """Return what `homolog analyze` finds: share of the surface that differs [%], p of the whole shape."""
    (answer,) = hl.analyze(folder, permutations=10_000, seeds=1)
    result = ProjectFolder(folder).read().result
    assert result is not None
    comparison = answer.answer.pairwise[0] if answer.pairwise else answer.comparison
    share = share_of_surface(answer.answer, comparison)
    return {"device": result.device, "surface": share, "p": comparison.p_adjusted}


def thinning(before: hl.TriangleMesh, after: hl.TriangleMesh) -> FloatArray:
    """Return colours (V, 3) of the change of the wall's thickness, grey at the rim."""
    thick = np.stack([wall_thickness(mesh) for mesh in (before, after)])
    colours = diverging_colours(thick[1] - thick[0], LIMIT)
    colours[thick.max(axis=0) > MOST] = GREY
    return colours


def exact_mean(study: Path, project: hl.Project) -> FloatArray:
    """Return the mean of the exact surfaces' corresponding vertices in the project's common frame [mm]."""
    exact = [hl.read_mesh(study / "truth" / f"{name}.ply").vertices for name in project.names]
    placed = [
        points @ item[:3, :3].T + item[:3, 3] for points, item in zip(exact, project.alignments, strict=True)
    ]
    return np.asarray(np.mean(placed, axis=0))


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
