"""The first line of a docstring is a sentence: no preposition or conjunction begins it (docs/style.md)."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

_WORDS = """
    about above across after against along alongside among and around as at before behind below beneath beside besides
    between beyond but by despite down during except for from if in inside into lest like near nor of off on onto or out
    outside over past per since so than that though through throughout till to toward towards under underneath unless
    unlike until unto up upon via whereas while with within without because although also then yet whether
    """

FRAGMENTS = frozenset(_WORDS.split())
"""First words of what is no sentence: prepositions and conjunctions."""

COVERED = ("datasets", "factors", "trackfg")


def docstrings(path: Path) -> Iterator[tuple[int, str]]:
    """Line and text of every docstring of a module, of its classes and its functions."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            text = ast.get_docstring(node)
            if text:
                yield node.body[0].lineno, text


def is_fragment(text: str) -> bool:
    first = re.match(r"[A-Za-z]+", text)
    return first is not None and first.group().lower() in FRAGMENTS


@pytest.mark.parametrize("folder", COVERED)
def test_a_docstring_begins_a_sentence(folder: str) -> None:
    modules = sorted((ROOT / folder).rglob("*.py"))
    assert modules
    wrong = [
        f"{path.relative_to(ROOT)}:{line}: {text.splitlines()[0]}"
        for path in modules
        for line, text in docstrings(path)
        if is_fragment(text)
    ]
    assert wrong == []


@pytest.mark.parametrize(
    ("text", "expected"),
    [("Of a row.", True), ("Whether it is.", True), ("Return the row.", False), ("Format a number.", False)],
)
def test_what_a_fragment_is(text: str, expected: bool) -> None:
    assert is_fragment(text) is expected
