from __future__ import annotations

from pathlib import Path

import pytest

from trackfg.cli import demo as story
from trackfg.cli.demo import CONTENT, run_demo
from trackfg.comparison.table import Comparison
from trackfg.errors import BadInputError
from trackfg.results.result import Result


@pytest.mark.slow
def test_demo(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The whole story, on half of its recording: the smoother does better than the published systems."""
    monkeypatch.setattr(story, "DURATION_S", 300.0)
    done: list[float] = []
    demo = run_demo(tmp_path / "demo", progress=lambda stage, share: done.append(share))
    assert {path.name for path in demo.folder.iterdir()} == set(CONTENT)
    assert Result.read(demo.folder / "result").summary == demo.result.summary
    assert demo.result.summary.solver.converged
    assert Comparison.read(demo.folder / "comparison").about == demo.comparison.about
    rows = {(row.quantity, row.estimator): row for row in demo.comparison.about.rows if row.from_kmh is None}
    for quantity, other in (("versine_level_mm", "mid-chord"), ("along_track_m", "composite"), ("roll_mrad", "gyro")):
        ratio = rows[quantity, other].to_smoother
        assert ratio is not None
        assert ratio > 1.5
    assert done == sorted(done)
    for page in ("result.html", "comparison.html"):
        assert "</html>" in (demo.folder / page).read_text(encoding="utf-8")[-100:]


def test_other_folders_are_left_alone(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(BadInputError, match="not an earlier demo"):
        run_demo(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]
