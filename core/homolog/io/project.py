"""A project: one folder that can be moved, with everything about a study in it.

::

    project.json              cohort, settings, and the record of the result
    groomed/                  surfaces in the coordinates of their files
    registrations.npz         registrations of the surfaces to each other
    particles/                NAME_local.particles, NAME_world.particles
    particles.npy             all of them in one array; particles.json: of which files
    model/                    mean, modes, scores, eigenvalues
    energies.csv              terms of the objective during the run
    figures/                  pictures
    checkpoint.npz            only while a run is unfinished
    geodesics/                likewise: geodesic tables
    fits/                     likewise: particles of the core set, and fits to it

A new result is written into ``.next/`` and takes the place of the old one when it is complete, so that at
every moment, also after a crash, one whole result can be read.
"""

import getpass
import json
import os
import platform
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from filelock import FileLock, Timeout
from pydantic import ValidationError

from homolog.cohort import Cohort, Subject, is_series, structures_in, structures_named
from homolog.errors import InputError, InUseError
from homolog.io.atomic import is_stale_temp, report_os_errors, write_text
from homolog.io.names import file_stems
from homolog.io.records import FORMAT_VERSION, ProjectRecord, SubjectRecord

__all__ = ["OUT_OF_DATE", "ProjectFolder", "subject_of"]

_RECORD = "project.json"
_NEXT = ".next"
_LOCK, _HOLDER = ".lock", ".holder"
OUT_OF_DATE = "OUT_OF_DATE.txt"
"""Marks a folder of statistics whose tables belong to an earlier result."""
_OUT_OF_DATE_TEXT = (
    "The tables in this folder belong to an earlier result: particles have been placed again since.\n"
    "Run the same analysis, or write the report, to compute them again.\n"
)
_COMPLETE = "complete"
_WRITTEN = (
    "groomed",
    "geodesics",
    "fits",
    "particles",
    "model",
    "figures",
    "analysis",
    "report",
    "seeds",
    "structures",
    _NEXT,
)
"""Folders that Homolog writes into."""


