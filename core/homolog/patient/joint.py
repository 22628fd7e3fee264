"""One patient with several structures: each against its own reference, and how they lie to each other."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from os import PathLike
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from homolog.arrays import FloatArray, frozen
from homolog.cohort import Subject
from homolog.errors import InputError, NumericalError, path_of
from homolog.geometry import inverse_matrices, transform_points
from homolog.grooming import GroomedSubject
from homolog.io.arrays import write_arrays
from homolog.io.project import ProjectFolder
from homolog.io.results import Result
from homolog.patient.build import Fitted, fit_reference, make_single_reference
from homolog.patient.compare import PatientComparison, compare_groomed, compare_patient
from homolog.patient.distribution import Percentile, percentile
from homolog.patient.local import LEVEL, prediction_limit
from homolog.patient.reference import FORMAT_VERSION, SEVERAL, Reference, arrays_of, check_name
from homolog.progress import Tick, no_tick, part_of

__all__ = [
    "JointComparison",
    "JointReference",
    "PatientPose",
    "PoseNorm",
    "compare_joint_patient",
    "make_reference",
    "read_reference",
]

_PARTS = ("mean", "centre", "effects", "covariances", "turns", "shifts")


@dataclass(frozen=True, slots=True, eq=False)
class PoseNorm:
    """How a structure lies to another one in M controls that were fitted as patients; arrays are read-only.

    Attributes
    ----------
    structure, against : str
    mean : (3, 3) array
        Mean rotation from the frame of the structure's reference to that of the other one.
    centre : (3,) array
        Centre of the structure's mean surface in its frame [mm].
    effects : (1 + c, 2, 3) array
        Mean rotation vector [degrees] from `mean` and place of the centre [mm], and their changes with the
        covariates' columns.
    covariances : (2, 3, 3) array
        Of a new subject's rotation vector and place.
    turns, shifts : (M,) arrays
        Sorted distances of the controls from what the others let expect [SD].
    """

    structure: str
    against: str
    mean: FloatArray
    centre: FloatArray
    effects: FloatArray
    covariances: FloatArray
    turns: FloatArray
    shifts: FloatArray

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in _PARTS:
            object.__setattr__(self, name, frozen(getattr(self, name), np.float64))

    @classmethod
    def of(
        cls, structure: str, against: str, relative: FloatArray, columns: FloatArray, centre: FloatArray
    ) -> "PoseNorm":
        """Return the norm of relative poses (M, 4, 4) of controls with covariates (M, c)."""
        mean = Rotation.from_matrix(relative[:, :3, :3]).mean().as_matrix()
        numbers = _numbers(relative, mean, centre)
        design = np.column_stack([np.ones(len(columns)), columns])
        effects, covariances = _expected(numbers, design)
        distances = np.empty((len(numbers), 2))
        for index in range(len(numbers)):
            others = np.arange(len(numbers)) != index
            usual, spread = _expected(numbers[others], design[others])
            distances[index] = _distances(numbers[index] - np.tensordot(design[index], usual, 1), spread)
        return cls(structure, against, mean, centre, effects, covariances, *np.sort(distances, axis=0).T)

    def expected(self, columns: FloatArray) -> FloatArray:
        """Return the expected pose (4, 4) at covariates (c,), from the structure's frame to the other one."""
        turn, place = np.tensordot(np.append(1.0, columns), self.effects, 1)
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_rotvec(turn, degrees=True).as_matrix() @ self.mean
        pose[:3, 3] = place - pose[:3, :3] @ self.centre
        return pose

    def _apart(self, pose: FloatArray, columns: FloatArray) -> FloatArray:
        usual = np.tensordot(np.append(1.0, columns), self.effects, 1)
        return np.asarray(_numbers(pose[None], self.mean, self.centre)[0] - usual)

    def distances(self, pose: FloatArray, columns: FloatArray) -> FloatArray:
        """Return how far a pose (4, 4) is turned and shifted from the expected one [SD], (2,)."""
        return _distances(self._apart(pose, columns), self.covariances)

    def compared(self, pose: FloatArray, against: PatientComparison, columns: FloatArray) -> "PatientPose":
        """Compare a patient's pose.

        Parameters
        ----------
        pose : (4, 4) array
            From the frame of the structure's reference to that of the other one.
        against : PatientComparison
            Of the other structure.
        columns : (c,) array
            The patient's covariates.
        """
        apart = self._apart(pose, columns)
        turn, shift = self.distances(pose, columns).tolist()
        back = np.linalg.inv(against.placement[:3, :3])
        return PatientPose(
            self.structure,
            self.against,
            np.sign(np.linalg.det(back)) * back @ apart[0],
            back @ apart[1],
            percentile(turn, self.turns),
            percentile(shift, self.shifts),
        )


