"""A finished result as the start of another run: more particles, or new subjects fitted to it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

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
from homolog.run.result import CANCELLED
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
    """

    record: ResultRecord
    local: dict[str, FloatArray]
    alignments: dict[str, FloatArray]

    def check(self, names: Sequence[str], settings: RunSettings) -> None:
        """Raise InputError if a run of these subjects and settings can't start from the result."""
        missing = [name for name in self.local if name not in names]
        if missing:
            raise InputError(f"{', '.join(missing)}: is in the result but not in the cohort; start a new run")
        if settings.groom != self.record.settings.groom:
            raise InputError("the result's surfaces were groomed with other settings; start a new run")
        fresh, more = len(names) > len(self.local), settings.optimize.particles - self.record.particles
        if fresh and more:
            raise InputError(
                f"new subjects get the result's {self.record.particles} particles; fit them first, then "
                "request more particles"
            )
        if more < 0 or not (fresh or more):
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

    def initial(self, shapes: Sequence[Shape], tick: Tick) -> InitialParticles:
        """Return the initial particles; those of known subjects are fixed if there are new ones."""
        known = np.array([shape.name in self.local for shape in shapes])
        local = np.stack([self.local[shape.name] for shape in shapes if shape.name in self.local])
        return InitialParticles(local) if known.all() else initialize_fit(shapes, local, known, tick)


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
    particles = settings.optimize.particles
    same = settings.optimize.model_copy(update={"particles": record.particles}), settings.groom
    return (
        record.ended != CANCELLED
        and record.particles < particles
        and same == (record.settings.optimize, record.settings.groom)
        and [subject.name for subject in cohort.subjects] == [subject.name for subject in record.subjects]
    )


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
    )
