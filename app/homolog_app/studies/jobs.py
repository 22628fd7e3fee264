"""The long jobs of the window. Their functions run in the computing thread, without Qt.

They import slow modules of the core themselves.
"""

import logging
import sys
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from homolog.arrays import FloatArray
from homolog.cohort import Cohort, Subject
from homolog.errors import Cancelled, InputError
from homolog.io.names import file_stems
from homolog.io.project import ProjectFolder
from homolog.progress import Tick, part_of
from homolog.settings import GroomSettings, RunSettings
from homolog_app.studies.loaded_result import LoadedResult, Recorder, load_result
from homolog_app.studies.model_shape import PreliminaryFits, PreliminaryModel

if TYPE_CHECKING:
    from homolog.correspondence import Frame
    from homolog.grooming import GroomedSubject
    from homolog.run import RunStatus
    from homolog.surfaces.mesh import TriangleMesh
    from homolog_app.studies.file_survey import FileSurvey

__all__ = [
    "Devices",
    "RunJob",
    "carry_cuts",
    "groom",
    "groom_again",
    "groomed_before",
    "import_model",
    "prepare",
    "read_files",
]

_log = logging.getLogger(__name__)
_COMPILING = "compiling, once on this machine"


@dataclass(frozen=True, slots=True)
class Devices:
    """The machine's devices: alias and name, and the one that *automatic* selects."""

    names: dict[str, str]
    automatic: str


def prepare(tick: Tick) -> Devices:
    """Import heavy modules and compile the kernels, so that the first run starts without delay."""
    tick(0.0, "loading compute kernels")
    import matplotlib.font_manager  # noqa: F401 - lists the system's fonts, for names of other scripts
    import warp

    import homolog.run  # noqa: F401 - brings all that a run computes with
    import homolog_app.plots  # noqa: F401 - the first plot appears at once
    from homolog.device import choose_device, describe_device

    automatic = choose_device("auto")
    aliases = ["cpu", *(device.alias for device in warp.get_cuda_devices())]
    names = {"auto": f"Automatic: {describe_device(automatic)}"}
    names |= {alias: describe_device(alias) for alias in aliases}
    if len(aliases) > 2:
        names[",".join(aliases[1:])] = f"All {len(aliases) - 1} GPUs"
    ours = [module for name, module in sys.modules.items() if name.startswith("homolog.")]
    kernels = [item for module in ours for item in vars(module).values() if isinstance(item, warp.Kernel)]
    modules = sorted({kernel.module.name for kernel in kernels})
    for number, module in enumerate(modules):
        tick(
            number / len(modules), _COMPILING if _is_missing(module, automatic) else "loading compute kernels"
        )
        warp.load_module(module, device=automatic)
    return Devices(names, automatic)


def _is_missing(module: str, device: str) -> bool:
    """Return whether kernels of a module have not been compiled on this machine for a device."""
    import warp

    block = 1 if device == "cpu" else None  # Warp's number of threads in a block of a CPU
    name = warp.get_module(module).get_module_identifier(block)
    return not (Path(warp.config.kernel_cache_dir) / name).exists()


def read_files(
    subjects: Sequence[Subject], groom: GroomSettings, arrived: "Callable[[FileSurvey], None]", tick: Tick
) -> None:
    """Preview files and hand over the results one by one."""
    from homolog_app.studies.file_survey import survey_subject

    for number, subject in enumerate(subjects):
        tick(number / len(subjects), f"reading {subject.name}")
        arrived(survey_subject(subject, groom))


def import_model(source: Path, folder: Path, domain: str, tick: Tick) -> list[str]:
    """Create a project from another program's model; return remarks on the import."""
    from homolog.run.import_model import import_model as imported

    return imported(source, ProjectFolder(folder), domain=domain, tick=tick)


def groom(
    cohort: Cohort, settings: RunSettings, project: ProjectFolder, tick: Tick
) -> "tuple[list[GroomedSubject], FloatArray]":
    """Groom and align a cohort; unchanged subjects come from the project's cache."""
    from homolog.cluster import retried_on_workers
    from homolog.threads import cores

    groomed = retried_on_workers(
        lambda executor: _groomed(cohort, settings, project, executor, part_of(tick, 0.0, 0.9)),
        "grooming",
        settings.workers or cores(),
        settings.cluster,
    )
    tick(0.9, "aligning")
    return _aligned(cohort, groomed, settings, project, part_of(tick, 0.9, 1.0))


