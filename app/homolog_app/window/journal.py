"""Crash recovery: each window keeps a journal; what one left without closing it can be recovered."""

import shutil
import uuid
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from filelock import FileLock, Timeout
from pydantic import AfterValidator, BaseModel, ConfigDict, ValidationError

from homolog.cohort import checked_path
from homolog.files.atomic import write_text
from homolog.files.project import ProjectFolder
from homolog_app.window.study_files import StudyRecord

__all__ = ["InterruptedSession", "Journal", "JournalRecord", "find_lost"]

_RECORD, _LOCK, _DRAFT = "journal.json", "lock", "draft"


class JournalRecord(BaseModel):
    """What was open: the project's folder (None for a study never saved), the study, and whether it ran."""

    model_config = ConfigDict(frozen=True)

    folder: Annotated[str, AfterValidator(checked_path)] | None
    study: StudyRecord
    running: bool


class Journal:
    """One window's folder: its lock, its journal, and the draft project of a study that was never saved."""

    def __init__(self, sessions: Path) -> None:
        self._folder = sessions / uuid.uuid4().hex
        self._folder.mkdir(parents=True)
        self._lock = FileLock(self._folder / _LOCK)
        self._lock.acquire(timeout=0)

    @property
    def draft(self) -> ProjectFolder:
        """The project of a study that was never saved."""
        return ProjectFolder(self._folder / _DRAFT)

    def write(self, record: JournalRecord) -> None:
        """Replace the journal."""
        write_text(self._folder / _RECORD, record.model_dump_json())

    def clear_record(self) -> None:
        """Forget what was open: it is saved."""
        (self._folder / _RECORD).unlink(missing_ok=True)

    def clear(self) -> None:
        """Forget what was open, and the draft: it is given up, or saved elsewhere."""
        self.clear_record()
        shutil.rmtree(self.draft.folder, ignore_errors=True)

    def adopt(self, lost: "InterruptedSession") -> None:
        """Take over the draft of a window that is gone."""
        draft = lost.folder / _DRAFT
        if draft.is_dir():
            shutil.rmtree(self.draft.folder, ignore_errors=True)
            draft.replace(self.draft.folder)
        lost.discard()

    def close(self) -> None:
        """Remove everything; the window closed in good order."""
        self._lock.release()
        shutil.rmtree(self._folder, ignore_errors=True)


@dataclass(frozen=True, slots=True)
class InterruptedSession:
    """The journal of a window that is gone."""

    folder: Path
    record: JournalRecord

    @property
    def base(self) -> Path:
        """Where the relative paths of its study start."""
        return Path(self.record.folder) if self.record.folder else self.folder / _DRAFT

    def discard(self) -> None:
        """Delete it."""
        shutil.rmtree(self.folder, ignore_errors=True)


def find_lost(sessions: Path) -> list[InterruptedSession]:
    """Return the journals of windows that are gone, newest first; folders without one are removed.

    A lock tells who is alive: the system lets go of it when a process ends, however it ends.
    """
    journals: list[tuple[float, InterruptedSession]] = []
    for folder in sessions.iterdir() if sessions.is_dir() else ():
        lock = FileLock(folder / _LOCK)
        try:
            lock.acquire(timeout=0)
        except (Timeout, OSError):
            continue
        lock.release()
        path = folder / _RECORD
        try:
            lost = InterruptedSession(folder, JournalRecord.model_validate_json(path.read_bytes()))
            journals.append((path.stat().st_mtime, lost))
        except (OSError, ValidationError):
            shutil.rmtree(folder, ignore_errors=True)
    return [lost for _, lost in sorted(journals, key=lambda entry: -entry[0])]
