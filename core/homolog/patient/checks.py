"""Checks of a patient's unit, side and structure."""

import numpy as np
from scipy.spatial import KDTree

from homolog.arrays import FloatArray
from homolog.cohort import other_side
from homolog.errors import InputError
from homolog.geometry import rms_radius, transform_points
from homolog.patient.fit import SurfaceFit
from homolog.patient.left_out import Measures, gap_of_image
from homolog.patient.reference import Reference
from homolog.patient.surface_model import SurfaceModel
from homolog.progress import Tick, no_tick
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["check_fit", "check_unit", "control_remarks"]

_OTHER_SIZE = 3.0
_UNITS = {"m": 1000.0, "cm": 10.0, "inches": 25.4, "micrometres": 0.001}
_UNIT_TOLERANCE = 1.6
_MIRRORED_BETTER = 0.65
_OTHER_SHAPE, _ODD_SHAPE = 0.10, 2.0
_OTHER_MODES, _ODD_MODES = 10.0, 4.0
"""Least median distance relative to the size, and least distance in the modes [SD], of another structure.
Both must also exceed the controls' largest values by these factors."""
_UNCOVERED = 0.15
"""Least median distance of the patient's surface from the fitted one, relative to the size, if the model fits
only a part."""


def control_remarks(reference: Reference) -> list[str]:
    """Return remarks on the controls: several groups, and controls that are unlike the others."""
    remarks = []
    if mixture := reference.provenance.mixture:
        remarks.append(
            f"controls are of several groups ({mixture}): differences between these widen the limits; make "
            "the reference of one group"
        )
    return [*remarks, *filter(None, [_unlike_text(reference)])]


def _unlike_text(reference: Reference) -> str:
    """Name the controls that are unlike the others, and how far they are from their fits; empty if none."""
    distances = [f"{value:.2f} mm" for value in reference.unlike_distances.tolist()]
    if not distances:
        return ""
    each = distances
    if reference.unlike:
        each = [f"{name}: {value}" for name, value in zip(reference.unlike, distances, strict=True)]
    usual, verb = float(np.median(reference.outside)), "is" if len(each) == 1 else "are"
    return (
        f"{len(each)} of {len(reference.outside)} controls {verb} unlike the others "
        f"({', '.join(each)} from the fitted model, usually {usual:.2f} mm): limits are wide, and another "
        "structure may not be recognized; exclude subjects that are not controls"
    )


def check_unit(name: str, mesh: TriangleMesh, model: SurfaceModel, columns: FloatArray) -> None:
    """Check that a surface has about the size of the reference, to detect another unit.

    Parameters
    ----------
    name : str
        Name of the patient, for messages.
    mesh : TriangleMesh
        The patient's surface.
    model : SurfaceModel
        Model of the reference.
    columns : (c,) array
        The patient's covariates.

    Raises
    ------
    InputError
        If the surface is far larger or smaller than the reference.
    """
    typical = float(rms_radius(model.expected(columns)[: model.vertices]))
    ratio = float(rms_radius(mesh.vertices)) / typical
    if 1.0 / _OTHER_SIZE < ratio < _OTHER_SIZE:
        return
    times, word = (ratio, "large") if ratio > 1.0 else (1.0 / ratio, "small")
    likely = [
        unit for unit, factor in _UNITS.items() if 1.0 / _UNIT_TOLERANCE < ratio * factor < _UNIT_TOLERANCE
    ]
    meant = (
        f"its unit seems to be {likely[0]}: export it in mm"
        if likely
        else "check its unit (mm) and structure"
    )
    raise InputError(f"{name}: is {times:.3g} times as {word} as the reference; {meant}")


def check_fit(
    name: str,
    reference: Reference,
    mesh: TriangleMesh,
    fit: SurfaceFit,
    measures: Measures,
    columns: FloatArray,
    tick: Tick = no_tick,
    *,
    force: bool = False,
) -> list[str]:
    """Return remarks on a fit that is worse than those of all controls.

    Parameters
    ----------
    name : str
        Name of the patient, for messages.
    reference : Reference
    mesh : TriangleMesh
        The patient's fitted surface.
    fit : SurfaceFit
    measures : Measures
        Measures of the fit.
    columns : (c,) array
        The patient's covariates.
    tick : Tick
    force : bool
        Whether to return errors as remarks.

    Raises
    ------
    InputError
        If the mirror image fits far better, or neither fits.
    """
    try:
        return _checked(name, reference, mesh, fit, measures, columns, tick)
    except InputError as error:
        if not force:
            raise
        return [str(error).removeprefix(f"{name}: ")]


