"""Grooming of a cohort: checks in advance, parallel grooming, cache."""

import logging
import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from homolog.arrays import Array
from homolog.cluster import each_in_workers, each_read
from homolog.cohort import Cohort, Subject
from homolog.errors import InputError, NumericalError, WorkerDiedError
from homolog.grooming.cache import (
    check_names,
    content_key,
    is_outdated,
    load_groomed,
    save_groomed,
    stored_key,
)
from homolog.grooming.clean import is_pair
from homolog.grooming.cuts import check_cuts
from homolog.grooming.missing_slices import with_missing_slices
from homolog.grooming.subject import (
    GroomedSubject,
    Source,
    check_source,
    groom,
    read_source,
    settings_of,
)
from homolog.grooming.twins import twins
from homolog.io.constraints import cuts_of
from homolog.io.images import Segmentation
from homolog.io.markups import Markups, read_markups
from homolog.progress import Tick, no_tick, part_of
from homolog.registration.align import of_other_units
from homolog.settings import GroomSettings, Pieces
from homolog.surfaces.mesh import TriangleMesh
from homolog.threads import cores
from homolog.workers import main_guard_hint, worker_processes

__all__ = ["Problem", "Reading", "check_cohort", "compared", "groom_cohort", "is_unchanged", "landmarks_in"]

_log = logging.getLogger(__name__)

_CLOSED = ("by winding number (for rims that are not flat)", "flat")
_PAIR = (
    "has two separate pieces of similar size, such as both lungs under one label; only the larger one "
    "would be used. Give each piece its own label (in 3D Slicer: Islands), or join them"
)

NO_SOURCES: Mapping[str, Source] = {}
_LOOKING = 0.1
"""Fraction of the progress in which the cache is read."""
_MOST_KEPT = 2**28
"""Memory for the shapes of checked files, in bytes; those above an equal share are read again."""


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """What was read of a subject's file.

    Attributes
    ----------
    key : str
        The `content_key` of its shape.
    source : _Packed or TriangleMesh or None
        The shape, if it is kept.
    landmarks : Markups or None
        The subject's landmarks, if it has any.
    """

    key: str
    source: "_Packed | TriangleMesh | None" = None
    landmarks: Markups | None = None


def landmarks_in(readings: Iterable[Mapping[str, Reading]]) -> dict[str, Markups]:
    """Return the landmarks that were read, by subject."""
    return {name: item.landmarks for those in readings for name, item in those.items() if item.landmarks}


NOTHING_READ: Mapping[str, Reading] = {}


@dataclass(frozen=True, slots=True, eq=False)
class _Packed:
    """A segmentation with eight voxels in a byte."""

    bits: Array
    shape: tuple[int, ...]
    rest: Segmentation

    @classmethod
    def of(cls, whole: Segmentation) -> "_Packed":
        nothing = np.zeros((0, 0, 0), np.bool_)
        return cls(np.packbits(whole.mask), whole.mask.shape, replace(whole, mask=nothing))

    def unpacked(self) -> Segmentation:
        bits = np.unpackbits(self.bits, count=math.prod(self.shape))
        return replace(self.rest, mask=bits.reshape(self.shape).view(np.bool_))


@dataclass(frozen=True, slots=True, eq=False)
class _Content:
    """What a subject's file holds: what is kept of it, its structure's name, and whether it is a pair."""

    reading: Reading
    structure: str = ""
    is_pair: bool = False


_Job = tuple[Subject, GroomSettings, Source | _Packed | None, str]


@dataclass(frozen=True, slots=True)
class Problem:
    """A file that can't be groomed: the subject's name and one line for the user."""

    subject: str
    message: str


