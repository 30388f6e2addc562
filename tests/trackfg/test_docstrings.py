"""Docstrings and local variables are as docs/style.md has them.

The first line of a docstring is a sentence: no preposition or conjunction begins it. A local variable is a noun.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterable, Iterator
from functools import cache
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

_NO_NOUNS = "after before begun felt found gone here mine own said theirs there told"

NO_NOUNS = frozenset(_NO_NOUNS.split())
"""Names that no local variable has. ``found`` may be a mask, which a comparison makes."""

CHECKED = NO_NOUNS | {"one"}
"""Names of which a module that has none of them needs no further look."""

COVERED = ("datasets", "factors", "trackfg")


@cache
def nodes_in(folder: str) -> dict[Path, list[ast.AST]]:
    """The nodes of every module of a folder."""
    paths = sorted((ROOT / folder).rglob("*.py"))
    return {path: list(ast.walk(ast.parse(path.read_text(encoding="utf-8")))) for path in paths}


def faults_in(folder: str, check: Callable[[list[ast.AST]], Iterable[tuple[int, str]]]) -> list[str]:
    """File, line and text of every fault of a folder's modules."""
    modules = nodes_in(folder)
    assert modules
    return [
        f"{path.relative_to(ROOT)}:{line}: {text}"
        for path, nodes in modules.items()
        for line, text in sorted(check(nodes))
    ]


def fragments(nodes: list[ast.AST]) -> Iterator[tuple[int, str]]:
    """Line and first line of every docstring of a module, of its classes and its functions that is no sentence."""
    for node in nodes:
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            text = ast.get_docstring(node)
            if text and is_fragment(text):
                yield node.body[0].lineno, text.splitlines()[0]


def is_fragment(text: str) -> bool:
    first = re.match(r"[A-Za-z]+", text)
    return first is not None and first.group().lower() in FRAGMENTS


@pytest.mark.parametrize("folder", COVERED)
def test_a_docstring_begins_a_sentence(folder: str) -> None:
    assert faults_in(folder, fragments) == []


@pytest.mark.parametrize(
    ("text", "expected"),
    [("Of a row.", True), ("Whether it is.", True), ("Return the row.", False), ("Format a number.", False)],
)
def test_what_a_fragment_is(text: str, expected: bool) -> None:
    assert is_fragment(text) is expected


def wrong_names(module: list[ast.AST]) -> set[tuple[int, str]]:
    """Line and name of every local variable that no noun names, and of the variable ``one`` of a loop's statements."""
    wrong: set[tuple[int, str]] = set()
    if not any(isinstance(node, ast.Name) and node.id in CHECKED for node in module):
        return wrong
    functions = [node for node in module if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]
    for function in functions:
        nodes = list(ast.walk(function))
        parameters = {node.arg for node in nodes if isinstance(node, ast.arg)}
        compared = [node for node in nodes if isinstance(node, ast.Assign | ast.AnnAssign) and _compares(node.value)]
        masks = {id(node) for statement in compared for node in ast.walk(statement)}
        loops = {id(node) for loop in nodes if isinstance(loop, ast.For) for node in ast.walk(loop.target)}
        for node in nodes:
            if not isinstance(node, ast.Name) or not isinstance(node.ctx, ast.Store) or node.id in parameters:
                continue
            is_mask = node.id == "found" and id(node) in masks
            if (node.id in NO_NOUNS and not is_mask) or (node.id == "one" and id(node) in loops):
                wrong.add((node.lineno, node.id))
    return wrong


def _compares(value: ast.expr | None) -> bool:
    return value is not None and any(isinstance(node, ast.Compare) for node in ast.walk(value))


@pytest.mark.parametrize("folder", [*COVERED, "tools"])
def test_a_local_variable_is_a_noun(folder: str) -> None:
    assert faults_in(folder, wrong_names) == []


@pytest.mark.parametrize(
    ("line", "names"),
    [
        ("found = search(x)", ["found"]),
        ("found = x > 0.0", []),
        ("before, after = x", ["after", "before"]),
        ("for one in x: pass", ["one"]),
        ("y = [one.t for one in x]", []),
        ("fix = x", []),
    ],
)
def test_which_names_are_wrong(line: str, names: list[str]) -> None:
    assert sorted(name for _, name in wrong_names(list(ast.walk(ast.parse(f"def f(x):\n    {line}\n"))))) == names