@dataclass(frozen=True, slots=True)
class ProjectFolder:
    """A project folder. Holds no data itself: `read` and `write` go to the disk."""

    folder: Path

    @property
    def groomed(self) -> Path:
        """Folder of the groomed surfaces."""
        return self.folder / "groomed"

    @property
    def registrations(self) -> Path:
        """Registrations of the groomed surfaces to each other."""
        return self.folder / "registrations.npz"

    @property
    def particles(self) -> Path:
        """Folder of the particles."""
        return self.folder / "particles"

    @property
    def model(self) -> Path:
        """Folder of the shape model."""
        return self.folder / "model"

    @property
    def figures(self) -> Path:
        """Folder of the pictures."""
        return self.folder / "figures"

    def structure(self, name: str) -> "ProjectFolder":
        """Return the project of one of several structures, within this one."""
        return ProjectFolder(self.folder / "structures" / file_stems([name])[0])

    @property
    def checkpoint(self) -> Path:
        """State of an unfinished run."""
        return self.folder / "checkpoint.npz"

    @property
    def geodesics(self) -> Path:
        """Folder of an unfinished run's geodesic tables."""
        return self.folder / "geodesics"

    @property
    def fits(self) -> Path:
        """Folder of an unfinished run's fits to a core set."""
        return self.folder / "fits"

    @property
    def exists(self) -> bool:
        """Whether the folder holds a project."""
        return (self.folder / _RECORD).is_file()

    @property
    def is_held(self) -> bool:
        """Whether this program has it locked."""
        return self._lock.is_locked

    @property
    def _lock(self) -> FileLock:
        return FileLock(self.folder.resolve() / _LOCK, timeout=0, is_singleton=True, thread_local=False)

    def check_is_free(self) -> None:
        """Raise InputError if the folder contains anything but a project, or groomed subjects for one."""
        if (
            self.folder.is_dir()
            and not self.exists
            and not all(self._is_replaceable(path) for path in self.folder.iterdir())
        ):
            raise InputError(
                f"{self.folder}: contains other files; choose a new or empty folder for the project"
            )

    def _is_replaceable(self, path: Path) -> bool:
        """Whether a project may take over a file or folder: locks, groomed subjects, and registrations."""
        if path == self.groomed and path.is_dir():
            files = [file for file in path.iterdir() if not is_stale_temp(file.name)]
            kinds = {kind: {file.stem for file in files if file.suffix == kind} for kind in (".npz", ".vtp")}
            are_pairs = kinds[".npz"] <= kinds[".vtp"] and bool(kinds[".npz"] or not files)
            return are_pairs and all(file.suffix in kinds and file.is_file() for file in files)
        return path == self.registrations or path.name in (_LOCK, _HOLDER)

    def read(self) -> ProjectRecord:
        """Read project.json.

        Raises
        ------
        InputError
            If the folder is no project, its file is damaged, or a newer Homolog wrote it.
        """
        path = self.folder / _RECORD
        if not self.exists:
            raise self._missing
        try:
            content = json.loads(path.read_bytes())
            newer = isinstance(content, dict) and content.get("version")
            if isinstance(newer, int) and newer > FORMAT_VERSION:
                raise InputError(
                    f"{path}: was written by a newer Homolog (format {newer}); update Homolog to open it"
                )
            return ProjectRecord.model_validate(content)
        except InputError:
            raise
        except ValidationError as error:
            first = error.errors()[0]
            where = ".".join(map(str, first["loc"])) or "the file"
            raise InputError(
                f"{path}: is damaged: {where}: {first['msg']}; restore it from a backup"
            ) from error
        except (OSError, ValueError, RecursionError) as error:
            raise InputError(f"{path}: is damaged: {error}; restore it from a backup") from error

    def write(self, record: ProjectRecord) -> None:
        """Replace project.json; raises InputError if the folder can't be written to."""
        write_text(self.folder / _RECORD, record.model_dump_json(indent=2) + "\n")

    def cohort(self) -> Cohort:
        """Return the project's cohort, with paths relative to the project's present location."""
        return Cohort(tuple(subject_of(item, self.folder) for item in self.read().subjects), self.folder)

    def describe(self, cohort: Cohort) -> list[SubjectRecord]:
        """Return the cohort for project.json, with paths relative to the project's folder."""
        return [
            SubjectRecord(
                name=subject.name,
                path=_relative(subject.path, self.folder),
                structures={name: _relative(file, self.folder) for name, file in subject.structures.items()},
                group=subject.group,
                columns=dict(subject.columns),
                landmarks=_relative(subject.landmarks, self.folder) if subject.landmarks else None,
                image=_relative(subject.image, self.folder) if subject.image else None,
            )
            for subject in cohort.subjects
        ]

    @contextmanager
    def locked(self, *, new: bool = True) -> Iterator[None]:
        """Lock the project against other programs, and clean up after a crash.

        The lock ends with its process, however that ends. A program may take it again while it has it, in any
        thread, so that a window can hold what it has open.

        Parameters
        ----------
        new : bool
            Whether the folder may be no project yet; it is made if it is none.

        Raises
        ------
        InUseError
            If another program has it open; the message says which.
        InputError
            If there is no project, the folder can't be made or written to, or a link in it leads elsewhere.
        """
        if not (new or self.exists or self._is_swapping):
            raise self._missing
        with report_os_errors(self.folder):
            self.folder.mkdir(parents=True, exist_ok=True)
            lock, holder = self._lock, self.folder.resolve() / _HOLDER
            try:
                lock.acquire()
            except Timeout as error:
                message = f"{self.folder}: is in use by another Homolog{_read_holder(holder)}"
                raise InUseError(f"{message}; close that one or wait") from error
        try:
            if lock.lock_counter == 1:
                with suppress(OSError):  # a courtesy to others
                    holder.write_text(_this_process(), encoding="utf-8")
                self._tidy()
                self._swap()
            yield
        finally:
            if lock.lock_counter == 1:
                with suppress(OSError):
                    holder.unlink()
            lock.release()

    def _tidy(self) -> None:
        """Refuse links to other folders, and remove temporary files of killed programs."""
        for place, below, files in os.walk(self.folder):
            folder = Path(place)
            if folder == self.folder:
                below[:] = [name for name in below if name in _WRITTEN]
            for name in below:
                link = folder / name
                if link.is_symlink():
                    raise InputError(f"{link}: is a link that may lead elsewhere; put a folder in its place")
            for name in filter(is_stale_temp, files):
                (folder / name).unlink(missing_ok=True)

    def recover(self) -> None:
        """Complete the replacement of a result after a crash; does nothing otherwise."""
        if self._is_swapping:
            with self.locked():
                pass

    @property
    def _is_swapping(self) -> bool:
        return (self.folder / _NEXT / _COMPLETE).is_file()

    @property
    def _missing(self) -> InputError:
        return InputError(f"{self.folder}: is not a project (it contains no {_RECORD})")

    @contextmanager
    def replacing_result(self) -> Iterator["ProjectFolder"]:
        """Yield an empty project folder for a new result, which replaces the old one after the block.

        The block writes project.json and everything else of the result. To be used inside `locked`.
        """
        following = ProjectFolder(self.folder / _NEXT)
        shutil.rmtree(following.folder, ignore_errors=True)
        try:
            with report_os_errors(following.folder):
                for folder in (following.particles, following.model, following.figures):
                    folder.mkdir(parents=True)
            yield following
            write_text(following.folder / _COMPLETE, "")
        except BaseException:
            shutil.rmtree(following.folder, ignore_errors=True)
            raise
        self._swap()

    def _swap(self) -> None:
        """Move a complete new result into place; can be interrupted and repeated at any point."""
        following = self.folder / _NEXT
        if not (following / _COMPLETE).is_file():
            shutil.rmtree(following, ignore_errors=True)
            return
        with report_os_errors(self.folder):
            for entry in sorted(following.iterdir()):
                target = self.folder / entry.name
                if entry.name == _COMPLETE:
                    continue
                if target.is_dir():
                    shutil.rmtree(target)
                entry.replace(target)
            self._mark_analyses()
            shutil.rmtree(following)

    def _mark_analyses(self) -> None:
        """Mark each folder of statistics as belonging to an earlier result."""
        for folder in sorted((self.folder / "analysis").glob("*/")):
            write_text(folder / OUT_OF_DATE, _OUT_OF_DATE_TEXT)


