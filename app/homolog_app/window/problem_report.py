"""A report for the developers: settings, versions and the last messages, without anything about patients."""

import os
import platform
import re
import sys
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import homolog
import homolog_app
from homolog_app.window.log_pane import LogMemory
from homolog_app.window.session import Session

__all__ = ["problem_report"]

_PACKAGES = (
    "homolog",
    "numpy",
    "scipy",
    "warp-lang",
    "PySide6-Essentials",
    "pyvista",
    "pyvistaqt",
    "vtk",
    "SimpleITK",
)
_LINES = 200
_ID_LENGTH = 5  # digits that may be somebody's number rather than an age
_OWN = (
    *(Path(str(module.__file__)).parents[1] for module in (homolog, homolog_app)),
    sys.prefix,
    sys.base_prefix,
)
_PATH = re.compile(r"""(?<![\w.<>])(?:/|[A-Za-z]:[\\/])[^\n:"'<>|]*""")  # up to what ends a path in messages


def problem_report(session: Session, memory: LogMemory, details: str = "") -> str:
    """Return the report's text; names of subjects seen in the session, files and groups are replaced."""
    versions = [f"{name} {_version(name)}" for name in _PACKAGES]
    parts = [
        "Homolog problem report",
        f"{platform.platform()}, Python {sys.version.split()[0]}",
        ", ".join(versions),
        f"{len(session.study.members)} subjects, {len(session.study.included)} included, "
        f"{len(session.groomed)} groomed, result: {'yes' if session.result else 'no'}",
        session.study.settings.model_dump_json(),
        details,
        *[line for _, line in list(memory.lines)[-_LINES:]],
    ]
    return _without_names("\n".join(parts), session)


def _without_names(text: str, session: Session) -> str:
    for home in _OWN:
        text = text.replace(f"{home}{os.sep}", "")
    secrets = {secret: word for secret, word in _secrets(session) if len(secret) > 1}
    for secret in sorted(secrets, key=len, reverse=True):
        text = text.replace(secret, secrets[secret])
    return _PATH.sub("PATH", text)


def _secrets(session: Session) -> Iterator[tuple[str, str]]:
    """Yield everything that could tell who somebody is, with what to say instead."""
    yield str(Path.home()), "HOME"
    if session.folder:
        yield str(session.folder), "PROJECT"
    numbers: dict[Path, int] = {}
    for subject in session.seen.values():
        number = numbers.setdefault(subject.path, len(numbers) + 1)
        yield str(subject.path), f"FILE-{number}"
        yield str(subject.path.parent), "FOLDER"
        yield subject.path.name, f"FILE-{number}"
        yield subject.name, f"SUBJECT-{number}"
        for value in (subject.group, *subject.columns.values()):
            if value and (len(value) >= _ID_LENGTH or not value.replace(".", "").isdigit()):
                yield value, "VALUE"


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "from a source checkout"
