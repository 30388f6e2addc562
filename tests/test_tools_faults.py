"""tools/faults.py: a fixed selection of its cases ends as documented; what it looks for, it finds."""

from __future__ import annotations

import importlib
import os
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

TOOLS = Path(__file__).parents[1] / "tools"


@pytest.fixture
def tools(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    monkeypatch.syspath_prepend(TOOLS)
    names = ("cases", "damage", "runner")
    return SimpleNamespace(**{name: importlib.import_module(f"faults.{name}") for name in names})


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="processes are forked")
def test_a_fixed_selection_ends_as_documented() -> None:
    """Every entry with every fault of its files and of what it runs on, but for some of other users' rights."""
    command = [sys.executable, TOOLS / "faults.py", "--cases", "500", "--seed", "7"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-5000:]
    assert "500 cases, 0 failures" in done.stdout


@pytest.mark.skipif(os.name != "posix", reason="processes are forked")
def test_nothing_is_left_after_sigterm(tmp_path: Path) -> None:
    script = (
        "import time; from faults import main\n"
        "main.make_inputs = lambda folder: (print(folder, flush=True), time.sleep(60.0))\n"
        "main.import_all = lambda: None\n"
        "main.main(['--entries', 'line'])"
    )
    environment = {**os.environ, "PYTHONPATH": str(TOOLS), "TMPDIR": str(tmp_path)}
    command = [sys.executable, "-c", script]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
        assert process.stdout is not None
        assert Path(process.stdout.readline().strip()).parent == tmp_path
        process.terminate()
        assert process.wait(30.0) == 128 + signal.SIGTERM
    assert list(tmp_path.iterdir()) == []


def test_a_case_is_every_entry_with_every_fault_in_turn(tools: SimpleNamespace) -> None:
    entries, kinds = tuple(tools.cases.BY_NAME), tools.cases.KINDS
    count = sum(tools.cases.possible(entry, kind) for entry in tools.cases.ENTRIES for kind in kinds)
    cases = [tools.cases.case_of(number, 5, entries, kinds) for number in range(count + 1)]
    assert len({(case.entry, case.fault) for case in cases}) == count
    assert (cases[0].seed, cases[count].seed) == (5, 6)


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".toml", ".json", ".xml"])
def test_damage_changes_the_file_and_is_the_same_again(suffix: str, tools: SimpleNamespace, tmp_path: Path) -> None:
    path = tmp_path / f"one{suffix}"
    text = {".toml": "[a]\nb = 1.5\nc = [1, 2]\n", ".json": '{"a": {"b": 1.5}, "c": [1, 2]}', ".xml": '<a b="1.5"/>'}

    def write() -> bytes:
        if suffix in text:
            path.write_text(text[suffix])
        else:
            table = pd.DataFrame({"t_s": np.arange(50.0), "x": np.arange(50.0) ** 2})
            table.to_csv(path, index=False) if suffix == ".csv" else table.to_parquet(path)
        return path.read_bytes()

    changed = 0
    for name in ("bytes", "values", "structure", "clocks"):
        for seed in range(5):
            sound, ends = write(), []
            for _ in range(2):
                write()
                said = tools.damage.FAULTS[name](path, np.random.default_rng(seed))
                ends.append((said, path.read_bytes()))
            assert ends[0] == ends[1]
            changed += ends[0][1] != sound
    assert changed >= 15


def test_what_a_killed_command_left_goes_with_the_next(tools: SimpleNamespace, tmp_path: Path) -> None:
    done, refused = (tools.runner.End(status, False, 1.0, "", "") for status in (0, 2))
    assert tools.cases._remains(tmp_path, done) is None
    (tmp_path / "out" / ".a.trackfg-x").mkdir(parents=True)
    assert "out/.a.trackfg-x" in tools.cases._remains(tmp_path, done)
    assert tools.cases._remains(tmp_path, refused) is None


def test_ends_that_are_not_documented_are_failures(tools: SimpleNamespace) -> None:
    def wrong(status: int, err: str, out: str = "", *, hung: bool = False) -> str | None:
        end = tools.runner.End(status, hung, 1.0, out, err)
        failure: str | None = tools.cases._wrong("smooth rec -o out", end, tools.runner.Conditions())
        return failure

    assert wrong(0, "") is None
    assert wrong(2, "trackfg: imu.csv: is wrong\n") is None
    assert "traceback" in str(wrong(1, "Traceback (most recent call last):\nValueError: x"))
    assert "lines" in str(wrong(2, "one\ntwo\n"))
    failed = tools.runner.End(
        1, False, 1.0, "", "trackfg: warning: run a failed: x\ntrackfg: warning: run b failed: y\n"
    )
    assert tools.cases._wrong("batch runs.csv -o store", failed, tools.runner.Conditions()) is None
    assert "status -11" in str(wrong(-11, ""))
    assert "control characters" in str(wrong(0, "", "\x1b[31m"))
    assert "no end" in str(wrong(0, "", hung=True))