@dataclass(frozen=True, slots=True, eq=False)
class PatientPose:
    """How a patient's structure lies to another one, beyond what the reference expects.

    Attributes
    ----------
    structure, against : str
    rotation : (3,) array
        Rotation vector [degrees], along the axes of the file (LPS).
    translation : (3,) array
        Displacement of the structure's centre [mm], along the same axes.
    turn, shift : Percentile
        Their distances [SD] among controls that were fitted as patients.
    """

    structure: str
    against: str
    rotation: FloatArray
    translation: FloatArray
    turn: Percentile
    shift: Percentile

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in ("rotation", "translation"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.float64))

    @property
    def angle(self) -> float:
        """Angle of the rotation [degrees]."""
        return float(np.linalg.norm(self.rotation))

    @property
    def distance(self) -> float:
        """Length of the translation [mm]."""
        return float(np.linalg.norm(self.translation))


@dataclass(frozen=True, slots=True, eq=False)
class JointReference:
    """References of several structures, and how these lie to each other in controls.

    Attributes
    ----------
    structures : mapping of str to Reference
        By name. The limits of |z| are such that 5 % of healthy people exceed one anywhere on all structures.
    poses : tuple of PoseNorm
        Of each structure but the one to which the others are compared.
    """

    structures: Mapping[str, Reference]
    poses: tuple[PoseNorm, ...]

    def __repr__(self) -> str:
        """Return a one-line summary."""
        return f"JointReference({', '.join(f'{name}: {own}' for name, own in self.structures.items())})"

    @property
    def first(self) -> Reference:
        """The reference of the first structure, which has the covariates and the side of all."""
        return next(iter(self.structures.values()))

    @property
    def files(self) -> tuple[str, ...]:
        """Names of the structures in patients' files."""
        sources = (own.provenance.groom.segment or name for name, own in self.structures.items())
        return tuple(name for source in sources for name in source.split("+"))

    def anonymous(self) -> "JointReference":
        """Return the reference without the controls' scores and names."""
        return replace(self, structures={name: own.anonymous() for name, own in self.structures.items()})

    def save(self, path: str | PathLike[str]) -> None:
        """Write the reference to a file (``.npz``); raises InputError if it can't be written."""
        check_name(path)
        record = {
            "format": SEVERAL,
            "version": FORMAT_VERSION,
            "structures": list(self.structures),
            "poses": [[norm.structure, norm.against] for norm in self.poses],
        }
        arrays: dict[str, Any] = {"record": np.array(json.dumps(record))}
        for number, own in enumerate(self.structures.values()):
            arrays |= {f"{number}_{name}": array for name, array in own.stored.items()}
        for number, norm in enumerate(self.poses):
            arrays |= {f"pose{number}_{name}": getattr(norm, name) for name in _PARTS}
        write_arrays(path_of(path), arrays)


def read_reference(path: str | PathLike[str]) -> Reference | JointReference:
    """Read a reference of one or several structures.

    Raises
    ------
    InputError
        If the file is missing, damaged, not a reference, or of another version.
    """
    stored = arrays_of(path)
    try:
        record = json.loads(str(stored["record"]))
        several = record["format"] == SEVERAL and record["version"] == FORMAT_VERSION
    except (KeyError, TypeError, ValueError):
        several = False
    if not several:
        return Reference.of_stored(stored, path)
    try:
        structures = {
            str(name): Reference.of_stored(_named(stored, f"{number}_"), path)
            for number, name in enumerate(record["structures"])
        }
        poses = tuple(
            PoseNorm(str(own), str(other), **_named(stored, f"pose{number}_"))
            for number, (own, other) in enumerate(record["poses"])
        )
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path}: is damaged: {error}; make the reference again") from error
    return JointReference(structures, poses)


def _named(stored: Mapping[str, Any], prefix: str) -> dict[str, Any]:
    return {name.removeprefix(prefix): array for name, array in stored.items() if name.startswith(prefix)}


def make_reference(
    project: ProjectFolder,
    *,
    result: Result | None = None,
    parts: Mapping[str, Result] | None = None,
    workers: int | None = None,
    tick: Tick = no_tick,
    **choices: Any,  # noqa: ANN401 - those of make_single_reference
) -> Reference | JointReference:
    """Freeze a model of a project's controls, of each structure if there are several.

    Parameters
    ----------
    project : ProjectFolder
        A project with a result.
    result : Result, optional
        The project's result with groups and columns of a newer table; by default, the one in its folder.
    parts : mapping of str to Result, optional
        The same by structure, if there are several.
    workers : int, optional
        Number of processes; one per core by default.
    tick : Tick
    **choices
        As `group`, `column`, `adjust`, `pairs`, `time`, `scores` and `names` of `make_single_reference`.

    Returns
    -------
    Reference or JointReference

    Raises
    ------
    InputError
        As `make_single_reference`.
    """
    record, parts = project.read().result, parts or {}
    if record is None or not record.structures:
        return make_single_reference(project, result=result, workers=workers, tick=tick, **choices)
    names = [item.name for item in record.structures]
    fitted: dict[str, Fitted] = {}
    for number, name in enumerate(names):
        fitted[name] = fit_reference(
            project.structure(name),
            result=parts.get(name),
            workers=workers,
            tick=part_of(tick, number / len(names), (number + 1) / len(names)),
            **choices,
        )
    lead = record.settings.optimize.align_by or names[0]
    poses = tuple(_norm(name, lead, fitted[name], fitted[lead]) for name in names if name != lead)
    called = project.folder.resolve().name
    return JointReference(
        {name: _among(own.reference, len(names), called) for name, own in fitted.items()}, poses
    )


