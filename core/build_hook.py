"""Hook of the build: a wheel that is built in a git checkout names the commit, for ``homolog --version``."""

import subprocess
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class CommitHook(BuildHookInterface[Any]):
    """Adds ``homolog/commit.txt`` to a wheel."""

    PLUGIN_NAME = "custom"

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Write the commit, where there is one; an editable install asks git itself."""
        checkout = Path(__file__).parents[1]
        if version == "editable" or not (checkout / ".git").exists():
            return
        with suppress(OSError, subprocess.CalledProcessError):  # no git on this machine, or not its checkout
            command = ["git", "-C", str(checkout), "rev-parse", "--short", "HEAD"]
            commit = subprocess.run(command, capture_output=True, text=True, check=True).stdout
            path = Path(tempfile.mkdtemp()) / "commit.txt"
            path.write_text(commit, "utf-8")
            build_data["force_include"][str(path)] = "homolog/commit.txt"
