"""The words of CONTRIBUTING.md: what its table replaces is in no name, docstring or message of a finding."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
SOURCE = ROOT / "src" / "skyproof"
SOURCES = {"IS", "RINEX", "K&H", "Groves", "Kay", "VT"}
DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


@cache
def read_table() -> list[list[str]]:
    """Read the rows of the table of words: word, meaning, source, replaced words."""
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").split("\n## Words\n")[1].split("\n## ")[0]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line.startswith("|")]
    return rows[2:]


@cache
def list_replaced() -> dict[str, str]:
    """List the replaced words, each with the word to write."""
    return {old.strip(): new for new, _, _, replaced in read_table() for old in replaced.split(",")}


def split_name(name: str) -> str:
    """Split a name into its words: `flownOn` and `flown_on` are "flown on"."""
    return " ".join(re.findall(r"[A-Z]?[a-z0-9]+|[A-Z]+(?![a-z])", name)).lower()


def list_names(node: ast.AST) -> Iterator[str]:
    """List the names that a node of a syntax tree gives to something."""
    if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
        yield node.name
    elif isinstance(node, ast.arg):
        yield node.arg
    elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
        yield node.id
    elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
        yield node.attr


def list_texts(source: str, *, messages: bool) -> Iterator[tuple[int, str]]:
    """List names and docstrings of a module, and with `messages` all its strings, each with its line."""
    for node in ast.walk(ast.parse(source)):
        line = getattr(node, "lineno", 1)
        for name in list_names(node):
            yield line, split_name(name)
        if isinstance(node, DOCUMENTED):
            yield line, ast.get_docstring(node) or ""
        elif messages and isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield line, node.value


def find_replaced(source: str, *, messages: bool = False) -> list[tuple[int, str]]:
    """Find the lines of a module with a replaced word, and the word."""
    alternatives = "|".join(sorted(map(re.escape, list_replaced()), key=len, reverse=True))
    pattern = re.compile(rf"\b({alternatives})\b")
    texts = ((line, " ".join(text.lower().split())) for line, text in list_texts(source, messages=messages))
    return [(line, found) for line, text in texts for found in pattern.findall(text)]


def test_no_replaced_word_is_in_the_source():
    faults = [
        f"{path.relative_to(SOURCE)}:{line}: {old}: write {list_replaced()[old]}"
        for path in sorted(SOURCE.rglob("*.py"))
        for line, old in find_replaced(path.read_text(encoding="utf-8"), messages=path.parent.name == "explain")
    ]
    assert faults == []


def test_the_table_has_at_most_sixty_words_with_their_source():
    rows = read_table()
    assert len(rows) <= 60
    assert {source for _, _, source, _ in rows} <= SOURCES
    assert all(word and meaning and replaced for word, meaning, _, replaced in rows)
    assert len(list_replaced()) == sum(len(row[3].split(",")) for row in rows)


@pytest.mark.parametrize(
    ("source", "messages"),
    [
        ("def flown_on(): pass", False),
        ("class Newcomer: pass", False),
        ("def f(seldom): pass", False),
        ("anew = 1", False),
        ('"""What is\nleft of it."""', False),
        ('S = "{receiver} says nothing"', True),
    ],
)
def test_a_replaced_word_is_found_wherever_it_stands(source, messages):
    assert find_replaced(source, messages=messages)
