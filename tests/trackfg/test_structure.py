"""The layout of the code stays as docs/architecture.md has it; import-linter (`make layers`) holds who imports whom."""

from __future__ import annotations

import ast
import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ROOT_MODULES = {
    "__init__.py",
    "__main__.py",
    "_version.py",
    "config.py",
    "errors.py",
    "lazy_imports.py",
}
MOST_FILES = 20
FOLDERS = sorted(
    folder
    for top in ("trackfg", "factors", "datasets")
    for folder in (ROOT / top, *(ROOT / top).rglob("*"))
    if folder.is_dir() and folder.name != "__pycache__"
)


def test_the_root_holds_what_every_package_uses() -> None:
    assert {path.name for path in (ROOT / "trackfg").glob("*.py")} == ROOT_MODULES


def test_every_package_is_installed() -> None:
    setuptools = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    homes = {home: name for name, home in setuptools["package-dir"].items()}
    with_code = [folder.relative_to(ROOT) for folder in FOLDERS if list(folder.glob("*.py"))]
    names = {".".join((homes[path.parts[0]], *path.parts[1:])) for path in with_code}
    assert names == set(setuptools["packages"]) - {"trackfg.report.template"}


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: str(folder.relative_to(ROOT)))
def test_a_package_has_few_modules(folder: Path) -> None:
    assert len([path for path in folder.glob("*.py") if path.name != "__init__.py"]) <= MOST_FILES


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: str(folder.relative_to(ROOT)))
def test_a_package_says_what_it_is(folder: Path) -> None:
    if list(folder.glob("*.py")):
        assert (folder / "__init__.py").read_text().startswith('"""')


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: str(folder.relative_to(ROOT)))
def test_a_table_of_modules_names_all(folder: Path) -> None:
    page = folder / "__init__.py"
    text = (ast.get_docstring(ast.parse(page.read_text())) or "") if page.exists() else ""
    if re.search(r"^(module|package) {2,}\w", text, re.MULTILINE):
        modules = {
            path.stem for path in [*folder.glob("*.py"), *(path.parent for path in folder.glob("*/__init__.py"))]
        }
        assert sorted(modules - {"__init__", *re.findall(r"``(\w+)``", text)}) == []
