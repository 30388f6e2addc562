"""The comparison of two versions' speeds: what is run when, and what counts as a loss."""

from __future__ import annotations

import importlib
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

TOOLS = Path(__file__).parents[1] / "tools"


@pytest.fixture
def paired(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(TOOLS)
    return importlib.import_module("speed.paired")


def test_each_is_the_first_of_every_other_pair(paired: ModuleType) -> None:
    order: list[str] = []

    def run(name: str) -> tuple[float, float, float]:
        order.append(name)
        return 1.0, 2.0 if name == "before" else 3.0, 1.0

    uses = paired.in_pairs(lambda: run("before"), lambda: run("after"), 3)
    assert order == ["before", "after", "after", "before", "before", "after"]
    assert uses == [((1.0, 2.0, 1.0), (1.0, 3.0, 1.0))] * 3


def test_growth_is_that_of_pairs_and_not_of_what_else_the_machine_does(paired: ModuleType) -> None:
    """Each pair ran on a machine twice as busy as the one before; one run of the seven was disturbed by itself."""
    uses = [((1.0, 2.0 * 2**i, 0.5), (9.0, 2.1 * 2**i, 0.6)) for i in range(6)]
    uses.append(((1.0, 2.0, 0.5), (1.0, 50.0, 0.6)))
    assert paired.growth(uses) == pytest.approx({"CPU time": 1.05, "peak memory": 1.2})


def test_a_process_imports_from_the_folder_that_is_given(tmp_path: Path) -> None:
    """Measured by a small process: a peak is at least that of the parent, and these tests may have held gigabytes."""
    (tmp_path / "only_there.py").write_text("", encoding="utf-8")
    program = (
        "import sys; from pathlib import Path; sys.path.insert(0, sys.argv[1]); from speed.paired import measured\n"
        "print(*measured([sys.executable, '-c', 'import only_there'], Path(sys.argv[2])))"
    )
    command = [sys.executable, "-c", program, TOOLS, tmp_path]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    wall_s, cpu_s, peak_gb = map(float, done.stdout.split())
    assert cpu_s > 0.0
    assert wall_s > 0.0
    assert 0.0 < peak_gb < 1.0