def _folders(settings: RunSettings, project: ProjectFolder) -> dict[str, tuple[GroomSettings, ProjectFolder]]:
    """Return how each structure is groomed, and its project; "" for a single one, here and below."""
    several = settings.groom.of_structures
    return {name: (own, project.structure(name)) for name, own in several.items()} or {
        "": (settings.groom, project)
    }


def _groomed(
    cohort: Cohort, settings: RunSettings, project: ProjectFolder, executor: Executor, tick: Tick
) -> "dict[str, Sequence[GroomedSubject]]":
    from homolog.grooming import groom_cohort

    folders = _folders(settings, project)
    parts: dict[str, Sequence[GroomedSubject]] = {}
    for number, (name, (own, folder)) in enumerate(folders.items()):
        folder.groomed.mkdir(parents=True, exist_ok=True)
        now = part_of(tick, number / len(folders), (number + 1) / len(folders))
        parts[name] = groom_cohort(cohort, own, executor=executor, cache=folder.groomed, tick=now)
    return parts


def _aligned(
    cohort: Cohort,
    parts: "Mapping[str, Sequence[GroomedSubject]]",
    settings: RunSettings,
    project: ProjectFolder,
    tick: Tick,
) -> "tuple[list[GroomedSubject], FloatArray]":
    """Return whole subjects and their alignments, as a run has them."""
    from homolog.registration import align_cohort
    from homolog.run.structures import joined_subject

    by = settings.optimize.align_by
    if "" in parts:
        return align_cohort(cohort, parts[""], settings.groom, tick, cache=project.registrations)
    wholes = [joined_subject(dict(zip(parts, own, strict=True))) for own in zip(*parts.values(), strict=True)]
    shapes, folder = (wholes, project) if by is None else (parts[by], project.structure(by))
    shapes, places = align_cohort(cohort, shapes, settings.groom, tick, cache=folder.registrations)
    return wholes if by else list(shapes), places


def groom_again(
    cohort: Cohort,
    name: str,
    others: Mapping[str, "GroomedSubject"],
    settings: RunSettings,
    project: ProjectFolder,
    tick: Tick,
) -> "dict[str, tuple[GroomedSubject, FloatArray]]":
    """Groom one subject of a cohort again; return all as they now lie to each other, the others unchanged."""
    from homolog.cluster import subject_executor
    from homolog.grooming import compared
    from homolog.registration import align_cohort
    from homolog.run.structures import joined_subject

    alone = Cohort(tuple(item for item in cohort.subjects if item.name == name), cohort.folder)
    with subject_executor(1, settings.cluster) as executor:
        parts = _groomed(alone, settings, project, executor, part_of(tick, 0.0, 0.5))
    own = {part: items[0] for part, items in parts.items()}
    shapes = {**others, name: own[""] if "" in own else joined_subject(own)}
    among = Cohort(tuple(item for item in cohort.subjects if item.name in shapes), cohort.folder)
    aligned, places = align_cohort(
        among,
        compared([shapes[item.name] for item in among.subjects]),
        settings.groom,
        part_of(tick, 0.5, 1.0),
        cache=project.registrations,
    )
    shapes[name] = next(item for item in aligned if item.name == name)
    return {item.name: (shapes[item.name], place) for item, place in zip(among.subjects, places, strict=True)}


def carry_cuts(
    name: str, text: str, shapes: "Mapping[str, tuple[TriangleMesh, FloatArray]]", tick: Tick
) -> dict[str, str]:
    """Return the cuts of all subjects that correspond to those of one of them, as their tables have them.

    Parameters
    ----------
    name, text : str
        The subject, and its cuts.
    shapes : mapping of str to (TriangleMesh, (4, 4) array)
        The whole surface of each subject, and its alignment.
    tick : Tick
    """
    from homolog.grooming.subject import COARSE_VERTICES
    from homolog.io.constraints import parse_cuts, text_of
    from homolog.run.planes import carried_cuts
    from homolog.surfaces.simplify import simplified

    names = list(shapes)
    meshes = [simplified(mesh, COARSE_VERTICES) for mesh, _ in shapes.values()]
    places = np.stack([place for _, place in shapes.values()])
    carried = carried_cuts(parse_cuts(text, name), names.index(name), meshes, places, names, tick)
    texts = {other: text_of(cuts) for other, cuts in zip(names, carried, strict=True)}
    return texts | {name: text}


