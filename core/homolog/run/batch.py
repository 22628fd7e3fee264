"""A batch: one project for each structure of a cohort."""

import json
import logging
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Any

from homolog.cohort import Cohort
from homolog.errors import InputError, user_message
from homolog.grooming.cache import load_report
from homolog.io.atomic import write_text
from homolog.io.names import file_stems
from homolog.io.project import ProjectFolder
from homolog.io.structures import Structure
from homolog.run.events import FinishReason, RunStatus
from homolog.run.run import Run
from homolog.settings import RunSettings

__all__ = ["Batch", "BatchItem", "ItemState"]

_log = logging.getLogger(__name__)

_RECORD, _FORMAT = "batch.json", "homolog-batch"
_TWO = 2
"""Least number of subjects of a shape model."""


class ItemState(StrEnum):
    """State of a structure in a batch."""

    WAITING = "waiting"
    FINISHED = "finished"
    TOO_FEW = "too few subjects"
    FAILED = "failed"
    CANCELLED = "cancelled"


@dataclass(frozen=True, slots=True, eq=False)
class BatchItem:
    """A structure of a batch.

    Attributes
    ----------
    structure : Structure
    project : ProjectFolder
        Project of the structure.
    state : ItemState
    message : str
        Reason why it failed or was skipped.
    absent : tuple of str
        Subjects whose files do not have the structure.
    left_out : tuple of str
        A line for each further subject that was excluded.
    remarks : mapping of str to tuple of str
        Remarks on subjects, by name: absent, at the border of the image, in pieces.
    was_there : bool
        Whether an earlier batch completed it.
    """

    structure: Structure
    project: ProjectFolder
    state: ItemState = ItemState.WAITING
    message: str = ""
    absent: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    remarks: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    was_there: bool = False


class Batch:
    """Runs of the pipeline, one for each structure; a failed run does not end the batch.

    Parameters
    ----------
    cohort : Cohort
        All subjects whose files can be read.
    structures : sequence of Structure
        Structures of the cohort.
    folder : Path
        Folder for a project of each structure, named after it, and a record of the batch. Finished projects
        of an earlier batch with the same subjects and settings are kept, unfinished ones are continued.
    settings : RunSettings
        Settings of each run; label and segment are set for each structure.
    fewest : int
        Least number of subjects; structures with fewer are skipped.
    anew : bool
        Whether to repeat finished structures.

    Raises
    ------
    InputError
        If the folder contains other files than those of a batch.
    """

    def __init__(
        self,
        cohort: Cohort,
        structures: Sequence[Structure],
        folder: Path,
        settings: RunSettings,
        *,
        fewest: int = 3,
        anew: bool = False,
    ) -> None:
        self.folder = folder
        self._record = _read_record(folder)
        self._cohort, self._settings = cohort, settings
        self._fewest, self._anew = max(fewest, _TWO), anew
        self._cancelled = threading.Event()
        self._job: Run | None = None
        stems = file_stems([structure.title for structure in structures])
        names = [subject.name for subject in cohort.subjects]
        self._items = [
            BatchItem(
                structure,
                ProjectFolder(folder / stem),
                absent=tuple(name for name in names if name not in structure.by_subject),
            )
            for structure, stem in zip(structures, stems, strict=True)
        ]

    @property
    def items(self) -> tuple[BatchItem, ...]:
        """The current states of the structures."""
        return tuple(self._items)

    def cancel(self) -> None:
        """Stop as soon as possible; the current structure can be continued."""
        self._cancelled.set()
        if self._job is not None:
            self._job.cancel()

    def execute(
        self,
        observe: Callable[[BatchItem, float, RunStatus], None],
        ended: Callable[[BatchItem], None],
    ) -> FinishReason:
        """Run one structure after the other; return whether all were processed or it was cancelled.

        Parameters
        ----------
        observe : callable
            Called with the structure, the fraction of the whole batch done, and the status of its run.
        ended : callable
            Called with each structure when it is done.

        Returns
        -------
        FinishReason
        """
        for index, item in enumerate(self._items):
            watch = partial(self._watch, observe, index)
            ended_item = self._ended(item, watch)
            self._items[index] = ended_item = replace(ended_item, remarks=_remarks(ended_item))
            if ended_item.state is ItemState.CANCELLED:
                return FinishReason.CANCELLED
            self._write(ended_item)
            ended(ended_item)
        return FinishReason.COMPLETED

    def _watch(
        self, observe: Callable[[BatchItem, float, RunStatus], None], index: int, status: RunStatus
    ) -> None:
        observe(self._items[index], (index + status.fraction) / len(self._items), status)

    def _ended(self, item: BatchItem, watch: Callable[[RunStatus], None]) -> BatchItem:
        cohort = self._cohort.without(set(item.absent))
        count = len(cohort.subjects)
        if count < self._fewest:
            whose = "subject has it" if count == 1 else "subjects have it"
            return replace(item, state=ItemState.TOO_FEW, message=f"{count} {whose}")
        names, settings = [subject.name for subject in cohort.subjects], self._settings_of(item.structure)
        before = self._record.get(item.project.folder.name, {})
        if not self._anew and before.get("names") == names and _has_result(item.project, settings):
            left_out = tuple(map(str, before.get("left_out", ())))
            return replace(item, state=ItemState.FINISHED, left_out=left_out, was_there=True)
        try:
            resume = not self._anew and _can_continue(item.project, names, settings)
            self._job = Run(item.project, cohort, settings, resume=resume, skip_bad=True)
            if self._cancelled.is_set():
                self._job.cancel()
            reason = self._job.execute(watch)
        except Exception as error:  # noqa: BLE001 - whatever is wrong with one structure, others may do
            message = user_message(error)
            if message is None:
                _log.exception("%s failed", item.structure.title)
                message = f"{type(error).__name__}: {error}"
            return replace(item, state=ItemState.FAILED, message=message)
        state = ItemState.FINISHED if reason is FinishReason.COMPLETED else ItemState.CANCELLED
        return replace(item, state=state, left_out=self._job.notes)

    def _settings_of(self, structure: Structure) -> RunSettings:
        chosen = (
            {"segment": structure.name, "label": None}
            if structure.name
            else {"label": structure.values[0], "segment": None}
        )
        groom = self._settings.groom.model_copy(update=chosen)
        return self._settings.model_copy(update={"groom": groom})

    def _write(self, item: BatchItem) -> None:
        """Record the subjects of the structure, for a repeated batch."""
        self._record[item.project.folder.name] = {
            "name": item.structure.title,
            "state": item.state,
            "message": item.message,
            "names": [subject.name for subject in self._cohort.subjects if subject.name not in item.absent],
            "absent": item.absent,
            "left_out": item.left_out,
        }
        content = {"format": _FORMAT, "version": 1, "structures": self._record}
        write_text(self.folder / _RECORD, json.dumps(content, indent=2) + "\n")


