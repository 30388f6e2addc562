"""The reference is whole: everything public has a docstring, and what is public of trackfg has examples that run."""

from __future__ import annotations

import ast
import doctest
import inspect
import re
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

import trackfg
from trackfg.datasets.scenarios import simulate
from trackfg.mapping import build_map
from trackfg.maps import write_map

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("datasets", "factors", "trackfg")
NAMES = [name for name in trackfg.__all__ if name != "__version__"]
NEEDS = {"trackfg.maps": "sqlalchemy", "trackfg.mapping": "sqlalchemy", "trackfg.report": "plotly"}
"""What the examples of a module need beyond the core: the map among them is a GeoPackage."""


def listed() -> dict[str, list[str]]:
    """The names on the page of the reference, by module."""
    page = (ROOT / "docs" / "api" / "index.rst").read_text(encoding="utf-8")
    parts = re.split(r"^\.\. currentmodule:: (\S+)$", page, flags=re.MULTILINE)
    return {
        module: re.findall(r"^   (\w+)$", text, flags=re.MULTILINE)
        for module, text in zip(parts[1::2], parts[2::2], strict=True)
    }


FUNCTIONS = [
    f"{module}.{name}"
    for module, names in listed().items()
    for name in names
    if inspect.isfunction(getattr(import_module(module), name))
]
PUBLIC = list(dict.fromkeys([*(f"trackfg.{name}" for name in NAMES), *FUNCTIONS]))
UNEXEMPLIFIED = {
    "MapConflictError",  # needs two writers
    "MapConventions",  # a part of the map
    "RealRun",  # needs a recording from elsewhere
    "RunInformation",  # a part of the map
}
CLASSES = [
    f"{module}.{name}"
    for module, names in listed().items()
    for name in names
    if inspect.isclass(getattr(import_module(module), name)) and module != "trackfg" and name not in UNEXEMPLIFIED
]


EXAMPLES = ["trackfg", *PUBLIC, *CLASSES]


def public(place: str) -> Any:
    module, _, name = place.rpartition(".")
    return getattr(import_module(module), name) if module else import_module(name)


@cache
def parsed(folder: str) -> dict[str, ast.Module]:
    """The modules of a folder by their paths."""
    paths = sorted((ROOT / folder).rglob("*.py"))
    return {str(path.relative_to(ROOT)): ast.parse(path.read_text(encoding="utf-8")) for path in paths}


def docstrings(tree: ast.AST) -> Iterator[str]:
    """The docstrings of a module and of all that it defines."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            yield ast.get_docstring(node) or ""


def undocumented(tree: ast.AST, place: str) -> Iterator[str]:
    """Public modules, classes, functions and methods without a docstring."""
    if isinstance(tree, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
        accessor = any("setter" in ast.unparse(each) for each in getattr(tree, "decorator_list", ()))
        if not ast.get_docstring(tree) and not accessor:
            yield place
    if isinstance(tree, ast.Module | ast.ClassDef):
        for node in tree.body:
            name = getattr(node, "name", "_")
            if not name.startswith("_"):
                yield from undocumented(node, f"{place}: {name}")


@pytest.mark.parametrize("folder", FOLDERS)
def test_everything_public_has_a_docstring(folder: str) -> None:
    modules = parsed(folder)
    assert modules
    assert [place for name, tree in modules.items() for place in undocumented(tree, name)] == []


def test_what_has_no_docstring_is_named() -> None:
    code = '"""M."""\nclass A:\n    "A."\n    def b(self): ...\n    def _c(self): ...\ndef d(): ...\n'
    assert list(undocumented(ast.parse(code), "m.py")) == ["m.py: A: b", "m.py: d"]


def test_every_example_is_one_that_is_run() -> None:
    run = {inspect.getdoc(public(place)) for place in EXAMPLES}
    texts = (text for folder in FOLDERS for tree in parsed(folder).values() for text in docstrings(tree))
    assert [text.partition("\n")[0] for text in texts if ">>> " in text and text not in run] == []


@pytest.mark.parametrize("place", PUBLIC)
def test_parameters_results_and_errors_have_sections(place: str) -> None:
    text = inspect.getdoc(public(place)) or ""
    sections = re.findall(r"^(\w+)\n-+$", text, flags=re.MULTILINE)
    assert "Examples" in sections
    parameters = list(inspect.signature(public(place)).parameters) if inspect.isfunction(public(place)) else []
    if parameters:
        described = re.search(r"^Parameters\n-+\n(.*?)^\w+\n-+$", text, flags=re.MULTILINE | re.DOTALL)
        assert described
        names = re.findall(r"^(\w[\w, ]*?)(?: : .*)?$", described[1], re.MULTILINE)
        assert [word for line in names for word in line.split(", ")] == parameters


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the recording ``run1`` and its result ``out1``."""
    path = tmp_path_factory.mktemp("examples")
    simulate("mainline", seed=1, duration_s=60.0).write(path / "run1")
    trackfg.smooth(trackfg.read_recording(path / "run1")).write(path / "out1")
    if find_spec("sqlalchemy"):
        write_map(build_map([trackfg.Result.read(path / "out1")], name="line"), path / "line.gpkg", parent=None)
    return path


@pytest.mark.parametrize("place", EXAMPLES)
def test_the_example_of_a_public_name_runs(place: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    module, _, name = place.rpartition(".")
    if name.startswith("plot_"):
        pytest.importorskip("matplotlib")
    pytest.importorskip(NEEDS.get(module, "numpy"))
    monkeypatch.chdir(folder)
    examples = doctest.DocTestFinder(recurse=False).find(public(place), name, globs={})
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
    printed: list[str] = []
    for example in examples:
        runner.run(example, out=printed.append)
    assert runner.tries > 0
    assert not printed, "".join(printed)


def test_the_reference_lists_every_public_name() -> None:
    assert sorted(listed()["trackfg"]) == sorted(NAMES)
    for module, names in listed().items():
        if hasattr(import_module(module), "__all__") and module != "trackfg":
            assert sorted(names) == sorted(import_module(module).__all__), module
