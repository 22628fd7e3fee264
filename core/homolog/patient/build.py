"""Building a reference from a finished project."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Any

import numpy as np

from homolog.arrays import FloatArray
from homolog.errors import InputError
from homolog.io.project import ProjectFolder
from homolog.io.records import IMPORTED, ResultRecord
from homolog.io.results import Result, read_result
from homolog.patient.change import ExpectedChange
from homolog.patient.coding import Coding
from homolog.patient.controls import Controls, read_controls
from homolog.patient.left_out import LeftOut, fit_left_out
from homolog.patient.local import BEST_GAINS, LEVEL, LocalNorm, bands_of, norm_and_maxima, prediction_limit
from homolog.patient.placed import Placing
from homolog.patient.provenance import Provenance, Quality
from homolog.patient.reference import Reference
from homolog.patient.surface_model import SurfaceModel
from homolog.patient.times import seen_twice
from homolog.progress import Tick, no_tick, part_of
from homolog.run.fingerprints import versions
from homolog.statistics.parallel import parallel_analysis

__all__ = [
    "FEWEST",
    "Fitted",
    "fit_reference",
    "make_single_reference",
    "reference_of",
    "scores_of_points",
]

FEWEST = 8
"""Controls."""
_FITTED_SHARE = 0.98
"""Share of the particles' variance that the fitted modes explain."""
_NEAR = 0.3  # particle spacings
_COLUMN = "group"


@dataclass(frozen=True, slots=True, eq=False)
class Fitted:
    """A reference, with what of its controls is used for several structures.

    Attributes
    ----------
    reference : Reference
    names : tuple of str
        Of M controls.
    columns : (M, c) array
        Their covariates.
    poses : (M, 4, 4) array
        From their own frames to that of the reference, fitted as patients.
    """

    reference: Reference
    names: tuple[str, ...]
    columns: FloatArray
    poses: FloatArray


def make_single_reference(project: ProjectFolder, **choices: Any) -> Reference:  # noqa: ANN401
    """Freeze a model of a project's controls; as `fit_reference`, of the reference alone."""
    return fit_reference(project, **choices).reference


def fit_reference(
    project: ProjectFolder,
    *,
    group: str | None = None,
    column: str = _COLUMN,
    adjust: Sequence[str] = (),
    pairs: str | None = None,
    time: str = "time",
    scores: bool = False,
    names: bool = False,
    result: Result | None = None,
    workers: int | None = None,
    tick: Tick = no_tick,
) -> Fitted:
    """Freeze a model of a project's controls, and fit each control as a patient.

    Parameters
    ----------
    project : ProjectFolder
        A project with a result.
    group : str, optional
        Group of the controls; all subjects by default.
    column : str
        Column of the cohort's table that contains the groups.
    adjust : sequence of str
        Covariates to adjust for: columns of the table.
    pairs, time : str
        Columns that identify a person and order the times, if controls were scanned repeatedly. The first
        scan of each person is a control; the change to the next one gives the change expected of a patient.
    scores, names : bool
        Whether to store each control's scores, and its name, so that the nearest controls can be listed.
        These are data of individual subjects.
    result : Result, optional
        The project's result with groups and columns of a newer table; by default, the one in its folder.
    workers : int, optional
        Number of processes; one per core by default.
    tick : Tick

    Returns
    -------
    Fitted

    Raises
    ------
    InputError
        If the project has no result, too few controls or repeated controls, or a missing value.
    """
    result = read_result(project) if result is None else result
    record = project.read().result
    if record is None:
        raise InputError(f"{project.folder}: has no result; run it first")
    if record.ended == IMPORTED:
        raise InputError(
            f"{project.folder}: its model was imported, and the grooming of its surfaces is "
            "unknown; run it here"
        )
    chosen = _chosen(result, group, column, project)
    twice = None if pairs is None else seen_twice(result, chosen, pairs, time, project)
    later: Mapping[int, int] = {}
    if twice is not None:
        chosen, later = twice.first, twice.later
    table = {name: [_cell(result, index, name, project) for index in chosen] for name in adjust}
    coding, columns = Coding.of(table, [result.names[index] for index in chosen])
    if len(chosen) - columns.shape[1] < FEWEST:
        raise InputError(
            f"{project.folder}: {len(chosen)} controls are too few for a reference; at least "
            f"{FEWEST} and one per covariate are needed, and 20 or more give useful limits"
        )
    controls = read_controls(project, result, chosen, part_of(tick, 0.0, 0.15), later=later)
    about = _provenance(project, record, result, chosen, group)
    reference, left_out = _fit_controls(
        controls,
        coding,
        columns,
        about,
        "" if twice is None else twice.between,
        workers,
        part_of(tick, 0.15, 1.0),
    )
    if scores or names:
        own = scores_of_points(reference.model, controls.points, columns)[:, : reference.modes]
        reference = replace(reference, scores=own, names=controls.names if names else ())
    return Fitted(reference, controls.names, columns, left_out.poses)


def reference_of(
    controls: Controls,
    coding: Coding,
    columns: FloatArray,
    provenance: Provenance,
    *,
    between: str = "",
    workers: int | None = None,
    tick: Tick = no_tick,
) -> Reference:
    """Make a reference from loaded controls.

    Parameters
    ----------
    controls : Controls
    coding : Coding
        Coding of the covariates.
    columns : (M, c) array
        Columns of the covariates in this coding.
    provenance : Provenance
    between : str
        Interval between the times of controls with two times, as text.
    workers : int, optional
        Number of processes; one per core by default.
    tick : Tick

    Returns
    -------
    Reference
    """
    return _fit_controls(controls, coding, columns, provenance, between, workers, tick)[0]


