"""docs/project/licences.md names every package that trackfg asks for, with the extra that it is for, and no other."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
NOT_INSTALLED = {"full", "formats", "docs", "release", "dev"}
"""Extras that name other extras, and those of whoever works on trackfg."""


def package(requirement: str) -> str:
    found = re.match(r"[\w.-]+", requirement)
    assert found is not None
    return found[0]


def test_the_list_is_complete() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = {name: asked for name, asked in project["optional-dependencies"].items() if name not in NOT_INSTALLED}
    wanted = {(package(asked), "") for asked in project["dependencies"]}
    wanted |= {(package(asked), name) for name, all_asked in extras.items() for asked in all_asked}
    page = (ROOT / "docs" / "project" / "licences.md").read_text()
    rows = re.findall(r"^\| ([\w.-]+) \| ([^|]+) \| (?:`(\w+)` )?\|$", page, re.MULTILINE)
    listed = {(name, extra) for name, _, extra in rows if name != "package"}
    assert listed == {(name, extra) for name, extra in wanted if name != "trackfg"}
