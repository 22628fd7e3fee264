"""The words of messages and help: standard terms, and no option of the command line in the core."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
UNIDIOMATIC = re.compile(
    r"\b(anew|mend(ed|s)?|beside|all but|so many|(leave|left|leaves) out|put right|(go|goes) on"
    r"|allow(ed)? for|false alarms?|(?<!there )(is|are) no (?!longer|more))\b"
)
OPTION = re.compile(r"(?<![\w-])--[a-z]")


def sentences(path: Path) -> Iterator[tuple[int, str]]:
    """Yield each text of a file that has two words or more and is no documentation, with its line."""
    tree = ast.parse(path.read_text("utf-8"))
    documentation = {
        id(node.value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    }
    for node in ast.walk(tree):
        text = node.value if isinstance(node, ast.Constant) and id(node) not in documentation else None
        if isinstance(text, str) and " " in text.strip():
            yield node.lineno, text


def found(folders: list[str], pattern: re.Pattern[str]) -> list[str]:
    """Return where a pattern occurs in the texts of some folders."""
    files = sorted(file for folder in folders for file in (ROOT / folder).rglob("*.py"))
    assert files
    return [
        f"{file.relative_to(ROOT)}:{line}: {text}"
        for file in files
        for line, text in sentences(file)
        if pattern.search(text)
    ]


@pytest.mark.parametrize("folder", ["core/homolog", "app/homolog_app"])
def test_messages_use_standard_english(folder):
    assert found([folder], UNIDIOMATIC) == []


def test_messages_of_the_core_name_no_option_of_the_command_line():
    assert found(["core/homolog"], OPTION) == []
