"""Particles of a run in progress, as a result in memory, or as the outcome of a cancelled run."""

from collections.abc import Mapping

import numpy as np

from homolog.arrays import FloatArray, frozen
from homolog.correspondence import Frame, alignments_of_wholes
from homolog.geometry import inverse_matrices, transform_points
from homolog.io.results import Part, Result
from homolog.progress import Tick, no_tick
from homolog.run.result import CANCELLED, OptimizationInput, OptimizationOutcome
from homolog.run.shape_files import mesh_of, surface_of_shapes
from homolog.statistics.shape_model import ShapeModel

__all__ = ["outcome_of_frame", "preliminary_result"]


def outcome_of_frame(
    inputs: OptimizationInput, frame: Frame, energies: FloatArray, seconds: Mapping[str, float]
) -> OptimizationOutcome:
    """Return the particles of a cancelled run, and those of each of several structures, as its outcome."""
    alignments, world = frame.alignments, frame.world.astype(np.float64)
    local = transform_points(inverse_matrices(alignments), world)
    parts = {
        name: outcome_of_frame(own, part, np.empty((0, 4)), seconds)
        for (name, own), part in zip(inputs.parts.items(), frame.parts, strict=True)
    }
    if parts:
        lead, ends = inputs.settings.optimize.align_by, np.cumsum(frame.counts)[:-1]
        seen = local if lead is None else np.split(local, ends, axis=1)[list(parts).index(lead)]
        free = np.ones(len(local), bool)
        alignments = alignments_of_wholes(seen, alignments, free, inputs.settings.placing.procrustes)
        world = transform_points(alignments, local)
    return OptimizationOutcome(
        inputs,
        world,
        local,
        alignments,
        energies,
        frame.iteration,
        CANCELLED,
        seconds,
        parts,
    )


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
