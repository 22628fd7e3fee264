"""Messages and help in standard terms, no option of the command line in the core, and names that say what."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
UNIDIOMATIC = re.compile(
    r"\b(anew|mend(ed|s)?|beside|all but|so many|(leave|left|leaves) out|put right|(go|goes) on"
    r"|allow(ed)? for|false alarms?|(?<!there )(is|are) no (?!longer|more))\b"
)
VAGUE = {"one", "words", "told", "found", "asked"}
"""Names that say nothing of what they stand for; a noun does: subject, page, button, text, request."""
OPTION = re.compile(r"(?<![\w-])--[a-z]")


@cache
def parsed(path: Path) -> ast.Module:
    """Return a file's syntax tree."""
    return ast.parse(path.read_text("utf-8"))


def sentences(path: Path) -> Iterator[tuple[int, str]]:
    """Yield each text of a file that has two words or more and is no documentation, with its line."""
    tree = parsed(path)
    documentation = {
        id(node.value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    }
    for node in ast.walk(tree):
        text = node.value if isinstance(node, ast.Constant) and id(node) not in documentation else None
        if isinstance(text, str) and " " in text.strip():
            yield node.lineno, text


def occurrences(folders: list[str], pattern: re.Pattern[str]) -> list[str]:
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
    assert occurrences([folder], UNIDIOMATIC) == []


def test_messages_of_the_core_name_no_option_of_the_command_line():
    assert occurrences(["core/homolog"], OPTION) == []


def bound_names(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield every name that a module gives to a variable, a parameter, an attribute or a function."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Name | ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.id if isinstance(node, ast.Name) else node.attr
        elif isinstance(node, ast.arg):
            yield node.lineno, node.arg
        elif isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.lineno, node.name


@pytest.mark.parametrize("folder", ["core/homolog", "app/homolog_app"])
def test_names_say_what_they_stand_for(folder):
    files = sorted((ROOT / folder).rglob("*.py"))
    assert files
    vague = [
        f"{file.relative_to(ROOT)}:{line}: {name}"
        for file in files
        for line, name in bound_names(parsed(file))
        if name in VAGUE
    ]
    assert vague == []
