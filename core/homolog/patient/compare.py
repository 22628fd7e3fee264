"""One patient compared with a reference: how unusual its shape is, and where."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from homolog import __version__
from homolog.arrays import BoolArray, FloatArray, IntArray, frozen
from homolog.cluster import read_apart
from homolog.cohort import SIDE_COLUMN, Subject, side_of_word
from homolog.correspondence import Shape
from homolog.errors import InputError, NumericalError
from homolog.geometry import inverse_matrices, transform_points
from homolog.grooming import GroomedSubject, groom_subject
from homolog.grooming.subject import AT_BORDER
from homolog.patient.checks import check_fit, check_unit, control_remarks
from homolog.patient.controls import COARSE_VERTICES
from homolog.patient.cut import CutFit, check_cut, distance_z, ends_of, fit_rest, flat_ends, flat_remarks
from homolog.patient.distribution import Percentile, percentile
from homolog.patient.fit import SurfaceFit, fit_surface
from homolog.patient.left_out import Measures, measures_of
from homolog.patient.local import Region, bands_of, regions, scores_of
from homolog.patient.own_surface import OwnSurface, own_surface
from homolog.patient.reference import Reference
from homolog.patient.wall import local_maps
from homolog.progress import Tick, no_tick, part_of
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.mirroring import MIRROR
from homolog.surfaces.simplify import simplified
from homolog.threads import on_one_thread

__all__ = ["PatientComparison", "compare_groomed", "compare_patient", "groomed_patient", "named_direction"]

_DIRECTIONS = (("right", "left"), ("anterior", "posterior"), ("inferior", "superior"))
_CLEAR = 0.45
"""Smallest component of a unit vector for a named direction."""


@dataclass(frozen=True, slots=True, eq=False)
class PatientComparison:
    """A patient compared with a reference; arrays are read-only.

    Attributes
    ----------
    name : str
    mesh : TriangleMesh
        The groomed surface in the file's frame [mm].
    placement : (4, 4) array
        From the file's frame to the reference's; a reflection where the patient was mirrored.
    covariates : mapping of str to str
        Values as entered.
    fit : SurfaceFit
        The fit, in the frame after `placement`.
    mean : TriangleMesh
        Mean of the reference at the patient's covariates, in the reference's frame.
    expected : TriangleMesh
        The shape that the reference expects of the patient, in the same frame.
    measures : Measures
    mahalanobis, outside, size, local : Percentile
        Percentiles of the measures, and of the largest absolute z, among controls that were fitted as
        patients.
    z : (V,) array
        Differences of position and thickness from the expected ones, standardised: the most extreme of both,
        and of several widths.
    thicker : (V,) array
        Difference of the wall's thickness, relative to the expected one: that of controls, scaled to the
        patient's wall as a whole.
    missing : (V,) bool array
        Vertices cut off by the border of the image; their differences and z are 0.
    total, total_z : (V,) arrays
        Differences from the mean [mm], and the same standardised.
    regions : tuple of Region
        Regions where absolute z exceeds the reference's limit.
    remarks : tuple of str
        The notes of grooming, then the cautions.
    cautions : tuple of str
        Remarks that limit the reliability of the comparison.
    particles : (N, 3) array
        The reference's particles on the patient, in the file's frame [mm].
    own : OwnSurface
        The surface for maps.
    """

    name: str
    mesh: TriangleMesh
    placement: FloatArray
    covariates: Mapping[str, str]
    fit: SurfaceFit
    mean: TriangleMesh
    expected: TriangleMesh
    measures: Measures
    mahalanobis: Percentile
    outside: Percentile
    size: Percentile
    local: Percentile
    z: FloatArray
    thicker: FloatArray
    missing: BoolArray
    total: FloatArray
    total_z: FloatArray
    regions: tuple[Region, ...]
    remarks: tuple[str, ...]
    cautions: tuple[str, ...]
    particles: FloatArray
    own: OwnSurface

    def __repr__(self) -> str:
        """Return a one-line summary."""
        regions = len(self.regions)
        return f"PatientComparison({self.name}: {regions} region{'s' * (regions != 1)} beyond the limit)"

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in ("placement", "z", "thicker", "total", "total_z", "particles"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.float64))
        object.__setattr__(self, "missing", frozen(self.missing, np.bool_))

    @property
    def residual(self) -> FloatArray:
        """Differences from the expected shape along its normals [mm], outward positive, (V,)."""
        return self.fit.residual

    @property
    def matched(self) -> TriangleMesh:
        """The vertices of `expected` on the patient, with its faces and in its frame."""
        expected = self.expected
        vertices = expected.vertices + self.residual[:, None] * expected.vertex_normals
        return TriangleMesh(vertices, expected.faces)

    def place(self, region: Region) -> str:
        """Return the location of a region's centre on the patient, as text: ``"left anterior"`` (LPS)."""
        middle = self.mesh.vertices.mean(axis=0)
        return named_direction(self.position(region) - middle)

    def position(self, region: Region) -> FloatArray:
        """Return a region's centre in the file's frame [mm], (3,)."""
        point = self.matched.vertices[region.centre][None]
        place: FloatArray = transform_points(inverse_matrices(self.placement), point)[0]
        return place

    def nearest_particles(self, region: Region, reference: Reference) -> IntArray:
        """Return the particles nearest to a region's centre, at most four."""
        points = self.fit.expected[reference.model.vertices :]
        gaps = np.linalg.norm(points - self.expected.vertices[region.centre], axis=1)
        return np.argsort(gaps, kind="stable")[:4]