def check_cohort(
    cohort: Cohort,
    settings: GroomSettings,
    tick: Tick = no_tick,
    *,
    executor: Executor | None = None,
    sources: Mapping[str, Source] = NO_SOURCES,
    readings: dict[str, Reading] | None = None,
) -> list[Problem]:
    """Read every file in workers, and return the problems, in the cohort's order.

    Nothing is groomed or written. Only grooming itself detects a grid that does not fit into memory, a mesh
    too small for the requested edge length, and a shape that vanishes in smoothing. A file that ends the
    process that reads it is a problem like any other.

    Parameters
    ----------
    cohort : Cohort
    settings : GroomSettings
    tick : Tick
        Called at least every 0.1 s.
    executor : Executor, optional
        Reads the files; by default, processes of this machine.
    sources : mapping of str to Segmentation or TriangleMesh, optional
        Shapes in memory, by subject, in place of their files.
    readings : dict, optional
        Receives what was read of each file, for `groom_cohort`.

    Returns
    -------
    list of Problem
    """
    contents: dict[str, _Content] = {}
    wrong: dict[str, str] = {}
    most = _MOST_KEPT // max(len(cohort.subjects), 1) if readings is not None else 0
    jobs = {item.name: (item, settings, sources.get(item.name), most) for item in cohort.subjects}
    files = {item.name: item.path for item in cohort.subjects}
    for name, future in each_read(_read, jobs, files, "checking", tick, executor):
        try:
            contents[name] = future.result()
        except InputError as error:
            wrong[name] = str(error)
    if readings is not None:
        readings |= {name: item.reading for name, item in contents.items() if name not in sources}
    problems = [Problem(name, message) for name, message in wrong.items()]
    problems += _of_other_names({name: item.structure for name, item in contents.items() if item.structure})
    pairs = [name for name, item in contents.items() if item.is_pair]
    if len(pairs) > 1 and 2 * len(pairs) > len(cohort.subjects):  # in fewer, pieces are noise
        problems += [Problem(name, f"{name}: {_PAIR}") for name in pairs]
    order = {item.name: index for index, item in enumerate(cohort.subjects)}
    return sorted(problems, key=lambda problem: order[problem.subject])


_Check = tuple[Subject, GroomSettings, Source | None, int]


def _read(job: _Check) -> _Content:
    """Read and check a subject, in a worker; shapes of more than some bytes are not kept."""
    subject, common, given, most = job
    settings = settings_of(subject, common)
    source = read_source(subject, settings) if given is None else check_source(given, settings, subject.name)
    landmarks = None if subject.landmarks is None else read_markups(subject.landmarks)
    check_cuts(subject.name, cuts := cuts_of(subject, settings.structure), source)
    reading = Reading(content_key(source, settings, cuts) if most else "", landmarks=landmarks)
    if isinstance(source, TriangleMesh):
        kept = source.vertices.nbytes + source.faces.nbytes <= most
        return _Content(replace(reading, source=source if kept else None))
    packed = _Packed.of(source)
    return _Content(
        replace(reading, source=packed if packed.bits.nbytes <= most else None),
        source.name.strip() if source.name and settings.segment is None else "",
        settings.pieces is Pieces.LARGEST and is_pair(with_missing_slices(source)[0].mask),
    )


def is_unchanged(cohort: Cohort, settings: GroomSettings, cache: Path, tick: Tick = no_tick) -> bool:
    """Return whether a cache has every subject as its file is now; files are read in workers.

    A file that can't be read counts as changed; whoever grooms it reports the fault.
    """
    stored = {subject.name: stored_key(cache, subject.name) for subject in cohort.subjects}
    if not all(stored.values()):
        return False
    jobs = {subject.name: (subject, settings) for subject in cohort.subjects}
    files = {subject.name: subject.path for subject in cohort.subjects}
    return all(
        future.exception() is None and future.result() == stored[name]
        for name, future in each_read(_key, jobs, files, "comparing", tick)
    )


def _key(job: tuple[Subject, GroomSettings]) -> str:
    """Return the key of a subject's file; empty if it can't be read."""
    subject, common = job
    try:
        settings = settings_of(subject, common)
        return content_key(read_source(subject, settings), settings, cuts_of(subject, settings.structure))
    except InputError:
        return ""


