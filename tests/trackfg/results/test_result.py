from __future__ import annotations

import json
import os
import subprocess
import sys
import textwrap
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from pydantic import ValidationError

from trackfg.errors import BadInputError
from trackfg.files import atomic_folder
from trackfg.results.columns import RAIL_COLUMNS, TRAJECTORY_COLUMNS
from trackfg.results.place_covariance import PlaceCovariance
from trackfg.results.result import FILES, RESULT_FOLDER, Result
from trackfg.results.summary import Estimate, GeometryConventions

Make = Callable[..., Result]


def assert_same(a: Result, b: Result) -> None:
    pd.testing.assert_frame_equal(a.trajectory, b.trajectory)
    pd.testing.assert_frame_equal(a.geometry, b.geometry)
    pd.testing.assert_frame_equal(a.events, b.events, check_dtype=False)
    assert a.summary == b.summary


def hidden(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir() if path.name.startswith(".")]


@pytest.fixture
def no_exchange(monkeypatch: pytest.MonkeyPatch) -> None:
    """A file system that cannot swap two names."""

    def refuse(a: Path, b: Path) -> None:
        raise OSError(22, "Invalid argument")

    monkeypatch.setattr(atomic_folder, "_exchange", refuse)


def test_contract_columns() -> None:
    assert TRAJECTORY_COLUMNS[:3] == ("t_s", "chainage_m", "chainage_m_sd")
    assert len(TRAJECTORY_COLUMNS) == 1 + 2 * 8


def test_what_is_written_is_read(make_result: Make, tmp_path: Path) -> None:
    result = make_result()
    folder = result.write(tmp_path / "parents" / "are made" / "out")
    assert {path.name for path in folder.iterdir()} == set(FILES)
    assert_same(Result.read(folder), result)


def test_the_joint_covariance_is_read_as_written(make_result: Make, tmp_path: Path) -> None:
    places = np.array([12.25, 250.0, 1e5])
    matrix = np.diag(np.arange(1.0, 7.0)) + 0.5
    result = replace(make_result(), covariance=PlaceCovariance.of(places, matrix))
    result.write(tmp_path / "out")
    back = Result.read(tmp_path / "out").covariance
    np.testing.assert_array_equal(back.chainage_m, places)
    np.testing.assert_array_equal(back.matrix, matrix)
    table = pd.read_parquet(tmp_path / "out" / "covariance.parquet")
    assert table["cross_level_mm@250"][0] == 0.5


def test_geometry_file_says_what_its_columns_mean(make_result: Make, tmp_path: Path) -> None:
    """So that the file can be passed on by itself: conventions under the key "trackfg", pandas' own beside them."""
    result = make_result()
    folder = result.write(tmp_path / "out")
    metadata = pq.read_schema(folder / "geometry.parquet").metadata
    assert GeometryConventions.model_validate_json(metadata[b"trackfg"]) == result.summary.geometry
    assert json.loads(metadata[b"trackfg"])["facing"] == "increasing chainage"
    assert b"pandas" in metadata
    pd.testing.assert_frame_equal(pd.read_parquet(folder / "geometry.parquet"), result.geometry)


def test_rails_are_either_there_or_not(make_result: Make, tmp_path: Path) -> None:
    result = make_result()
    assert not result.has_rails
    with_rails = result.geometry.assign(**dict.fromkeys(RAIL_COLUMNS, 1.0))
    back = Result.read(Result(result.trajectory, with_rails, result.events, result.summary).write(tmp_path / "out"))
    assert back.has_rails
    pd.testing.assert_frame_equal(back.geometry, with_rails)
    for wrong in (with_rails.drop(columns=RAIL_COLUMNS[-1]), result.geometry.drop(columns="twist_mm_sd")):
        with pytest.raises(ValueError, match="expected"):
            Result(result.trajectory, wrong, result.events, result.summary)


def test_no_events(make_result: Make, tmp_path: Path) -> None:
    result = make_result()
    empty = Result(result.trajectory, result.geometry, result.events.iloc[:0], result.summary)
    back = Result.read(empty.write(tmp_path / "out"))
    assert len(back.events) == 0
    assert back.events["start_s"].dtype == np.float64