def _among(reference: Reference, count: int, project: str) -> Reference:
    """Return a reference of a project whose limit holds for all of several structures (Bonferroni)."""
    limit = prediction_limit(reference.maxima, LEVEL / count)
    quality = replace(reference.quality, limit_mm=reference.quality.limit_mm * limit / reference.limit)
    about = replace(reference.provenance, project=project)
    return replace(reference, limit=limit, quality=quality, provenance=about)


def _norm(structure: str, against: str, own: Fitted, other: Fitted) -> PoseNorm:
    both = [name for name in own.names if name in other.names]
    rows = [[item.names.index(name) for name in both] for item in (own, other)]
    relative = other.poses[rows[1]] @ inverse_matrices(own.poses[rows[0]])
    centre = own.reference.surface.vertices.mean(axis=0)
    return PoseNorm.of(structure, against, relative, own.columns[rows[0]], centre)


def _numbers(relative: FloatArray, mean: FloatArray, centre: FloatArray) -> FloatArray:
    """Return rotation vectors from a mean [degrees] and places of a centre [mm], (M, 2, 3)."""
    turns = Rotation.from_matrix(relative[:, :3, :3] @ mean.T).as_rotvec(degrees=True)
    places = np.stack([transform_points(pose, centre[None])[0] for pose in relative])
    return np.stack([turns, places], axis=1)


def _expected(numbers: FloatArray, design: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the effects (c, 2, 3) on numbers (M, 2, 3), and covariances (2, 3, 3) of a new subject's."""
    count, columns = design.shape
    effects = np.tensordot(np.linalg.pinv(design), numbers, 1)
    rest = numbers - np.tensordot(design, effects, 1)
    freedom = max(count - columns, 1)
    return effects, np.einsum("mki,mkj->kij", rest, rest) / freedom * (1.0 + 1.0 / count)


def _distances(apart: FloatArray, covariances: FloatArray) -> FloatArray:
    """Return the lengths of differences (2, 3) in standard deviations (2,), where there is any variance."""
    inverse = np.linalg.pinv(covariances, hermitian=True)
    return np.asarray(np.sqrt(np.einsum("ki,kij,kj->k", apart, inverse, apart)))


@dataclass(frozen=True, slots=True, eq=False)
class JointComparison:
    """A patient with several structures, compared with a reference.

    Attributes
    ----------
    name : str
    structures : mapping of str to PatientComparison
        By name; those that could be compared.
    poses : tuple of PatientPose
        Of those of them that have a pose.
    problems : mapping of str to str
        Why other structures could not be compared.
    """

    name: str
    structures: Mapping[str, PatientComparison]
    poses: tuple[PatientPose, ...]
    problems: Mapping[str, str]

    def __repr__(self) -> str:
        """Return a one-line summary."""
        return f"JointComparison({self.name}: {', '.join(self.structures)})"


def compare_joint_patient(
    reference: JointReference,
    patient: Subject | Mapping[str, GroomedSubject],
    covariates: Mapping[str, str] | None = None,
    *,
    side: str = "",
    cut_off: bool = False,
    force: bool = False,
    tick: Tick = no_tick,
) -> JointComparison:
    """Compare a patient's structures with those of controls, and how they lie to each other.

    Parameters
    ----------
    reference : JointReference
    patient : Subject or mapping of str to GroomedSubject
        The patient, whose files have the structures, or the groomed structures by name.
    covariates, side, cut_off, force, tick
        As in `compare_patient`.

    Returns
    -------
    JointComparison

    Raises
    ------
    InputError
        If no structure can be compared, or a covariate is missing.
    """
    columns, _ = reference.first.coding.columns(covariates or {})
    done: dict[str, PatientComparison] = {}
    problems: dict[str, str] = {}
    count = len(reference.structures)
    for number, (name, own) in enumerate(reference.structures.items()):
        there = part_of(tick, number / count, (number + 1) / count)
        given: dict[str, Any] = {"side": side, "cut_off": cut_off, "force": force, "tick": there}
        try:
            if isinstance(patient, Subject):
                done[name] = compare_patient(own, patient, covariates, **given)
            elif name in patient:
                done[name] = compare_groomed(own, patient[name], covariates, **given)
            else:
                problems[name] = "the patient lacks it"
        except (InputError, NumericalError) as error:
            problems[name] = str(error)
    if not done:
        raise InputError("\n".join(f"{name}: {text}" for name, text in problems.items()))
    poses = tuple(
        norm.compared(
            done[norm.against].fit.pose @ inverse_matrices(done[norm.structure].fit.pose),
            done[norm.against],
            columns,
        )
        for norm in reference.poses
        if norm.structure in done and norm.against in done
    )
    return JointComparison(next(iter(done.values())).name, done, poses, problems)