def groomed_before(
    cohort: Cohort, settings: RunSettings, project: ProjectFolder, tick: Tick
) -> "tuple[list[GroomedSubject], FloatArray] | None":
    """Return a project's cached groomed subjects, aligned; None unless all are up to date."""
    from homolog.grooming.cache import content_key, load_groomed
    from homolog.grooming.subject import read_source, settings_of
    from homolog.io.constraints import cuts_of

    parts: dict[str, list[GroomedSubject]] = {}
    for name, (groom, folder) in _folders(settings, project).items():
        parts[name] = []
        for number, subject in enumerate(cohort.subjects):
            tick(number / len(cohort.subjects), f"looking for the groomed shape of {subject.name}")
            if not (folder.groomed / f"{file_stems([subject.name])[0]}.npz").is_file():
                return None
            try:
                own = settings_of(subject, groom)
                key = content_key(read_source(subject, own), own, cuts_of(subject, own.segment))
            except InputError:
                return None  # reported when files are read
            kept = load_groomed(folder.groomed, subject.name, key)
            if kept is None:
                return None
            parts[name].append(kept)
    return _aligned(cohort, parts, settings, project, tick) if cohort.subjects else None


class RunJob:
    """A run of the pipeline, with its frames recorded and its result read back."""

    def __init__(
        self,
        project: ProjectFolder,
        cohort: Cohort,
        settings: RunSettings,
        *,
        resume: bool,
        from_result: bool = False,
        title: str = "",
    ) -> None:
        from homolog.run import Run

        self._run = Run(project, cohort, settings, resume=resume, from_result=from_result)
        self._from_result = from_result
        self._last: Frame | None = None
        self._cluster = ""
        self.recorder = Recorder()
        self.names = [subject.name for subject in cohort.subjects]
        self._status: RunStatus = self._run.status
        self._latest: tuple[RunStatus, PreliminaryModel | None] = (self._status, None)
        optimize = settings.optimize
        self._fits = PreliminaryFits(self._run, title, optimize.method, optimize.particles)

    @property
    def keeps(self) -> bool:
        """Whether particles can be saved when the run is cancelled; an initial result remains."""
        return self._run.can_be_kept

    @property
    def preliminary(self) -> PreliminaryModel | None:
        """The shape model of the particles placed so far; None before the first."""
        return self._fits.newest

    @property
    def status(self) -> "RunStatus":
        """Status of the run; a new object also for each new preliminary model."""
        latest = (self._run.status, self._fits.newest)
        if any(now is not before for now, before in zip(latest, self._latest, strict=True)):
            self._latest, self._status = latest, replace(latest[0])
        return self._status

    @property
    def frame(self) -> "Frame | None":
        """The newest particles."""
        return self._run.frame

    def cancel(self) -> None:
        """Stop as soon as possible; a checkpoint remains."""
        self._run.cancel()

    def set_paused(self, paused: bool) -> None:
        """Pause or resume."""
        self._run.set_paused(paused)

    def keep(self, tick: Tick) -> LoadedResult | None:
        """Save the particles of a cancelled run as the result and read it; None if there are too few."""
        tick(0.0, "saving the particles")
        return self._finished() if self._run.keep() else None

    def execute(self) -> LoadedResult:
        """Execute the run and read its result; raises Cancelled if it was cancelled."""
        from homolog.run import FinishReason

        try:
            reason = self._run.execute(self._watch)
        finally:
            self._fits.close()
        if reason is FinishReason.CANCELLED:
            raise Cancelled("cancelled")
        return self._finished()

    def _finished(self) -> LoadedResult:
        self.recorder.write(self._run.project)
        return load_result(self._run.project)

    def _watch(self, status: "RunStatus") -> None:
        if status.cluster not in ("", self._cluster):
            self._cluster = status.cluster
            _log.info("%s", status.cluster)
        frame = self._run.frame
        if frame is not None and frame is not self._last:
            self._last = frame
            if frame.iteration > 0:  # before the first iteration there are no energies
                self.recorder.take(frame.iteration, frame.world, frame.energies, frame.alignments)
        if not self._from_result:
            self._fits.look()
