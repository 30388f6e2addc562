"""The documents are true: links lead somewhere, code compiles, the worked example runs, the settings are the code's."""

from __future__ import annotations

import re
import tomllib
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

import trackfg
from trackfg.config import SmoothConfig
from trackfg.fleet.catalogue import Run
from trackfg.fleet.key_figures import failed_row
from trackfg.fleet.store import Store
from trackfg.interchange.exporting.channels import read_template
from trackfg.interchange.importing.mapping import mapping_of

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
NAMES = [str(page.relative_to(ROOT)) for page in PAGES]


def blocks(page: Path, language: str) -> list[str]:
    """The fenced blocks in one language."""
    return re.findall(
        rf"^```{language}(?: \S+)?\n(.*?)^```", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE
    )


def anchors(page: Path) -> set[str]:
    """The headings of a page as GitHub links to them."""
    headings = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_links_lead_somewhere(page: Path) -> None:
    for link in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
        if link.startswith(("http://", "https://")):
            continue
        path, _, anchor = link.partition("#")
        target = page.parent / path if path else page
        assert target.exists(), link
        assert not anchor or anchor in anchors(target), link


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_every_column_of_a_table_has_a_heading(page: Path) -> None:
    """A reader of the screen hears the heading of each cell."""
    lines = page.read_text(encoding="utf-8").splitlines()
    heads = [line for line, below in pairwise(lines) if re.fullmatch(r"\|(?:-+\|)+", below)]
    assert [head for head in heads if any(not cell.strip() for cell in head.strip("|").split("|"))] == []


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_code_is_code(page: Path) -> None:
    for block in blocks(page, "python"):
        compile(block, page.name, "exec")
    for block in blocks(page, "toml"):
        tomllib.loads(block)


def test_the_worked_example_of_adding_a_factor_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its own assertions say what it must find; its picture goes into a folder of its own."""
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for block in blocks(ROOT / "docs" / "adding-a-factor.md", "python"):
        exec(compile(block, "adding-a-factor.md", "exec"), names)
    assert "with_radar" in names


def test_the_example_of_the_graph_runs() -> None:
    """Its own assertions say what it must find."""
    names: dict[str, object] = {}
    for block in blocks(ROOT / "docs" / "graph.md", "python"):
        exec(compile(block, "graph.md", "exec"), names)
    assert "again" in names


def test_the_catalogue_of_a_store_is_read_by_line_and_month(tmp_path: Path) -> None:
    names: dict[str, Any] = {}
    (block,) = blocks(ROOT / "docs" / "fleet.md", "python")
    exec(compile(block, "fleet.md", "exec"), names)
    of_runs = {"wanted": ("7", "2026-06"), "early": ("7", "2026-04"), "undated": ("7", "unknown")}
    of_runs |= {"padded": ("007", "2026-06"), "other": ("8 north/west", "2026-06")}
    rows = [
        {**failed_row(Run(run, f"/recordings/{run}", line), "", ""), "month": month, "slips": 1}
        for run, (line, month) in of_runs.items()
    ]
    Store(tmp_path).write(rows)
    found = names["slipping"](str(tmp_path))
    assert found[["run", "line", "month"]].to_numpy().tolist() == [["wanted", "7", "2026-06"]]


def test_the_recording_from_tables_is_smoothed_and_usable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    for block in blocks(ROOT / "docs" / "recording.md", "python"):
        exec(compile(block, "recording.md", "exec"), names)
    assert names["result"].summary.converged
    assert names["report"].usable
    parts = [trackfg.read_recording(name) for name in ("part1", "part2")]
    assert sum(len(part.imu) for part in parts) == len(names["whole"].imu) + 1  # the row at 30 s is in both


def test_the_worked_example_of_adding_a_sensor_runs() -> None:
    """From the section of recording.toml to the estimated scale; its own assertions say what it must find."""
    names: dict[str, object] = {}
    for block in blocks(ROOT / "docs" / "adding-a-sensor.md", "python"):
        exec(compile(block, "adding-a-sensor.md", "exec"), names)
    assert "SleeperModel" in names


def test_the_mappings_shown_are_accepted() -> None:
    recording, geometry = blocks(ROOT / "docs" / "importing.md", "toml")
    assert len(mapping_of(tomllib.loads(recording), "importing.md").sensors) == 3
    assert mapping_of(tomllib.loads(geometry), "importing.md").geometry is not None


def test_the_template_shown_is_accepted(tmp_path: Path) -> None:
    (block,) = blocks(ROOT / "docs" / "exporting.md", "toml")
    (tmp_path / "t.toml").write_text(block, encoding="utf-8")
    assert len(read_template(tmp_path / "t.toml")) == 4


def test_the_settings_shown_are_accepted() -> None:
    (block,) = blocks(ROOT / "docs" / "command-line.md", "toml")
    SmoothConfig.model_validate(tomllib.loads(block))


def test_the_engine_lists_every_setting_with_its_default() -> None:
    page = (ROOT / "docs" / "engine.md").read_text(encoding="utf-8").split("## Settings")[1]
    rows = re.findall(r"^\| `(\w+\.\w+)` \| [^|]*\| ([^|]+) \| [^|]+ \|$", page, flags=re.MULTILINE)
    listed = {key: tomllib.loads(f"value = {default}")["value"] for key, default in rows}
    assert len(listed) == len(rows)
    defaults = {
        f"{section}.{key}": value
        for section, keys in SmoothConfig().model_dump(mode="json").items()
        for key, value in keys.items()
    }
    assert listed == defaults
