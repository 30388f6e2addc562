"""Every documented command of tools/ is there and explains itself; every deliberate error is still in its place."""

from __future__ import annotations

import importlib
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[1]
TOOLS = ROOT / "tools"
COMMANDS = sorted(path.name for path in TOOLS.glob("*.py") if "__main__" in path.read_text())


def test_documented_commands_are_there() -> None:
    pages = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    documented = {name for page in pages for name in re.findall(r"python tools/(\w+\.py)", page.read_text())}
    assert documented
    assert documented <= set(COMMANDS)


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_explains_itself(command: str) -> None:
    done = subprocess.run([sys.executable, TOOLS / command, "--help"], capture_output=True, text=True, check=True)
    assert done.stdout.startswith(f"usage: {command}")


@pytest.fixture
def mutations(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(TOOLS)
    return importlib.import_module("mutations.main")


def test_every_mutation_stands_once_in_its_file(mutations: ModuleType) -> None:
    assert list(mutations.faults(ROOT, mutations.PARTS)) == []
    assert sum(len(part.mutations) for part in mutations.PARTS) >= 60


def test_a_fragment_that_moved_is_named(mutations: ModuleType, tmp_path: Path) -> None:
    (tmp_path / "one.py").write_text("a = b + c\nd = b + c\n")
    (tmp_path / "test_one.py").touch()
    wrong = [mutations.Mutation("twice", (("b + c", "b - c"),)), mutations.Mutation("gone", (("b * c", "b / c"),))]
    part = mutations.Part("one.py", ("test_one.py",), tuple(wrong))
    twice, gone = mutations.faults(tmp_path, [part])
    assert twice.startswith("one.py: 'b + c' is there 2 times, expected once (twice)")
    assert gone.startswith("one.py: 'b * c' is there 0 times")


def test_a_mutation_is_put_in_and_taken_out_again(mutations: ModuleType, tmp_path: Path) -> None:
    file = tmp_path / "one.py"
    file.write_text("a = b + c\n")
    with mutations._mutated(file, mutations.Mutation("sign", (("b + c", "b - c"),))):
        assert file.read_text() == "a = b - c\n"
    assert file.read_text() == "a = b + c\n"
