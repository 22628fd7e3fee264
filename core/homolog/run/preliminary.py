"""Particles of a run in progress, as a result in memory."""

import numpy as np

from homolog.arrays import frozen
from homolog.correspondence import Frame
from homolog.geometry import inverse_matrices, transform_points
from homolog.io.results import Part, Result
from homolog.progress import Tick, no_tick
from homolog.run.result import OptimizationInput
from homolog.run.shape_files import mesh_of, surface_of_shapes
from homolog.statistics.shape_model import ShapeModel

__all__ = ["preliminary_result"]


def preliminary_result(inputs: OptimizationInput, frame: Frame, tick: Tick = no_tick) -> Result:
    """Return the particles of a frame of a run with their mean surface; nothing is written.

    Parameters
    ----------
    inputs : OptimizationInput
    frame : Frame
        Frame of the optimization of these inputs.
    tick : Tick

    Returns
    -------
    Result

    Raises
    ------
    NumericalError
        If particles coincide, so that they define no warp of the surface.
    """
    world = frame.world.astype(np.float64)
    model = ShapeModel().fit(world, names=[shape.name for shape in inputs.shapes])
    surface = surface_of_shapes(
        model, world, inputs.shapes, frame.alignments, inputs.pieces(frame.counts), tick
    )
    subjects = inputs.cohort.subjects
    return Result(
        names=tuple(subject.name for subject in subjects),
        groups=tuple(subject.group for subject in subjects),
        columns=tuple(dict(subject.columns) for subject in subjects),
        world=frozen(world),
        local=frozen(transform_points(inverse_matrices(frame.alignments), world)),
        alignments=frozen(frame.alignments),
        mean_surface=mesh_of(surface),
        smoothing=frozen(surface.smoothing),
        parts=tuple(Part(name, *own) for name, own in zip(inputs.parts, surface.parts, strict=True)),
    )
