"""The inspection of the open result, and repairs of its particles, with undo."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PySide6.QtCore import QObject, Signal, Slot

from homolog.progress import Tick
from homolog_app.scenes.loaded_result import LoadedResult, Recorder, write_from_memory
from homolog_app.scenes.structures import ALL
from homolog_app.window.workspace import Workspace

if TYPE_CHECKING:
    from homolog.inspection import Inspection, Suspect

__all__ = ["InspectionState"]

FEWEST = 3
"""Smallest number of subjects for an inspection."""

_REPAIRED = "particles were optimized again where they were suspect"


@dataclass(frozen=True, slots=True, eq=False)
class _Version:
    """A result, its inspection, and its unsaved repairs."""

    loaded: LoadedResult
    inspection: "Inspection"
    notes: dict[str, str]


class InspectionState(QObject):
    """Inspects the session's result in the computing thread while the page that shows that is open.

    A cancelled inspection restarts when the page is opened again or on request; `inspected` follows each that
    was carried out. `repaired` gives the suspects that were optimized again, and the number of those whose
    new particles are better; others stay.
    """

    changed = Signal()
    inspected = Signal()
    repaired = Signal(object, int)

    def __init__(self, workspace: Workspace, parent: QObject, page: str) -> None:
        super().__init__(parent)
        self._workspace, self._page = workspace, page
        self._requested: LoadedResult | None = None
        self._seen: LoadedResult | None = None
        self._versions: list[_Version] = []
        session = workspace.session
        for signal in (session.result_changed, session.page_changed, session.step_changed):
            signal.connect(self._look)
        workspace.session.undo.cleanChanged.connect(self._follow_save)
        workspace.session.job_changed.connect(self._follow_job)

    @property
    def inspection(self) -> "Inspection | None":
        """The inspection of the open result; None until it is done."""
        version = self._version
        return version.inspection if version is not None else None

    @property
    def is_possible(self) -> bool:
        """Whether there are enough subjects for an inspection, of one structure."""
        result = self._workspace.session.part
        return result is not None and len(result.result.names) >= FEWEST and not result.parts

    @property
    def is_written(self) -> bool:
        """Whether the open result is the one in the project's folder."""
        return self._workspace.session.is_result_written

    def want(self) -> None:
        """Open the page and inspect the result unless that was done; `changed` follows."""
        self._requested = None
        self._workspace.session.show_page(self._page, "explore")
        self._look()

    def repair(self, suspects: "Sequence[Suspect]") -> None:
        """Optimize the particles around suspects again; `repaired` follows; one undo takes it back."""
        version, workspace = self._version, self._workspace
        if version is None or not suspects:
            return
        if workspace.session.aspect != ALL:
            workspace.session.noticed.emit("Structures are optimized together: run all again")
            return
        project, inspection = workspace.project, version.inspection
        better: list[str] = []

        def work(tick: Tick) -> _Version:
            from homolog.progress import part_of
            from homolog.run.repair import repaired
            from homolog.run.shape_files import mesh_of, surface_of_model
            from homolog.statistics.shape_model import ShapeModel

            after = inspection
            for index, suspect in enumerate(suspects):
                part = part_of(tick, 0.8 * index / len(suspects), 0.8 * (index + 1) / len(suspects))
                if any(_same(suspect, other) for other in after.suspects):  # else it is resolved
                    before, after = after, repaired(project, after, suspect, part)
                    if after is not before:
                        better.append(version.loaded.result.names[suspect.subject])
            if not better:
                return version
            places = after.located
            model, last = ShapeModel().fit(places.world), part_of(tick, 0.8, 1.0)
            surface = surface_of_model(model, places.world, places.meshes, places.alignments, last)
            result = replace(
                version.loaded.result,
                local=places.local,
                world=places.world,
                mean_surface=mesh_of(surface),
                smoothing=surface.smoothing,
            )
            notes = version.notes | dict.fromkeys(better, _REPAIRED)
            return _Version(replace(version.loaded, result=result), after, notes)

        def take(after: _Version) -> None:
            if better:
                self._versions.append(after)
                names = ", ".join(dict.fromkeys(better))
                workspace.session.exchange_result(after.loaded, f"Optimize again: {names}")
            self.repaired.emit(tuple(suspects), len(better))

        workspace.work.compute("mend", work, "optimizing particles again", take)

    def write(self) -> None:
        """Replace the result in the project's folder by the open one."""
        session, project = self._workspace.session, self._workspace.project
        result, written, version = session.result, session.written, self._version
        if result is None or self.is_written:
            return
        notes = version.notes if version is not None else {}
        same_run = written is not None and result.record is written.record
        cohort = session.study.whole

        def work(tick: Tick) -> LoadedResult:
            from homolog.run.repair import write_repaired

            if same_run:
                write_repaired(project, {"": result.result.local}, notes, tick)
                recorder = Recorder()
                recorder.frames = list(result.frames)
                recorder.write(project)
                return result
            record = project.read()  # a run was undone: the result before it is in memory only
            write_from_memory(project, result, cohort, tick)
            following = {"subjects": record.subjects, "settings": record.settings}
            project.write(project.read().model_copy(update=following))
            return result

        self._workspace.work.compute("keep", work, "writing the result", self._receive_written)

    def export(self, path: Path) -> None:
        """Write the list of suspects; raises InputError if the file can't be written."""
        from homolog.run.repair import rows, write_suspects

        version = self._version
        if version is not None:
            inspection = version.inspection
            names = version.loaded.result.names
            write_suspects(path, {"": rows(inspection, inspection.suspects, names)})

    def _receive_written(self, loaded: LoadedResult) -> None:
        self._workspace.session.written = loaded
        self.changed.emit()

    @Slot(bool)
    def _follow_save(self, clean: bool) -> None:
        """Write repaired particles when the project is saved."""
        if clean and not self._workspace.closed:  # the history is cleared once more when it is destroyed
            self.write()

    @Slot()
    def _follow_job(self) -> None:
        """Continue after a job; particles that could not be written remain unsaved."""
        session = self._workspace.session
        known = self._version is not None
        if known and not session.job.is_busy and session.undo.isClean() and not self.is_written:
            session.undo.resetClean()
        self._look()

    @property
    def _version(self) -> _Version | None:
        result = self._workspace.session.part
        return next((version for version in self._versions if version.loaded is result), None)

    @Slot()
    def _look(self) -> None:
        session, result = self._workspace.session, self._workspace.session.part
        busy = session.job.is_busy
        known = self._version is not None
        if result is not self._seen:
            self._seen = result
            if not known:
                self._versions = []
            self.changed.emit()
        if session.page != self._page or session.step != "explore":
            self._requested = None
            return
        if known or result is None or result is self._requested or busy or not self.is_possible:
            return
        self._requested = result

        def inspect(tick: Tick) -> "Inspection":
            from homolog.inspection import inspect
            from homolog.threads import cores

            meshes = [result.surfaces[name][0] for name in result.result.names]
            own = result.result
            return inspect(own.local, meshes, own.alignments, names=own.names, workers=cores(), tick=tick)

        def take(inspection: "Inspection") -> None:
            self._versions = [_Version(result, inspection, {})]
            self.changed.emit()
            self.inspected.emit()

        self._workspace.work.compute("check", inspect, "looking for suspects", take)


def _same(first: "Suspect", other: "Suspect") -> bool:
    shared = np.isin(first.particles, other.particles).any()
    return first.kind is other.kind and first.subject == other.subject and bool(shared)
