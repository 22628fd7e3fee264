"""How a reader is tried: with good bytes changed at random, watched for what a reader must not do."""

import json
import os
import random
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from homolog.errors import InputError

SLOWEST_S = 5.0  # of processor time: other work on the machine does not count

_WRITING = {
    "os.rename",
    "os.remove",
    "os.mkdir",
    "os.rmdir",
    "os.link",
    "os.symlink",
    "os.truncate",
    "os.chmod",
}
_RUNNING = {
    "pickle.find_class",
    "subprocess.Popen",
    "os.system",
    "os.exec",
    "os.posix_spawn",
    "socket.connect",
}


@dataclass(frozen=True)
class Target:
    """A reader.

    Attributes
    ----------
    file : str
        Name of the file, below the folder that the reader is given.
    good : callable
        Writes good files of the kind into a folder.
    read : callable
        Reads the file of that folder.
    """

    file: str
    good: Callable[[Path], None]
    read: Callable[[Path], object]


def attempt(target: Target, folder: Path, content: bytes) -> str:
    """Let a reader read some bytes; return ``"read"`` or ``"refused"``.

    Raises
    ------
    AssertionError
        If anything but an `InputError` is raised, it takes too long, or it writes outside the folder, runs
        code or opens a connection.
    """
    path = folder / target.file
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    began, outcome = time.process_time(), "read"
    with watched(folder) as done:
        try:
            target.read(folder)
        except InputError as error:
            outcome = "refused" if str(error).strip() else "refused without a word"
    assert outcome != "refused without a word"
    assert time.process_time() - began < SLOWEST_S, "took too long"
    assert not done, f"did what a reader must not: {done}"
    return outcome


_folder: Path | None = None
_done: list[str] = []


@contextmanager
def watched(folder: Path) -> Iterator[list[str]]:
    """Note what is written outside of a folder, and what code is run."""
    global _folder
    _folder = folder.resolve()
    _done.clear()
    try:
        yield _done
    finally:
        _folder = None


def _hear(event: str, arguments: tuple[object, ...]) -> None:
    if _folder is None:
        return
    if event in _RUNNING:
        _done.append(f"{event} {arguments}")
    elif event == "open":
        if _writes(arguments) and not all(map(_allowed, _places(arguments[:1]))):
            _done.append(f"{event} {arguments}")
    elif event in _WRITING and not all(map(_allowed, _places(arguments))):
        _done.append(f"{event} {arguments}")


def _writes(arguments: tuple[object, ...]) -> bool:
    mode, flags = arguments[1], arguments[2]
    return any(letter in str(mode) for letter in "wax+") if mode else bool(int(str(flags)) & 0o1103)


def _places(arguments: tuple[object, ...]) -> list[Path]:
    """Return the paths among an event's arguments; a number after them is the folder that they start from."""
    texts = [
        os.fsdecode(argument) for argument in arguments[:2] if isinstance(argument, str | bytes | os.PathLike)
    ]
    numbers = [argument for argument in arguments[1:] if isinstance(argument, int) and argument > 2]
    base = Path(f"/proc/self/fd/{numbers[0]}").resolve() if numbers else Path()
    return [base / text for text in texts]


def _allowed(place: Path) -> bool:
    assert _folder is not None
    inside = place.resolve().is_relative_to(_folder)
    return inside or str(place) == "/dev/null" or "__pycache__" in place.parts


sys.addaudithook(_hear)

_TOKENS = [
    b"-1", b"0", b"1e999", b"NaN", b"-Infinity", b"18446744073709551616", b"9" * 400, b"null", b"true",
    b"../../../tmp/evil", b"/etc/passwd", b"C:\\evil", b"$(touch evil)", b"=cmd|' /C calc'!A0", b"%s%n",
    b"<script>alert(1)</script>", b'"', b"'", b"{}", b"[]", b",", b"\n", b"\r", b" ", b"\\", b"\x00", b"\xff",
]  # fmt: skip


def mutated(good: bytes, chance: random.Random) -> bytes:
    """Return good bytes with a few things changed: bits, words, pieces cut, doubled or swapped, values."""
    if chance.random() < 0.3 and (changed := _other_json(good, chance)) is not None:
        return changed
    data = bytearray(good)
    for _ in range(chance.choice((1, 1, 2, 4, 16))):
        at = chance.randrange(len(data) + 1)
        size = chance.choice((1, 2, 4, 8, 64, len(data) // 2))
        match chance.randrange(7):
            case 0:
                data[at : at + 1] = bytes([chance.randrange(256)])
            case 1:
                data[at:at] = chance.choice(_TOKENS)
            case 2:
                data[at : at + size] = chance.choice(_TOKENS)
            case 3:
                del data[at : at + size]
            case 4:
                data[at:at] = data[at : at + size]
            case 5:
                data[at : at + 4] = chance.choice((0, 1, 2**31 - 1, 2**32 - 1)).to_bytes(4, "little")
            case _:
                del data[at:]
    return bytes(data)


def _other_json(good: bytes, chance: random.Random) -> bytes | None:
    """Return JSON with one of its values replaced; None if it is none."""
    try:
        tree = json.loads(good)
    except (ValueError, RecursionError):
        return None
    places: list[tuple[object, object]] = []

    def visit(node: object) -> None:
        pairs = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
        for key, value in pairs:
            places.append((node, key))
            visit(value)

    visit(tree)
    if places:
        node, key = chance.choice(places)
        values = (
            None,
            True,
            -1,
            1e308,
            10**400,
            "",
            "../../evil",
            "a\0b",
            "<script>",
            [],
            {},
            [[]] * 3,
            "x" * 10**5,
        )
        node[key] = chance.choice(values)
    return json.dumps(tree).encode()
