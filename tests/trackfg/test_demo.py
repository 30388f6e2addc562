from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest

from trackfg.demo import CONTENT, OUTAGES, run_demo
from trackfg.errors import BadInputError
from trackfg.evaluate import withhold
from trackfg.recording_io import read_recording
from trackfg.results import Result

README = Path(__file__).parents[2] / "README.md"


def test_demo(tmp_path: Path) -> None:
    """The whole story: positions are withheld from the smoother, and it does far better than a straight line."""
    stages: set[str] = set()
    demo = run_demo(tmp_path / "demo", progress=lambda stage, done: stages.add(stage))
    assert {path.name for path in demo.folder.iterdir()} == set(CONTENT)
    gnss = read_recording(demo.folder / "recording").gnss
    assert gnss is not None
    assert len(withhold(gnss, OUTAGES)[1]) == 0
    assert Result.read(demo.folder / "result").summary == demo.result.summary
    assert demo.result.summary.solver.converged
    assert len(demo.outages) == len(OUTAGES) + 1
    every = demo.outages.iloc[-1]
    assert every["positions"] == 150
    assert every["rms_m"] < 3.0
    assert every["straight_rms_m"] > 40.0
    assert stages


def test_other_folders_are_left_alone(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(BadInputError, match="not an earlier demo"):
        run_demo(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_the_example_of_the_front_page_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (example,) = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), flags=re.DOTALL)
    (tmp_path / "example.py").write_text(example)
    monkeypatch.chdir(tmp_path)
    runpy.run_path("example.py")
    assert (tmp_path / "out1" / "trajectory.parquet").exists()
