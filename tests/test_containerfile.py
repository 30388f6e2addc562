"""The container's recipe holds what it says: it installs what is packaged, and its commands do not run as root."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
RECIPE = (ROOT / "Containerfile").read_text()
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())


def test_python_and_extras_are_those_of_the_package() -> None:
    pythons = set(re.findall(r"^FROM \S+/python:([\d.]+)-slim", RECIPE, re.MULTILINE))
    assert len(pythons) == 1
    assert f"Programming Language :: Python :: {pythons.pop()}" in PROJECT["project"]["classifiers"]
    extras = set(re.findall(r"/source\[(\w+)\]", RECIPE))
    assert extras <= set(PROJECT["project"]["optional-dependencies"])
    assert extras


def test_commands_do_not_run_as_root() -> None:
    final = RECIPE.rpartition("\nFROM ")[2]
    users = re.findall(r"^USER (\d+)$", final, re.MULTILINE)
    assert users
    assert "0" not in users


def test_what_is_built_is_copied_and_nothing_else() -> None:
    lines = [line for line in (ROOT / ".dockerignore").read_text().splitlines() if not line.startswith("#")]
    kept = {line.removeprefix("!") for line in lines if line.startswith("!")}
    folders = PROJECT["tool"]["setuptools"]["package-dir"].values()
    assert lines[0] == "*"
    assert kept == {"pyproject.toml", "setup.py", "kernels", *folders, *("README.md", "LICENSE")}
