"""README and docs do what they say: every block as printed, in the order printed, by the programs that a user has."""

from __future__ import annotations

import importlib
from pathlib import Path
from types import ModuleType

import pytest

TOOLS = Path(__file__).parents[1] / "tools"
PAGES = sorted(str(page.relative_to(TOOLS.parent)) for page in (TOOLS.parent / "docs").rglob("*.md"))


@pytest.fixture
def walk(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(TOOLS)
    return importlib.import_module("first_hour.walk")


@pytest.fixture(scope="module")
def newcomer(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which README was followed; the other pages go on from there."""
    folder = tmp_path_factory.mktemp("newcomer")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(TOOLS)
        steps = list(importlib.import_module("first_hour.walk").walk(TOOLS.parent / "README.md", folder))
    assert not [step for step in steps if step.failure]
    assert len(steps) >= 17
    return folder


@pytest.mark.slow
def test_readme_works_as_printed(newcomer: Path) -> None:
    assert (newcomer / "out1" / "summary.json").exists()


@pytest.mark.pages
@pytest.mark.parametrize("page", PAGES)
def test_a_page_works_as_printed(page: str, newcomer: Path, walk: ModuleType) -> None:
    assert not [step for step in walk.walk(TOOLS.parent / page, newcomer) if step.failure]


def test_what_is_not_done_is_said(walk: ModuleType) -> None:
    """Few blocks need what a machine may lack, and the commands of these are those that there are."""
    pages = importlib.import_module("first_hour.pages")
    needing = [block for page in pages.pages() for block in pages.blocks(page) if block.needs]
    assert {block.needs for block in needing} <= {
        "a network",
        "a database",
        "a cluster",
        "an hour",
        "ten minutes",
        "dated runs",
        "a line's kilometrage",
        "a log of your own",
    }
    assert len(needing) < 20


def page_of(folder: Path, monkeypatch: pytest.MonkeyPatch, text: str) -> Path:
    monkeypatch.setattr("first_hour.pages.ROOT", folder)
    monkeypatch.setattr("first_hour.walk.ROOT", TOOLS.parent)
    page = folder / "page.md"
    page.write_text(text, encoding="utf-8")
    return page


@pytest.mark.parametrize(
    ("text", "failure"),
    [
        ("```sh\nfalse\n```\n", "exit status 1"),
        ("```sh\ntrackfg smooth run1 --quick\n```\n", "there is no --quick"),
        ("```sh\n# needs a network\ntrackfg smoooth run1\n```\n", "there is no smoooth"),
        ("```text\ntrackfg map draw MAP\n```\n", "there is no draw"),
        ("```python\n1 / 0\n```\n", "ZeroDivisionError"),
        ("```python\n# needs a database\n1 /\n```\n", "invalid syntax"),
        ("```toml\na = \n```\n", "Invalid value"),
        ("```\ntrackfg scenarios\n```\n", "names no language"),
        ("So:\n\n    trackfg scenarios\n\nand\n", "fenced"),
    ],
)
def test_what_does_not_work_is_found(
    text: str, failure: str, walk: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (step,) = walk.walk(page_of(tmp_path, monkeypatch, text), tmp_path)
    assert failure in step.failure


def test_both_names_of_a_switch_are_known(walk: ModuleType) -> None:
    usage = importlib.import_module("first_hour.usage")
    assert usage.wrong_words("trackfg limits OUT --limits NAME [--km|--no-km]") == []
    assert usage.wrong_words("trackfg limits OUT --limits NAME [--km|--not-km]") == ["--not-km"]


def test_blocks_go_on_from_each_other(walk: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    blocks = {
        "csv a.csv": "1,2",
        "sh": "sleep 0.3; cp a.csv b.csv",
        "python": "from pathlib import Path\n\nx = Path('b.csv').read_text()",
        "python ": "assert x == '1,2\\n'",
    }
    text = "\n".join(f"```{language}\n{content}\n```\n" for language, content in blocks.items())
    steps = list(walk.walk(page_of(tmp_path, monkeypatch, text), tmp_path))
    assert [step.failure for step in steps] == [""] * 4
    assert 0.2 < steps[1].silence_s <= steps[1].seconds
