"""A report for the developers: settings, versions and the last messages, without anything about patients."""

import platform
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

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


def problem_report(session: Session, memory: LogMemory, details: str = "") -> str:
    """Return the report's text; names of subjects, files, folders and groups are replaced."""
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
    secrets: dict[str, str] = {}
    for number, one in enumerate(session.study.members, start=1):
        secrets[str(one.subject.path)] = f"FILE-{number}"
        secrets[str(one.subject.path.parent)] = "FOLDER"
        secrets[one.subject.path.name] = f"FILE-{number}"
        secrets[one.name] = f"SUBJECT-{number}"
        for value in (one.subject.group, *one.subject.columns.values()):
            if value and not value.replace(".", "").isdigit():
                secrets[value] = "VALUE"
    if session.folder:
        secrets[str(session.folder)] = "PROJECT"
    secrets[str(Path.home())] = "HOME"
    for secret in sorted(secrets, key=len, reverse=True):
        if len(secret) > 1:
            text = text.replace(secret, secrets[secret])
    return text


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "from a checkout"