def _of_other_names(called: dict[str, str]) -> list[Problem]:
    """Return the subjects whose files give the label another name: it may mean another structure."""
    names = Counter(item.casefold() for item in called.values())
    usual = max(names, key=names.__getitem__, default="")
    return [
        Problem(
            subject,
            f"{subject}: this label is called {name!r} here, but {usual!r} in most other "
            "files; choose the structure by its name (segment)",
        )
        for subject, name in called.items()
        if name.casefold() != usual
    ]


def groom_cohort(
    cohort: Cohort,
    settings: GroomSettings,
    *,
    executor: Executor | None = None,
    cache: Path | None = None,
    tick: Tick = no_tick,
    left_out: list[Problem] | None = None,
    sources: Mapping[str, Source] = NO_SOURCES,
    readings: Mapping[str, Reading] = NOTHING_READ,
    reduced: Callable[[GroomedSubject], GroomedSubject] | None = None,
) -> list[GroomedSubject]:
    """Groom every subject.

    Parameters
    ----------
    cohort : Cohort
        At least one subject.
    settings : GroomSettings
        Alignment and scaling are ignored.
    executor : Executor, optional
        Runs the grooming on workers that can read the files; by default, processes of this machine.
    cache : Path, optional
        Folder of groomed subjects. Only changed subjects are groomed again, with a note and a line in the log
        if their file has changed.
    tick : Tick
        Called at least every 0.1 s.
    left_out : list of Problem, optional
        Receives the subjects that fail or have another unit; the result excludes them. If it is not given,
        the first failure is raised.
    sources : mapping of str to Segmentation or TriangleMesh, optional
        Shapes in memory, by subject, in place of their files; they are not cached.
    readings : mapping of str to Reading, optional
        What `check_cohort` has read, by subject; other files are read by the workers.
    reduced : callable, optional
        Converts each groomed subject to a smaller one, which is returned, so that memory need not hold all.

    Returns
    -------
    list of GroomedSubject
        In the cohort's order.

    Raises
    ------
    InputError, NumericalError
        If a subject fails, or a worker process dies.
    Cancelled
        From the tick. Own processes end at once; a given executor finishes pending work.
    """
    taken = reduced or _whole
    if cache:
        check_names([subject.name for subject in cohort.subjects])
    groomed: dict[str, GroomedSubject] = {}
    jobs: dict[str, _Job] = {}
    for index, subject in enumerate(cohort.subjects):
        if cache:
            tick(_LOOKING * index / len(cohort.subjects), f"looking for the groomed shape of {subject.name}")
        name, known = subject.name, stored_key(cache, subject.name) if cache else ""
        read = readings.get(name, Reading(""))
        whole = load_groomed(cache, name, known) if cache and read.key == known else None
        if whole is None:
            jobs[name] = (subject, settings_of(subject, settings), sources.get(name, read.source), known)
        else:
            groomed[name] = taken(whole)
    with nullcontext(executor) if executor or not jobs else worker_processes(min(len(jobs), cores())) as used:
        while jobs and used:
            damaged: dict[str, _Job] = {}
            for name, future in _each_groomed(used, jobs, part_of(tick, _LOOKING, 1.0)):
                try:
                    key, done = future.result()
                except (InputError, NumericalError) as error:
                    if left_out is None:
                        raise
                    left_out.append(Problem(name, str(error)))
                    continue
                whole = load_groomed(cache, name, key) if cache and done is None else done
                if whole is None:
                    damaged[name] = (*jobs[name][:3], "")
                    continue
                groomed[name] = taken(_noted(whole, jobs[name][3], key))
                if cache and done is not None:
                    save_groomed(cache, done, key)
            jobs = damaged
    ordered = [groomed[subject.name] for subject in cohort.subjects if subject.name in groomed]
    if left_out is not None:
        is_open = any(subject.report.rims for subject in ordered)
        sizes = [
            float(np.sqrt(subject.mesh.area) if is_open else np.cbrt(subject.report.volume_after))
            for subject in ordered
        ]
        strange = of_other_units([subject.name for subject in ordered], sizes)
        left_out += [Problem(name, message) for name, message in strange.items()]
        ordered = [subject for subject in ordered if subject.name not in strange]
    return compared(ordered)


