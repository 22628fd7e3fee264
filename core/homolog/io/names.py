"""File names from subjects' names: portable, unique, and inside their folder."""

import hashlib
import re
from collections.abc import Sequence

__all__ = ["checked_stem", "file_stems"]

_RESERVED = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", re.IGNORECASE)
_LONGEST = 100
_DIGEST = 4  # bytes


def file_stems(names: Sequence[str]) -> list[str]:
    """Return one file name without suffix for each name.

    Letters of any script, digits, ``.``, ``_`` and ``-`` are kept, everything else becomes ``_``. The end of
    a very long name becomes a number of its own. Names that would then be equal on some file system (``a``
    and ``A``) get a number.
    """
    stems: list[str] = []
    taken: set[str] = set()
    for name in names:
        plain = re.sub(r"[^\w.-]", "_", _shortened(name)).strip(".") or "_"
        if _RESERVED.fullmatch(plain) or plain.startswith("-"):
            plain = f"_{plain}"
        stem, number = plain, 1
        while stem.casefold() in taken:
            number += 1
            stem = f"{plain}_{number}"
        taken.add(stem.casefold())
        stems.append(stem)
    return stems


def _shortened(name: str) -> str:
    if len(name) <= _LONGEST:
        return name
    digest = hashlib.blake2b(name.encode(errors="replace"), digest_size=_DIGEST).hexdigest()
    return f"{name[: _LONGEST - len(digest) - 1]}_{digest}"


def checked_stem(text: str) -> str:
    """Return a file name without suffix; raises ValueError if `file_stems` can't produce it."""
    if len(text) > _LONGEST + 20 or not re.fullmatch(r"\w[\w.-]*", text):
        raise ValueError("is not a plain file name")
    return text