def _has_result(project: ProjectFolder, settings: RunSettings) -> bool:
    """Return whether a project is finished with these settings, on any device."""
    if not project.exists:
        return False
    record = project.read()
    result = record.result
    same = _without_execution_settings(record.settings) == _without_execution_settings(settings)
    return same and not record.unfinished and result is not None and result.ended != "cancelled"


def _can_continue(project: ProjectFolder, names: Sequence[str], settings: RunSettings) -> bool:
    """Return whether a project was started with these settings and subjects, and interrupted."""
    if not project.exists:
        return False
    record = project.read()
    same = _without_execution_settings(record.settings) == _without_execution_settings(settings)
    return record.unfinished and same and {subject.name for subject in record.subjects} <= set(names)


def _without_execution_settings(settings: RunSettings) -> RunSettings:
    """Return settings without device and number of workers, which do not change results."""
    return settings.model_copy(update={"device": "auto", "workers": None})


def _remarks(item: BatchItem) -> dict[str, tuple[str, ...]]:
    problems: dict[str, tuple[str, ...]] = dict.fromkeys(item.absent, ("absent",))
    for name, there in item.structure.by_subject.items():
        report = load_report(item.project.groomed, name) if item.state is ItemState.FINISHED else None
        reasons = ["touches the border of its image and may be cut off"] if there.at_border else []
        if report is not None and report.components_dropped:
            kept = min(report.volume_after / max(report.volume_before, 1e-9), 1.0)
            reasons.append(
                f"{report.components_dropped + 1} pieces, the largest kept ({kept:.0%} of the volume)"
            )
        if reasons:
            problems[name] = tuple(reasons)
    return problems


def _read_record(folder: Path) -> dict[str, Any]:
    """Return the record of an earlier batch; raises InputError if the folder contains other files."""
    path = folder / _RECORD
    if not path.is_file():
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise InputError(f"{folder}: contains other files; choose a new or empty folder for the batch")
        return {}
    try:
        content = json.loads(path.read_bytes())
        if content["format"] != _FORMAT or not isinstance(content["structures"], dict):
            raise ValueError("is not of a batch")
        return dict(content["structures"])
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise InputError(f"{path}: is damaged: {error}; choose another folder for the batch") from error