def compare_patient(
    reference: Reference,
    subject: Subject,
    covariates: Mapping[str, str] | None = None,
    *,
    side: str = "",
    cut_off: bool = False,
    force: bool = False,
    tick: Tick = no_tick,
) -> PatientComparison:
    """Groom a patient's file with the settings of the controls, and compare it with the reference.

    Parameters
    ----------
    reference : Reference
    subject : Subject
        The patient, whose file is read.
    covariates : mapping of str to str, optional
        The patient's values of the reference's covariates; others are ignored.
    side : str
        ``"left"`` or ``"right"``: the patient is mirrored if the reference is of the other side. By default,
        the value ``side`` of the covariates.
    cut_off : bool
        Whether the patient is cut off at its flat ends inside the image, as at its border. The missing part
        is not a difference.
    force : bool
        Whether to compare the patient even if it seems to be another structure or side.
    tick : Tick

    Returns
    -------
    PatientComparison

    Raises
    ------
    InputError
        If the file contains no shape or one of another unit, side or structure, or a covariate is missing.
    """
    reference.coding.columns(covariates or {})
    groomed = groomed_patient(reference, subject, part_of(tick, 0.0, 0.5))
    return compare_groomed(
        reference,
        groomed,
        covariates,
        side=side,
        cut_off=cut_off,
        force=force,
        tick=part_of(tick, 0.5, 1.0),
    )


def groomed_patient(reference: Reference, subject: Subject, tick: Tick) -> GroomedSubject:
    """Groom a patient's file with the settings of the controls, in a worker."""
    work = partial(groom_subject, settings=reference.provenance.groom)
    return read_apart(work, subject, subject.path, tick, "grooming")


@on_one_thread
def compare_groomed(
    reference: Reference,
    groomed: GroomedSubject,
    covariates: Mapping[str, str] | None = None,
    *,
    side: str = "",
    cut_off: bool = False,
    force: bool = False,
    tick: Tick = no_tick,
) -> PatientComparison:
    """Compare a groomed patient with the reference; see `compare_patient`.

    Parameters
    ----------
    reference : Reference
        The population.
    groomed : GroomedSubject
        The patient.
    covariates, side, cut_off, force, tick
        As in `compare_patient`.

    Returns
    -------
    PatientComparison
    """
    values = dict(covariates or {})
    columns, remarks = reference.coding.columns(values)
    model = reference.model
    check_unit(groomed.name, groomed.mesh, model, columns)
    turn, side_remarks = _turn(reference, side or values.get(SIDE_COLUMN, ""))
    mesh = groomed.mesh.placed(turn)
    cut, at_border, end_remarks = _fit(
        reference, groomed, mesh, columns, turn, cut_off, part_of(tick, 0.0, 0.3)
    )
    fit = cut.fit
    measures, total = measures_of(model, fit, columns, reference.modes, cut.missing)
    checked = part_of(tick, 0.3, 0.4)
    remarks += [
        *end_remarks,
        *_version_remarks(reference),
        *control_remarks(reference),
        *side_remarks,
        *check_fit(groomed.name, reference, mesh, fit, measures, columns, checked, force=force),
        *check_cut(groomed.name, cut, measures.gap, reference, at_border=at_border, force=force),
    ]
    # Whether the part at the border is missing is known now, and said in the remarks.
    notes = [note for note in groomed.report.notes if note != AT_BORDER]
    maps = _maps(reference, fit, mesh, cut.missing)
    z = _z(reference, maps, cut.missing)
    surface, placement = model.surface(fit.expected), fit.pose @ turn
    on_patient = surface.placed(inverse_matrices(placement))
    particles, unplaced = _particles(reference, groomed, fit, turn, part_of(tick, 0.4, 1.0))
    return PatientComparison(
        name=groomed.name,
        mesh=groomed.mesh,
        placement=placement,
        covariates={name: values[name] for name in reference.coding.names},
        fit=fit,
        mean=model.surface(model.expected(columns)),
        expected=surface,
        measures=measures,
        mahalanobis=percentile(measures.mahalanobis, reference.mahalanobis),
        outside=percentile(measures.outside, reference.outside),
        size=percentile(measures.size, reference.size, both_sides=True),
        local=percentile(float(np.abs(z).max()), reference.maxima),
        z=z,
        thicker=_thicker(reference, maps),
        missing=cut.missing,
        total=total,
        total_z=reference.total.standardised(total),
        regions=_regions(reference, fit, maps, z),
        remarks=(*notes, *remarks, *unplaced),
        cautions=(*remarks, *unplaced),
        particles=particles,
        own=own_surface(groomed.mesh, on_patient, fit.residual, fit.met, cut.missing),
    )


