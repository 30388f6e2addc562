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


@pytest.fixture
def page(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(TOOLS)
    return importlib.import_module("speed.page")


def test_what_was_measured_takes_the_place_of_what_was_and_all_else_stays(page: ModuleType) -> None:
    before = (
        "# A\n\n<!-- speed: one -->\n\n1\n\n<!-- speed end -->\n\nB\n\n<!-- speed: two -->\n\n2\n\n<!-- speed end -->\n"
    )
    assert page.filled(before, {"one": "3"}) == before.replace("1", "3")
    assert page.filled(before, {}) == before


def test_a_part_that_has_no_place_is_refused(page: ModuleType) -> None:
    with pytest.raises(ValueError, match="no place on the page for three"):
        page.filled("<!-- speed: one -->\n<!-- speed end -->", {"three": "3"})


def test_the_page_has_a_place_for_all_that_is_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(TOOLS)
    names = importlib.import_module("speed.main").PARTS
    text = (TOOLS.parent / "docs" / "performance.md").read_text(encoding="utf-8")
    importlib.import_module("speed.page").filled(text, dict.fromkeys(names, "-"))


def test_triangles_take_the_operations_of_householder_reflections(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a square matrix of n columns some 4/3 n^3 (Golub and Van Loan, 5.2.2)."""
    monkeypatch.syspath_prepend(TOOLS)
    limits = importlib.import_module("speed.limits")
    assert limits._householder(300.0, 300, 300) == pytest.approx(4.0 / 3.0 * 300.0**3, rel=0.01)
