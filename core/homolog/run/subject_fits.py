"""Fits of single subjects to an ensemble, in workers, each stored in its own file."""

import hashlib
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import lru_cache
from pathlib import Path

import numpy as np

from homolog.arrays import FloatArray
from homolog.cluster import SubjectWorkers
from homolog.correspondence import Shape
from homolog.correspondence.ensemble import Ensemble, ShapeState, StateArrays
from homolog.correspondence.schedule import StagePlan
from homolog.correspondence.shape_fit import (
    first_particles,
    fit_shape,
    fit_shape_from,
    nearest_template,
)
from homolog.errors import InputError
from homolog.grooming.cache import read_groomed
from homolog.io.arrays import read_arrays, write_arrays
from homolog.io.atomic import report_os_errors
from homolog.io.names import file_stems
from homolog.progress import Tick
from homolog.run.fingerprints import surface_hash
from homolog.settings import OptimizeSettings, Procrustes

__all__ = ["Reached", "SubjectFits", "groomed_shape"]


_REACHED = "reached.npz"
"""Record of the last complete pass."""


def groomed_shape(folder: Path, name: str, alignment: FloatArray) -> Shape:
    """Return a groomed subject as a shape with an alignment."""
    groomed = read_groomed(folder, name)
    return Shape(name, groomed.field, groomed.mesh, groomed.coarse_mesh, alignment)


@dataclass(frozen=True, slots=True)
class _Job:
    """A job of a worker: the fit of a subject.

    Attributes
    ----------
    groomed, ensemble : Path
        Folder of the groomed subjects, and file of the ensemble.
    name : str
    placement : (4, 4) array
        Initial placement of the fit.
    local : (n, 3) array or None
        Initial particles; None to warp those of a template.
    plan : StagePlan or None
        Of a pass over all subjects, whose ensemble contains the subject.
    templates : tuple of str
        Names of the templates.
    settings : OptimizeSettings
    key : str
        Hash of all inputs of the fit.
    """

    groomed: Path
    ensemble: Path
    name: str
    placement: FloatArray
    local: FloatArray | None
    plan: StagePlan | None
    templates: tuple[str, ...]
    settings: OptimizeSettings
    key: str


@dataclass(frozen=True, slots=True)
class Reached:
    """How far the passes over all subjects have come.

    Attributes
    ----------
    number : int
        The last complete pass.
    scale : float
        Mean scale of the placements in the first one.
    error : float
        Generalization error after the last pass that was evaluated, or after the first fits.
    is_last : bool
        Whether no further pass follows.
    annealing : int
        Number of passes of annealing.
    """

    number: int
    scale: float
    error: float
    is_last: bool
    annealing: int