def compared(groomed: Sequence[GroomedSubject]) -> list[GroomedSubject]:
    """Return groomed subjects with notes on those whose surfaces differ in kind from most, or occur twice."""
    closings = {item.name: item.report.ends[1] == 0 for item in groomed if any(item.report.ends)}
    openings = {item.name: item.report.rims > 0 for item in groomed}
    handles = {item.name: item.report.genus for item in groomed}
    again = twins(groomed)
    noted = _with_unusual(
        [_with_note(item, again[item.name]) if item.name in again else item for item in groomed],
        closings,
        lambda own, usual: (
            f"a wide opening was closed {_CLOSED[own]}, those of most subjects {_CLOSED[usual]}; differences "
            "there show no anatomy"
        ),
    )
    noted = _with_unusual(
        noted,
        openings,
        lambda own, usual: (
            f"its surface is {'open' if own else 'closed'}, those of most subjects "
            f"{'stay open' if usual else 'are closed'}; repair it, or close or open all meshes"
        ),
    )
    return _with_unusual(
        noted,
        handles,
        lambda own, usual: (
            f"its surface has {own or 'no'} handle{'' if own == 1 else 's'} (tunnels through it), those of "
            f"most subjects {usual or 'none'}; look at it, and correct its file if it is wrong"
        ),
    )


def _with_unusual(
    groomed: Sequence[GroomedSubject],
    kinds: Mapping[str, int],
    note: Callable[[int, int], str],
) -> list[GroomedSubject]:
    """Return the subjects, with a note on each of another kind than most."""
    usual, count = Counter(kinds.values()).most_common(1)[0] if kinds else (0, 0)
    if 2 * count <= len(kinds):
        return list(groomed)
    return [
        item if (own := kinds.get(item.name, usual)) == usual else _with_note(item, note(own, usual))
        for item in groomed
    ]


def _whole(groomed: GroomedSubject) -> GroomedSubject:
    return groomed


def _groomed(job: _Job) -> tuple[str, GroomedSubject | None]:
    """Groom a subject, in a worker, and return the key of its shape; no subject if it has the known key."""
    subject, settings, source, known = job
    if isinstance(source, _Packed):
        source = source.unpacked()
    source = read_source(subject, settings) if source is None else source
    cuts = cuts_of(subject, settings.structure)
    key = content_key(source, settings, cuts)
    return key, None if key == known else groom(subject.name, source, settings, cuts)


def _each_groomed(
    executor: Executor, jobs: Mapping[str, _Job], tick: Tick
) -> Iterator[tuple[str, Future[tuple[str, GroomedSubject | None]]]]:
    """Yield subjects as they are groomed."""
    try:
        for name, future in each_in_workers(executor, _groomed, jobs, "grooming", tick):
            if isinstance(error := future.exception(), BrokenExecutor):
                raise error
            yield name, future
    except BrokenExecutor as error:
        raise WorkerDiedError(
            "a grooming process ended unexpectedly, probably for lack of memory: use fewer workers or a "
            f"larger grid spacing{main_guard_hint()}"
        ) from error


def _noted(done: GroomedSubject, known: str, key: str) -> GroomedSubject:
    """Return a subject with a note if its file has changed since it was last groomed."""
    if not is_outdated(known, key):
        return done
    note = "its file has changed since it was last groomed; it was groomed again"
    _log.warning("%s: %s", done.name, note)
    return _with_note(done, note)


def _with_note(groomed: GroomedSubject, note: str) -> GroomedSubject:
    return replace(groomed, report=replace(groomed.report, notes=(*groomed.report.notes, note)))
