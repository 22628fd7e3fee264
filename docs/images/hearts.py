"""Draw the README's picture: how infarcts change the hearts of the sample study, in truth and as found.

homolog sample hearts --out HEARTS
homolog run HEARTS --out PROJECT --particles 512
python docs/images/hearts.py HEARTS PROJECT
"""

import sys
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import homolog as hl
from homolog.arrays import FloatArray
from homolog_app.pictures import View, write_picture
from homolog_app.pictures.layout import Panel, arrange
from homolog_app.rendering.camera import frame_around
from homolog_app.rendering.colours import diverging_colours, outward_displacement
from homolog_app.rendering.draw import draw
from homolog_app.rendering.rays import shaded
from homolog_app.rendering.scene import Scene

LIMIT = 4.0  # mm
PIXELS = 430
VIEWS = (
    View((0.5, 0.87, 0.1), (0.0, 0.0, 1.0), "outer wall"),
    View((-0.34, -0.59, 0.73), (0.0, 0.0, 1.0), "into the cavity"),
)


def main(study: Path, folder: Path) -> None:
    """Draw the true effect next to the difference that Homolog finds between the groups."""
    project = hl.Project(folder)
    result = hl.compare_groups(project.aligned, project.groups, ("healthy", "infarct"), alignment="rigid")
    reference, affected = (
        hl.read_mesh(study / "truth" / f"{name}.ply") for name in ("reference", "affected")
    )
    middle = reference.vertices.mean(axis=0)
    true = (
        hl.TriangleMesh(reference.vertices - middle, reference.faces),
        outward_displacement(reference, affected.vertices - reference.vertices),
    )

    healthy = project.aligned[[group == "healthy" for group in project.groups]].mean(axis=0)
    mean, moved = (project.surface(healthy + share * result.pointwise.effect[0]) for share in (0.0, 1.0))
    exact = exact_mean(study, project)
    upright, _ = Rotation.align_vectors(true[0].vertices, exact - exact.mean(axis=0))
    estimated = (
        hl.TriangleMesh(upright.apply(mean.vertices - exact.mean(axis=0)), mean.faces),
        outward_displacement(mean, moved.vertices - mean.vertices),
    )

    frames = [frame_around([true[0].vertices, estimated[0].vertices], view) for view in VIEWS]
    panels = [
        Panel(draw(Scene((shaded(mesh, diverging_colours(outward, LIMIT)),)), frame, PIXELS), frame.view.name)
        for mesh, outward in (true, estimated)
        for frame in frames
    ]
    headings = ("true effect of the infarct", f"difference found in {len(project.names)} segmentations")
    write_picture(arrange([panels], headings=headings, limit=LIMIT), Path(__file__).with_suffix(".png"))


def exact_mean(study: Path, project: hl.Project) -> FloatArray:
    """Return the mean of the exact surfaces' corresponding vertices in the project's common frame [mm]."""
    exact = [hl.read_mesh(study / "truth" / f"{name}.ply").vertices for name in project.names]
    placed = [
        points @ item[:3, :3].T + item[:3, 3] for points, item in zip(exact, project.alignments, strict=True)
    ]
    return np.asarray(np.mean(placed, axis=0))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