def _fit_controls(
    controls: Controls,
    coding: Coding,
    columns: FloatArray,
    provenance: Provenance,
    between: str,
    workers: int | None,
    tick: Tick,
) -> tuple[Reference, LeftOut]:
    """Make a reference from loaded controls, and return their fits too."""
    modes, fitted = _modes(controls, columns, part_of(tick, 0.0, 0.1))
    left_out = fit_left_out(controls, columns, modes, fitted, workers=workers, tick=part_of(tick, 0.1, 0.95))
    tick(0.95, "limits")
    model = SurfaceModel.fit(controls.points, columns, fitted, controls.surface.faces)
    jointly = controls.jointly
    placing = None if jointly is None else Placing(jointly.ensemble, jointly.settings)
    made = _reference(model, modes, coding, left_out, provenance, placing)
    farthest = np.argsort([-item.outside for item in left_out.measures], kind="stable")
    unlike = farthest[: len(made.unlike_distances)].tolist()
    made = replace(made, unlike=tuple(controls.names[index] for index in unlike))
    if controls.later:
        change = ExpectedChange.of(left_out.changes, left_out.volumes, controls.surface, between)
        made = replace(made, change=change)
    return made, left_out


def scores_of_points(model: SurfaceModel, points: FloatArray, columns: FloatArray) -> FloatArray:
    """Return the scores (M, K) [mm] of aligned points (M, P, 3) at covariates (M, c)."""
    rest = points - np.stack([model.expected(item) for item in columns])
    particles = slice(model.vertices, None)
    scores: FloatArray = np.einsum("mpi,kpi->mk", rest[:, particles], model.components[:, particles])
    return scores


def _chosen(result: Result, group: str | None, column: str, project: ProjectFolder) -> list[int]:
    if group is None:
        return list(range(len(result.names)))
    values = [_value(result, index, column) for index in range(len(result.names))]
    chosen = [index for index, value in enumerate(values) if value.strip().casefold() == group.casefold()]
    if not chosen:
        known = ", ".join(sorted(set(filter(None, values)))) or "no values"
        raise InputError(f"{project.folder}: no subject has {group} in column {column}; it contains {known}")
    return chosen


def _value(result: Result, index: int, column: str) -> str:
    if column == _COLUMN:
        return result.groups[index] or ""
    return result.columns[index].get(column, "")


def _cell(result: Result, index: int, name: str, project: ProjectFolder) -> str:
    known = sorted({key for columns in result.columns for key in columns})
    if name not in known:
        raise InputError(
            f"{project.folder}: has no column {name}; it has {', '.join(known) or 'none'} "
            "(homolog table adds columns)"
        )
    return result.columns[index].get(name, "")


def _modes(controls: Controls, columns: FloatArray, tick: Tick) -> tuple[int, int]:
    """Return the numbers of retained and of fitted modes."""
    count = len(controls.points)
    aligned = controls.points[:, len(controls.surface.vertices) :]
    nuisance = np.linalg.qr(np.column_stack([np.ones(count), columns]))[0]
    analysis = parallel_analysis(aligned, nuisance=nuisance, tick=tick)
    shares = np.cumsum(analysis.eigenvalues) / analysis.eigenvalues.sum()
    enough = int(np.searchsorted(shares, _FITTED_SHARE)) + 1
    most = max((count - nuisance.shape[1]) // 2, 1)
    kept = max(1, min(analysis.n_retained, most))
    return kept, max(kept, min(enough, most))


def _reference(
    model: SurfaceModel,
    modes: int,
    coding: Coding,
    left_out: LeftOut,
    provenance: Provenance,
    placing: Placing | None,
) -> Reference:
    local, maxima = norm_and_maxima(left_out.maps, bands_of(left_out.maps, model.faces))
    limit = prediction_limit(maxima, LEVEL)
    values: dict[str, Any] = {
        name: np.array([getattr(item, name) for item in left_out.measures])
        for name in ("mahalanobis", "outside", "size", "gap")
    }
    quality = Quality(
        near=float((left_out.errors < _NEAR).mean()),
        error_95=float(np.quantile(left_out.errors, 0.95)),
        outside=float(values["outside"].mean()),
        limit_mm=float(limit * (local.deviation[0] / BEST_GAINS[:, None]).min(axis=0).mean()),
    )
    total = LocalNorm.of(left_out.totals)
    return Reference(
        model=model,
        modes=modes,
        coding=coding,
        **values,
        maxima=maxima,
        limit=limit,
        local=local,
        usual=LocalNorm.of(left_out.maps),
        total=total,
        quality=quality,
        provenance=provenance,
        placing=placing,
        mirrored=left_out.mirrored,
        borders=left_out.borders,
    )


def _provenance(
    project: ProjectFolder, record: ResultRecord, result: Result, chosen: Sequence[int], group: str | None
) -> Provenance:
    subjects: list[Any] = [record.subjects[index] for index in chosen]
    groups = Counter(sorted(result.groups[index] or "of no group" for index in chosen))
    opposite = {"left": "right", "right": "left", "": ""}
    sides = {opposite[item.side] if item.is_mirrored else item.side for item in subjects}
    return Provenance(
        project=project.folder.resolve().name,
        group=group or "",
        controls=len(chosen),
        made=datetime.now(UTC).isoformat(timespec="seconds"),
        finished=record.finished,
        versions=versions(),
        result=record.fingerprint,
        particles=record.particles,
        groom=record.settings.groom,
        side=sides.pop() if len(sides) == 1 else "",
        mixture=", ".join(f"{number} {name}" for name, number in groups.items()) if len(groups) > 1 else "",
    )