def _checked(
    name: str,
    reference: Reference,
    mesh: TriangleMesh,
    fit: SurfaceFit,
    measures: Measures,
    columns: FloatArray,
    tick: Tick,
) -> list[str]:
    limit = float(reference.gap[-1])
    _check_structure(name, reference, mesh, fit, measures)
    if reference.side_limit is None and measures.gap <= limit:
        return []
    remarks = _side_remarks(name, reference, mesh, measures, columns, tick)
    if measures.gap <= limit:
        return remarks
    percent = f"{100.0 * measures.gap:.1f} %"
    if measures.gap > _largest_gap(reference):
        raise InputError(
            f"{name}: does not look like the reference: after fitting it is {percent} of its size "
            f"away, controls at most {100.0 * limit:.1f} %; check that this is the complete structure (label)"
        )
    return [
        *remarks,
        f"fits worse than every control: its median distance is {percent} of its size, that of "
        f"controls at most {100.0 * limit:.1f} %; check its segmentation",
    ]


def _largest_gap(reference: Reference) -> float:
    """Return the least median distance from the fit, relative to the size, of another structure."""
    return max(_OTHER_SHAPE, _ODD_SHAPE * float(reference.gap[-1]))


def _check_structure(
    name: str, reference: Reference, mesh: TriangleMesh, fit: SurfaceFit, measures: Measures
) -> None:
    """Raise InputError if the model covers only a part of the surface, or is far from it in the modes."""
    placed = transform_points(fit.pose, mesh.vertices)
    apart = np.asarray(KDTree(fit.expected[: reference.model.vertices]).query(placed)[0])
    uncovered = float(np.median(apart)) / float(rms_radius(placed))
    if uncovered > _UNCOVERED:
        raise InputError(
            f"{name}: does not look like the reference: half of its surface is more than "
            f"{100.0 * uncovered:.0f} % of its size away from the range of controls; check that it "
            "shows the complete structure, and the same one (label)"
        )
    limit = float(reference.mahalanobis[-1])
    if measures.mahalanobis > max(_OTHER_MODES, _ODD_MODES * limit):
        raise InputError(
            f"{name}: does not look like the reference: {measures.mahalanobis:.0f} standard deviations "
            f"from its mean, controls at most {limit:.1f}; check that it shows the same structure "
            "(label) as a whole"
        )


def _side_remarks(
    name: str,
    reference: Reference,
    mesh: TriangleMesh,
    measures: Measures,
    columns: FloatArray,
    tick: Tick,
) -> list[str]:
    """Raise InputError if the mirror image fits far better; return a remark if it fits about as well."""
    limit, percent = reference.side_limit, f"{100.0 * measures.gap:.1f} %"
    other = gap_of_image(reference.model, mesh, columns, reference.modes, tick)
    if other > _largest_gap(reference):
        return []  # neither side is similar to the controls
    is_clear = limit is not None and other < limit * measures.gap
    fits_worse = measures.gap > float(reference.gap[-1])
    if is_clear or (fits_worse and other < _MIRRORED_BETTER * measures.gap):
        side = reference.provenance.side
        remedy = (
            f"it is of the other side; give its side ({other_side(side)}), or correct the file"
            if side
            else "it is of the other side, or its file is mirrored; correct the file"
        )
        raise InputError(
            f"{name}: fits the {side}{' ' * bool(side)}controls better mirrored "
            f"({100.0 * other:.1f} % of its size away, not {percent}): {remedy}"
        )
    if limit is None or other >= measures.gap / limit:
        return []
    return [
        f"its shape does not show its side: its mirror image fits about as well ({100.0 * other:.1f} % "
        f"of its size away, unmirrored {percent}); make sure that its file is not mirrored"
    ]