def _fit(
    reference: Reference,
    groomed: GroomedSubject,
    mesh: TriangleMesh,
    columns: FloatArray,
    turn: FloatArray,
    cut_off: bool,
    tick: Tick,
) -> tuple[CutFit, bool, list[str]]:
    """Fit the reference to a reflected patient without its cut ends.

    Also return whether it touches a border of its image that controls do not touch, and remarks on flat ends.
    """
    coarse, remarks = simplified(mesh, COARSE_VERTICES), list[str]()
    fit = fit_surface(reference.model, mesh, coarse, columns, tick)
    ends = ends_of(reference, groomed, mesh, turn, fit.pose)
    expected = reference.model.surface(fit.expected)
    areas, z = expected.vertex_areas, distance_z(reference, fit)
    apart = regions(expected, areas, fit.residual, z, fit.met, reference.limit)
    flat = flat_ends(groomed, mesh, fit, expected, apart, ends)
    if flat and not cut_off:
        rest = fit_rest(reference, mesh, coarse, columns, flat, fit)
        remarks = flat_remarks(rest, [named_direction(turn[:3, :3].T @ end.direction) for end in flat])
    if cut_off and not flat:
        remarks = ["has no flat end beyond which the reference expects more; it was compared as a whole"]
    cut = fit_rest(reference, mesh, coarse, columns, [*ends, *(flat if cut_off else [])], fit)
    return cut, bool(ends), remarks


def _maps(reference: Reference, fit: SurfaceFit, mesh: TriangleMesh, missing: BoolArray) -> FloatArray:
    """Return the patient's maps (2, V), with the usual values where a part is missing."""
    return np.where(missing, reference.usual.mean, local_maps(reference.model, fit, mesh))


def _z(reference: Reference, maps: FloatArray, missing: BoolArray) -> FloatArray:
    """Return the differences of maps (2, V) from the expected ones in standard deviations (V,)."""
    seen, bands = ~missing, bands_of(maps, reference.model.faces)
    return np.where(seen, scores_of(reference.local, maps, reference.usual.mean, bands, seen), 0.0)


def _thicker(reference: Reference, maps: FloatArray) -> FloatArray:
    """Return the difference of the thickness, relative to the expected one (V,)."""
    relative: FloatArray = np.expm1(maps[1] - reference.usual.mean[1])
    return relative


def _regions(reference: Reference, fit: SurfaceFit, maps: FloatArray, z: FloatArray) -> tuple[Region, ...]:
    """Return the regions beyond the limit."""
    surface, thicker = reference.model.surface(fit.expected), _thicker(reference, maps)
    return regions(surface, surface.vertex_areas, fit.residual, z, fit.met, reference.limit, thicker)


def named_direction(way: FloatArray) -> str:
    """Return the anatomical directions of a vector (3,): ``"left anterior"`` (LPS)."""
    way = way / max(float(np.linalg.norm(way)), 1e-9)
    named = [
        senses[int(part > 0.0)]
        for senses, part in zip(_DIRECTIONS, way.tolist(), strict=True)
        if abs(part) > _CLEAR
    ]
    return " ".join(named)


def _particles(
    reference: Reference, groomed: GroomedSubject, fit: SurfaceFit, turn: FloatArray, tick: Tick
) -> tuple[FloatArray, list[str]]:
    """Return the particles in the file's frame (N, 3), and a remark if the objective does not place them."""
    back, placing = inverse_matrices(turn), reference.placing
    if placing is None:
        return transform_points(back, fit.particles), []
    shape = Shape(groomed.name, groomed.field, groomed.mesh, groomed.coarse_mesh, np.eye(4))
    try:
        return transform_points(back, placing.placed(shape, fit, turn, tick)), []
    except NumericalError:
        remark = (
            "particles are those of the fitted surface; the run's objective does not keep them on this shape"
        )
        return transform_points(back, fit.particles), [remark]


def _version_remarks(reference: Reference) -> list[str]:
    if reference.made_by in ("", __version__):
        return []
    return [
        f"the reference was made by Homolog {reference.made_by}, whose fits of controls define its "
        f"percentiles and limits; this is {__version__}: make it again (homolog reference) if possible"
    ]


def _turn(reference: Reference, side: str) -> tuple[FloatArray, list[str]]:
    """Return the reflection, if any, to the reference's side, and a remark."""
    own, given = reference.provenance.side, side.strip()
    side = side_of_word(given)
    if given and not side:
        raise InputError(f"side {given}: must be left or right")
    if not own:
        unused = f"its side ({side}) was not used: the sides of the controls are not known"
        return np.eye(4), [unused] if side else []
    if not side:
        return np.eye(4), [f"its side is not given; it was compared with {own} controls without mirroring"]
    if side == own:
        return np.eye(4), []
    return MIRROR, [f"a {side} one, mirrored to {own} like the controls"]