def test_files_are_what_other_tools_expect(make_result: Make, tmp_path: Path) -> None:
    folder = make_result().write(tmp_path / "out")
    assert tuple(pd.read_parquet(folder / "trajectory.parquet").columns) == TRAJECTORY_COLUMNS
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["format"] == "trackfg-result/1"
    assert summary["wheel_scale"] == {"value": 1.0021, "sd": 0.0003}
    assert summary["clock_offset_s"] is None
    assert summary["versions"].keys() >= {"trackfg", "gtsam", "python"}
    assert (folder / "events.csv").read_text().splitlines()[1] == "standstill,0.0,12.5,0.0,0.01,,,"


def test_wrong_columns_are_refused(make_result: Make) -> None:
    result = make_result()
    with pytest.raises(ValueError, match="expected"):
        Result(result.trajectory.drop(columns="up_m"), result.geometry, result.events, result.summary)


def test_a_sigma_that_is_not_a_number_is_refused() -> None:
    with pytest.raises(ValidationError):
        Estimate(value=1.0, sd=float("nan"))


@pytest.mark.parametrize("fallback", [False, True])
def test_an_earlier_result_is_replaced(
    make_result: Make, tmp_path: Path, fallback: bool, request: pytest.FixtureRequest
) -> None:
    if fallback:
        request.getfixturevalue("no_exchange")
    make_result(rows=20).write(tmp_path / "out")
    new = make_result(rows=30)
    new.write(tmp_path / "out")
    assert_same(Result.read(tmp_path / "out"), new)
    assert hidden(tmp_path) == []


def test_a_result_of_another_version_may_be_replaced(make_result: Make, tmp_path: Path) -> None:
    folder = make_result().write(tmp_path / "out")
    (folder / "summary.json").write_text('{"format": "trackfg-result/7", "other": 1}')
    make_result().write(folder)
    assert Result.read(folder).summary.recording_id == "made-up"


def test_an_empty_folder_may_be_used(make_result: Make, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    make_result().write(tmp_path / "out")
    assert_same(Result.read(tmp_path / "out"), make_result())


def test_through_a_symbolic_link(make_result: Make, tmp_path: Path) -> None:
    make_result(rows=20).write(tmp_path / "real")
    (tmp_path / "link").symlink_to(tmp_path / "real")
    make_result(rows=30).write(tmp_path / "link")
    assert (tmp_path / "link").is_symlink()
    assert len(Result.read(tmp_path / "real").trajectory) == 30


def test_other_folders_are_left_alone(make_result: Make, tmp_path: Path) -> None:
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "chapter.txt").write_text("years of work")
    with pytest.raises(BadInputError, match="not a trackfg result"):
        make_result().write(tmp_path / "thesis")
    with pytest.raises(BadInputError, match="is a file"):
        make_result().write(tmp_path / "thesis" / "chapter.txt")
    assert (tmp_path / "thesis" / "chapter.txt").read_text() == "years of work"


def test_own_files_in_a_result_are_not_lost(make_result: Make, tmp_path: Path) -> None:
    folder = make_result().write(tmp_path / "out")
    (folder / "notes.txt").write_text("mine")
    with pytest.raises(BadInputError, match=r"notes\.txt"):
        RESULT_FOLDER.refuse_foreign(folder)
    with pytest.raises(BadInputError, match=r"notes\.txt"):
        make_result().write(folder)
    assert (folder / "notes.txt").read_text() == "mine"


def test_an_interrupted_write_leaves_the_old_result(make_result: Make, tmp_path: Path) -> None:
    folder = make_result(rows=20).write(tmp_path / "out")

    def interrupted() -> None:
        with atomic_folder.replaced_folder(folder) as new:
            (new / "summary.json").write_text("{}")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert len(Result.read(folder).trajectory) == 20
    assert hidden(tmp_path) == []


