"""A finished result as the start of another run: more particles, or new subjects fitted to it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from homolog.arrays import FloatArray
from homolog.cohort import Cohort, Subject
from homolog.correspondence import InitialParticles, Shape, initialize_fit
from homolog.errors import InputError
from homolog.geometry import fit_similarity, transform_points
from homolog.io.project import ProjectFolder
from homolog.io.records import ResultRecord
from homolog.io.results import read_result
from homolog.progress import Tick
from homolog.run.fingerprints import surface_hash
from homolog.run.result import CANCELLED, OptimizationInput
from homolog.settings import RunSettings

__all__ = ["PriorResult", "adds_particles", "new_subjects", "read_prior_result"]


@dataclass(frozen=True, slots=True, eq=False)
class PriorResult:
    """The particles of a result, by subject.

    Attributes
    ----------
    record : ResultRecord
    local : mapping of str to (N, 3) float64 array
        Particles in file coordinates [mm].
    alignments : mapping of str to (4, 4) float64 array
        Similarities from local to world coordinates in the result.
    parts : mapping of str to PriorResult
        The structures of subjects with several, by name.
    """

    record: ResultRecord
    local: dict[str, FloatArray]
    alignments: dict[str, FloatArray]
    parts: Mapping[str, "PriorResult"] = field(default_factory=dict)

    @property
    def names(self) -> set[str]:
        """The subjects of the result, or of one of its structures."""
        return set(self.local).union(*(part.local for part in self.parts.values()))

    def check(self, names: Sequence[str], settings: RunSettings) -> None:
        """Raise InputError if a run of these subjects and settings can't start from the result."""
        missing = sorted(self.names - set(names))
        if missing:
            raise InputError(f"{', '.join(missing)}: is in the result but not in the cohort; start a new run")
        if settings.groom != self.record.settings.groom:
            raise InputError("the result's surfaces were groomed with other settings; start a new run")
        fresh, more = set(names) > self.names, _more(self.record, settings)
        if fresh and any(more):
            raise InputError(
                f"new subjects get the result's {self.record.particles} particles; fit them first, then "
                "request more particles"
            )
        if min(more) < 0 or not (fresh or any(more)):
            raise InputError(
                f"the result already has {self.record.particles} particles for every subject; request more, "
                "name new files to fit, or start a new run"
            )

    def shapes(self, shapes: Sequence[Shape]) -> list[Shape]:
        """Return the shapes in the result's world coordinates: known ones unchanged, new ones moved along.

        Raises
        ------
        InputError
            If the surface of a known subject is not that of the result.
        """
        contents = {subject.name: subject.content for subject in self.record.subjects}
        changed = [
            shape.name for shape in shapes if contents.get(shape.name, "") not in ("", surface_hash(shape))
        ]
        if changed:
            raise InputError(f"{', '.join(changed)}: the surface is not that of the result; start a new run")
        known = [shape for shape in shapes if shape.name in self.local]
        local = np.stack([self.local[item.name] for item in known])
        here = transform_points(np.stack([item.alignment for item in known]), local)
        there = transform_points(np.stack([self.alignments[item.name] for item in known]), local)
        move = _agreed_move(here, there)
        return [replace(s, alignment=self.alignments.get(s.name, move @ s.alignment)) for s in shapes]

    def initial(self, shapes: Sequence[Shape], tick: Tick, *, fits: bool | None = None) -> InitialParticles:
        """Return the initial particles; known subjects keep theirs if new ones are fitted, `fits`."""
        known = np.array([shape.name in self.local for shape in shapes])
        local = np.stack([self.local[shape.name] for shape in shapes if shape.name in self.local])
        moves = known.all() if fits is None else not fits
        return InitialParticles(local) if moves else initialize_fit(shapes, local, known, tick)

    def initial_of_structures(self, inputs: OptimizationInput, tick: Tick) -> dict[str, InitialParticles]:
        """Return the initial particles of several structures, by name."""
        fits = any(item.name not in self.names for part in inputs.parts.values() for item in part.groomed)
        return {
            name: self.parts[name].initial(part.shapes, tick, fits=fits)
            for name, part in inputs.parts.items()
        }


def _agreed_move(moving: FloatArray, fixed: FloatArray) -> FloatArray:
    """Return the similarity (4, 4) that maps most subjects' particles (M, N, 3).

    Registration may rotate individual near-symmetric subjects differently than before; these are ignored.
    """
    moves = [fit_similarity(own, goal, scaling=True) for own, goal in zip(moving, fixed, strict=True)]
    errors = np.array(
        [np.linalg.norm(transform_points(move, moving) - fixed, axis=2).mean(axis=1) for move in moves]
    )
    best = errors[int(np.argmin(np.median(errors, axis=1)))]
    agreed = best <= 2.0 * np.median(best) + 1e-9
    return fit_similarity(moving[agreed].reshape(-1, 3), fixed[agreed].reshape(-1, 3), scaling=True)


def adds_particles(record: ResultRecord, cohort: Cohort, settings: RunSettings) -> bool:
    """Return whether a result equals that of a run except for fewer particles.

    Parameters
    ----------
    record : ResultRecord
        Record of the result.
    cohort : Cohort
        Cohort of the new run.
    settings : RunSettings
        Settings of the new run.

    Returns
    -------
    bool
    """
    before, more = record.settings.optimize, _more(record, settings)
    counts = {"particles": before.particles, "structure_particles": before.structure_particles}
    same = settings.optimize.model_copy(update=counts), settings.groom
    return (
        record.ended != CANCELLED
        and min(more) >= 0 < max(more)
        and same == (before, record.settings.groom)
        and [subject.name for subject in cohort.subjects] == [subject.name for subject in record.subjects]
    )


def _more(record: ResultRecord, settings: RunSettings) -> list[int]:
    """Return how many particles more than a result each structure is to have."""
    present = [item.particles for item in record.structures] or [record.particles]
    wanted = settings.counts
    return [now - before for now, before in zip(wanted, present, strict=False)]


def new_subjects(record: ResultRecord, cohort: Cohort, settings: RunSettings) -> tuple[Subject, ...]:
    """Return the subjects of a cohort that can be fitted to a result; none if something else differs."""
    known = {subject.name for subject in record.subjects}
    same = (settings.optimize, settings.groom) == (record.settings.optimize, record.settings.groom)
    if not same or not known <= {subject.name for subject in cohort.subjects}:
        return ()
    return tuple(subject for subject in cohort.subjects if subject.name not in known)


def read_prior_result(project: ProjectFolder) -> PriorResult:
    """Read the result of a project as a base; raises InputError if there is none or it is damaged."""
    result = read_result(project)
    record = project.read().result
    assert record is not None, "a result was read"
    return PriorResult(
        record,
        dict(zip(result.names, result.local, strict=True)),
        dict(zip(result.names, result.alignments, strict=True)),
        {item.name: read_prior_result(project.structure(item.name)) for item in record.structures},
    )
