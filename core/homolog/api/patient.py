"""One patient against the controls of a project."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from typing import Any

from homolog.api.inputs import cohort_of
from homolog.api.project import Project
from homolog.errors import InputError, path_of
from homolog.grooming import GroomedSubject
from homolog.grooming.subject import check_source, groom
from homolog.io.project import ProjectFolder
from homolog.patient import (
    JointReference,
    PatientComparison,
    Reference,
    compare_groomed,
    compare_joint_patient,
    read_reference,
)
from homolog.patient import make_reference as _make
from homolog.patient.compare import groomed_patient
from homolog.patient.files import patient_at
from homolog.progress import part_of, run_in_background, tick_of

__all__ = ["compare_patient", "make_reference"]


def make_reference(
    project: Project | str | PathLike[str],
    *,
    group: str | None = None,
    adjust: Sequence[str] = (),
    pairs: str | None = None,
    time: str = "time",
    workers: int | None = None,
    callback: Callable[[float, str], object] | None = None,
) -> Reference | Any:  # noqa: ANN401 - or JointReference, known by the project only
    """Freeze the shape model of a project's controls, as ``homolog reference`` does.

    Of several structures, each has its reference, and so has how they lie to each other. Each control is
    fitted as a patient to the model of the others, so that limits and percentiles hold for new subjects.

    Parameters
    ----------
    project : Project or path
        A project with a result, or its folder.
    group : str, optional
        Group of the controls, in the column ``group``; all subjects by default.
    adjust : sequence of str
        Columns of the cohort's table to adjust for, such as age.
    pairs : str, optional
        Column that identifies a person, if controls were scanned repeatedly. The first scan is a control, and
        the change to the next one gives the expected change in `homolog.patient.compare_times`.
    time : str
        Column that orders a person's times.
    workers : int, optional
        Number of processes; one per core by default.
    callback : callable, optional
        Called with the fraction done and a message; any exception that it raises ends the work.

    Returns
    -------
    Reference or JointReference

    Raises
    ------
    InputError
        If the project has no result, there are fewer than eight controls (or controls with two times), or
        a value is missing.

    References
    ----------
    docs/patient.md describes the method and names its sources; docs/examples/one_patient.py is an example.
    """
    folder = project.folder if isinstance(project, Project) else project
    if not isinstance(folder, str | PathLike):
        raise InputError(
            f"make_reference needs a project, not {type(project).__name__}; save the correspondence first"
        )
    if not isinstance(group, str | None):
        raise InputError(f"group={group!r}: give the name of the controls' group")
    return _make(
        ProjectFolder(path_of(folder, "project")),
        group=group,
        adjust=adjust,
        pairs=pairs,
        time=time,
        workers=workers,
        tick=tick_of(callback),
    )


def compare_patient(
    reference: Reference | JointReference | str | PathLike[str],
    shape: object,
    covariates: Mapping[str, object] | None = None,
    *,
    side: str = "",
    voxel_size: float | Sequence[float] | None = None,
    force: bool = False,
    callback: Callable[[float, str], object] | None = None,
) -> PatientComparison | Any:  # noqa: ANN401 - or JointComparison
    """Compare one shape with a reference: how unusual it is, and where.

    For research use only; not for diagnosis.

    Parameters
    ----------
    reference : Reference, JointReference or path
        Result of `make_reference`, or its file.
    shape : path, mesh, image or array, or dict of these by structure
        A shape as in `correspond`; it is groomed with the settings of the controls. Of several structures, a
        label map, a folder with a file for each, or a dict of shapes.
    covariates : mapping of str to value, optional
        The patient's values of the covariates of the reference.
    side : str
        ``"left"`` or ``"right"``: the shape is mirrored if the controls are of the other side.
    voxel_size : float or three floats, optional
        Voxel size of a label array [mm].
    force : bool
        Whether to compare the shape even if it seems to be another structure or side.
    callback : callable, optional
        Called with the fraction done and a message; any exception that it raises ends the work.

    Returns
    -------
    PatientComparison or JointComparison

    Raises
    ------
    InputError
        If the shape is empty, has another unit, side or structure, or is cut off, if a covariate is missing,
        or if the reference's file can't be read.

    References
    ----------
    docs/patient.md describes the method and names its sources; docs/examples/one_patient.py is an example.
    """
    known = reference if isinstance(reference, Reference | JointReference) else read_reference(reference)
    values = {name: str(value) for name, value in (covariates or {}).items()}
    known.first.coding.columns(values)  # refuses invalid values before the computation
    tick = tick_of(callback)
    compared = part_of(tick, 0.3, 1.0)

    def groomed(given: object, own: Reference) -> GroomedSubject:
        settings, begun = own.provenance.groom, part_of(tick, 0.0, 0.3)
        cohort, sources = cohort_of([given], voxel_size, settings)
        (subject,) = cohort.subjects
        source = sources.get(subject.name)
        if source is None:
            return groomed_patient(own, subject, begun)
        check_source(source, settings, subject.name)
        return run_in_background(lambda _: groom(subject.name, source, settings), begun, "grooming")

    if isinstance(known, Reference):
        alone = groomed(shape, known)
        return compare_groomed(known, alone, values, side=side, force=force, tick=compared)
    if isinstance(shape, str | PathLike):
        patient = patient_at(path_of(shape), known.files)
        return compare_joint_patient(known, patient, values, side=side, force=force, tick=compared)
    given = shape if isinstance(shape, Mapping) else dict.fromkeys(known.structures, shape)
    if unknown := [str(name) for name in given if name not in known.structures]:
        raise InputError(f"{', '.join(unknown)}: is none of {', '.join(known.structures)}")
    parts = {
        name: groomed(given[name], own)
        for name, own in known.structures.items()
        if given.get(name) is not None
    }
    return compare_joint_patient(known, parts, values, side=side, force=force, tick=compared)
