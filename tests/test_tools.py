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
def test_every_command_explains_itself() -> None:
    """All in one interpreter, which imports what they share once."""
    script = (
        "import runpy, sys\n"
        f"sys.path.insert(0, {str(TOOLS)!r})\n"
        "for command in sys.argv[1:]:\n"
        "    sys.argv = [command, '--help']\n"
        "    try:\n"
        f"        runpy.run_path(f'{TOOLS}/{{command}}', run_name='__main__')\n"
        "    except SystemExit as end:\n"
        "        assert not end.code, command\n"
        "    print(end='\\f')\n"
    )
    done = subprocess.run([sys.executable, "-c", script, *COMMANDS], capture_output=True, text=True, check=True)
    for command, said in zip([*COMMANDS, ""], done.stdout.split("\f"), strict=True):
        assert said.startswith(f"usage: {command}" if command else "")


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


@pytest.fixture
def architecture(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(TOOLS)
    return importlib.import_module("architecture")


def test_the_picture_of_the_architecture_is_that_of_the_code() -> None:
    done = subprocess.run([sys.executable, TOOLS / "architecture.py", "--check"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_drawings_are_those_that_the_program_draws() -> None:
    done = subprocess.run([sys.executable, TOOLS / "drawings.py", "--check"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_floors_are_the_longest_way_of_imports(architecture: ModuleType, tmp_path: Path) -> None:
    """a imports b, which imports c late; a imports c too, d for type checkers alone."""
    files = {
        "trackfg/__init__.py": "from trackfg.a import one\n",
        "trackfg/a.py": "from trackfg import c\nfrom trackfg.b.inner import two\n"
        "if TYPE_CHECKING:\n    from trackfg.d import four\n",
        "trackfg/b/__init__.py": "",
        "trackfg/b/inner.py": "def two():\n    import trackfg.c\n",
        "trackfg/c.py": "import gtsam\n",
        "trackfg/d.py": "",
        "factors/__init__.py": "from trackfg.c import three\n",
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    house = architecture.read(tmp_path)
    assert house.floor == {"a": 3, "b": 2, "c": 1, "d": 1, "factors": 2}
    assert set(house.arrows) == {("a", "b"), ("a", "c"), ("b", "c"), ("factors", "c")}
    assert house.direct == {("a", "b"), ("b", "c"), ("factors", "c")}
    assert house.packages == {"b", "factors"}
    assert house.with_gtsam == {"c"}


def test_a_cycle_of_packages_has_no_floors(architecture: ModuleType) -> None:
    one = architecture.Import("trackfg.a.x", "trackfg.b.y")
    arrows = {("a", "b"): (one,), ("b", "a"): (one,)}
    house = architecture.House(("a", "b", "c"), 1, arrows, frozenset("abc"), frozenset())
    with pytest.raises(ValueError, match="a cycle of imports among a, b"):
        _ = house.floor