def _relative(path: Path, folder: Path) -> str:
    """Return the path of the file relative to the folder, or the absolute path on another drive."""
    try:
        return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()
    except ValueError:
        return path.resolve().as_posix()


def _this_process() -> str:
    """Return a description of this process for other programs."""
    try:
        user = f" of {getpass.getuser()}"
    except (OSError, KeyError, ImportError):  # the system knows no name
        user = ""
    return f"process {os.getpid()}{user} on {platform.node()}"


def _read_holder(path: Path) -> str:
    """Return a description of the process that has a project open, in parentheses, if known."""
    try:
        text = path.read_text(encoding="utf-8")[:200].strip()
    except (OSError, UnicodeDecodeError):
        return ""
    return f" ({text})" if text and text.isprintable() else ""


def subject_of(record: SubjectRecord, folder: Path) -> Subject:
    """Return a subject of the disk, whose paths are relative to a folder."""
    path = (folder / record.path).resolve()
    files = {name: (folder / text).resolve() for name, text in record.structures.items()}
    return Subject(
        record.name,
        path,
        record.group,
        record.columns,
        (folder / record.landmarks).resolve() if record.landmarks else None,
        (folder / record.image).resolve() if record.image else None,
        files or _structures_before(path),
    )


def _structures_before(path: Path) -> dict[str, Path]:
    """Return the files of a subject of version 0.2, which stored only their folder, or ``FOLDER/NAME``."""
    if path.is_dir():
        return {} if is_series(path) else structures_in(path)
    return {} if path.exists() else structures_named(path)