@dataclass(frozen=True, slots=True)
class SubjectFits:
    """Fits of a cohort, each in its own file."""

    shapes: Sequence[Shape]
    names: Sequence[str]
    folder: Path
    groomed: Path
    placing: OptimizeSettings
    workers: SubjectWorkers
    hashes: dict[int, str] = field(default_factory=dict)

    def run(
        self,
        ensemble: Ensemble,
        begin: Mapping[int, tuple[FloatArray | None, FloatArray]],
        templates: tuple[str, ...],
        number: int,
        states: StateArrays,
        tick: Tick,
        plan: StagePlan | None = None,
    ) -> None:
        """Fit subjects, by index, from initial particles (None to warp a template's) and placements.

        With a plan, the ensemble contains the subjects.
        """
        folder = self.folder / f"pass{number}"
        with report_os_errors(folder):
            folder.mkdir(parents=True, exist_ok=True)
        path, whole_key = folder / "ensemble.npz", _ensemble_key(ensemble, self.placing, plan)
        write_arrays(path, ensemble.arrays)
        stems = file_stems([f"fit {self.names[index]}" for index in begin])
        jobs: dict[str, _Job] = {}
        places: dict[str, tuple[int, Path]] = {}
        for (index, (local, placement)), stem in zip(begin.items(), stems, strict=True):
            name, file = self.names[index], folder / f"{stem}.npz"
            tick(0.0, f"looking for the fit of {name}")
            key = _key(whole_key, self._hash(index), placement, local)
            stored = _stored(file)
            if stored is not None and stored[0] == key:
                states[index] = stored[1]
                continue
            places[name] = index, file
            jobs[name] = _Job(self.groomed, path, name, placement, local, plan, templates, self.placing, key)
        for name, state in self.workers.each(_fitted, jobs, "fitting", tick):
            index, file = places[name]
            arrays = {item.name: getattr(state, item.name) for item in fields(state)}
            write_arrays(file, {"key": jobs[name].key, **arrays})
            states[index] = state

    def keep(self, key: str, reached: Reached) -> None:
        """Record that a pass is complete, and delete the pass before the previous one.

        Parameters
        ----------
        key : str
            See `key`.
        reached : Reached
        """
        values = {item.name: getattr(reached, item.name) for item in fields(reached)}
        write_arrays(self.folder / _REACHED, {"key": key, **values})
        shutil.rmtree(self.folder / f"pass{reached.number - 2}", ignore_errors=True)

    def reached(self, key: str, states: StateArrays, before: StateArrays, tick: Tick) -> Reached | None:
        """Read the last complete pass and the one before it; return None if there is none of this run.

        Parameters
        ----------
        key : str
            See `key`.
        states, before : StateArrays
            Where the fits of the two passes are written.
        tick : Tick
        """
        path = self.folder / _REACHED
        if not path.is_file():
            return None
        try:
            stored = read_arrays(path)
        except InputError:
            return None
        if str(stored["key"]) != key:
            return None
        number = int(stored["number"])
        for target, folder in ((states, f"pass{number}"), (before, f"pass{number - 1}")):
            for index, stem in enumerate(file_stems([f"fit {name}" for name in self.names])):
                tick(0.0, f"reading the fit of {self.names[index]}")
                fit = _stored(self.folder / folder / f"{stem}.npz")
                if fit is None:
                    return None
                target[index] = fit[1]
        return Reached(
            number,
            float(stored["scale"]),
            float(stored["error"]),
            bool(stored["is_last"]),
            int(stored["annealing"]),
        )

    def key(self, fingerprint: str, tick: Tick) -> str:
        """Return a hash of a `fingerprint`, and of all surfaces, placements and settings."""
        given = f"{fingerprint} {self.placing.model_dump_json(exclude_none=True)}"
        digest = hashlib.blake2b(given.encode(), digest_size=16)
        for index, shape in enumerate(self.shapes):
            tick(0.0, f"surface of {self.names[index]}")
            digest.update(f"{self.names[index]} {self._hash(index)} {shape.alignment.tolist()}".encode())
        return digest.hexdigest()

    def _hash(self, index: int) -> str:
        if index not in self.hashes:
            self.hashes[index] = surface_hash(self.shapes[index])
        return self.hashes[index]


@lru_cache(maxsize=2)
def _read_ensemble(path: Path, changed: float) -> Ensemble:
    del changed  # part of the cache key: another run may rewrite the file
    return Ensemble(**read_arrays(path))


def _fitted(job: _Job) -> ShapeState:
    """Fit one subject, in a worker."""
    ensemble = _read_ensemble(job.ensemble, job.ensemble.stat().st_mtime)
    shape = groomed_shape(job.groomed, job.name, job.placement)
    if job.local is not None:
        return fit_shape(shape, job.settings, ensemble, job.local, plan=job.plan)
    index = nearest_template(ensemble, shape)
    template = groomed_shape(job.groomed, job.templates[index], ensemble.placements[index])
    local = first_particles(ensemble, index, template, shape)
    if job.settings.procrustes is Procrustes.OFF:
        return fit_shape(shape, job.settings, ensemble, local)
    return fit_shape_from(shape, job.settings, ensemble, [local])


def _stored(path: Path) -> tuple[str, ShapeState] | None:
    """Return the hash of a stored fit's inputs, and the fit; None if it can't be read."""
    if not path.is_file():
        return None
    try:
        stored = read_arrays(path)
    except InputError:
        return None  # the subject is fitted again
    return str(stored.pop("key", "")), ShapeState(**stored)


def _ensemble_key(ensemble: Ensemble, settings: OptimizeSettings, plan: StagePlan | None) -> str:
    given = f"{settings.model_dump_json(exclude_none=True)} {plan}"
    digest = hashlib.blake2b(given.encode(), digest_size=16)
    for array in ensemble.arrays.values():
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def _key(ensemble_key: str, surface: str, placement: FloatArray, local: FloatArray | None) -> str:
    """Return a hash of all inputs of a fit."""
    digest = hashlib.blake2b(f"{ensemble_key} {surface}".encode(), digest_size=16)
    for array in (placement, local):
        if array is not None:
            digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