def test_interrupted_where_names_cannot_be_swapped(
    make_result: Make, tmp_path: Path, no_exchange: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = make_result(rows=20).write(tmp_path / "out")
    rename = Path.rename

    def interrupted_after_moving_away(self: Path, target: Path) -> Path:
        moved = rename(self, target)
        if Path(target).name == "old":
            raise KeyboardInterrupt
        return moved

    monkeypatch.setattr(Path, "rename", interrupted_after_moving_away)
    with pytest.raises(KeyboardInterrupt):
        make_result(rows=30).write(folder)
    assert len(Result.read(folder).trajectory) == 20
    assert hidden(tmp_path) == []


def test_leftovers_of_killed_writers_go_and_those_of_living_ones_stay(make_result: Make, tmp_path: Path) -> None:
    abandoned = tmp_path / ".out.trackfg-abandoned"
    (abandoned / "new").mkdir(parents=True)
    (tmp_path / ".out2.trackfg-other").mkdir()
    with atomic_folder.replaced_folder(tmp_path / "out") as living:
        (living / "file").write_text("half")
        make_result().write(tmp_path / "out")
        assert not abandoned.exists()
        assert (living / "file").read_text() == "half"
    assert (tmp_path / "out" / "file").exists()
    assert hidden(tmp_path) == [".out2.trackfg-other"]


def test_what_was_moved_away_by_a_killed_writer_comes_back(make_result: Make, tmp_path: Path) -> None:
    workspace = tmp_path / ".out.trackfg-killed"
    make_result().write(workspace / "old")
    (workspace / "new").mkdir()
    (workspace / "lock").touch()
    assert_same(Result.read(tmp_path / "out"), make_result())


def cut(path: Path) -> None:
    pd.read_parquet(path)[:0].to_parquet(path)


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda folder: (folder / "events.csv").unlink(), r"events\.csv is missing"),
        (lambda folder: (folder / "trajectory.parquet").write_bytes(b"PAR1"), "not a readable trackfg result"),
        (lambda folder: cut(folder / "trajectory.parquet"), "has no rows: expected those of a run that was smoothed"),
        (lambda folder: (folder / "summary.json").write_text("{}"), "not a readable trackfg result"),
        (
            lambda folder: (folder / "summary.json").write_text('{"format": "trackfg-result/9"}'),
            "result: summary.json has the format 'trackfg-result/9'; expected 'trackfg-result/1'. Hint: use the newest",
        ),
        (lambda folder: (folder / "events.csv").write_text("kind\nslip\n"), "not a readable trackfg result"),
    ],
)
def test_a_damaged_result(make_result: Make, tmp_path: Path, damage: Callable[[Path], None], message: str) -> None:
    folder = make_result().write(tmp_path / "out")
    damage(folder)
    with pytest.raises(BadInputError, match=message):
        Result.read(folder)


def test_no_result(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="expected a folder"):
        Result.read(tmp_path / "nowhere")
    with pytest.raises(BadInputError, match="is missing"):
        Result.read(tmp_path)


def test_readers_see_one_result_while_it_is_replaced_again_and_again(make_result: Make, tmp_path: Path) -> None:
    """Trajectory, events and summary of one read always come from one write, and a result is always there."""
    writer = """
        import sys
        from dataclasses import replace
        from trackfg.results.result import Result
        first = Result.read(sys.argv[1])
        print("begins", flush=True)
        for n in range(1, 30):
            summary = first.summary.model_copy(update={"keyframes": n})
            events = first.events.assign(start_s=float(n))
            trajectory = first.trajectory.iloc[:1].assign(t_s=float(n))
            Result(trajectory, first.geometry, events, summary).write(sys.argv[1])
    """
    folder = make_result().write(tmp_path / "out")
    seen = set()
    command = [sys.executable, "-c", textwrap.dedent(writer), folder]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"begins\n"
        while process.poll() is None:
            result = Result.read(folder)
            if (n := result.summary.keyframes) != 10:  # the first one's
                assert set(result.trajectory["t_s"]) == {float(n)} == set(result.events["start_s"])
            seen.add(n)
    assert process.returncode == 0
    assert len(seen) > 2


def test_permissions_are_the_users_own(make_result: Make, tmp_path: Path) -> None:
    folder = make_result().write(tmp_path / "out")
    mask = os.umask(0)
    os.umask(mask)
    assert folder.stat().st_mode & 0o777 == 0o777 & ~mask


def test_the_hint_of_a_finding_is_read_from_results_of_older_versions(result: Result, tmp_path: Path) -> None:
    path = result.write(tmp_path / "out") / "summary.json"
    text = path.read_text(encoding="utf-8")
    assert '"hint": "none"' in text
    path.write_text(text.replace('"hint": "none"', '"mend": "none"'), encoding="utf-8")
    assert Result.read(tmp_path / "out").summary.findings == result.summary.findings
