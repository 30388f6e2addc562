from __future__ import annotations

import os
from pathlib import Path

import pytest

from trackfg.fleet.known_content import KnownContent, sight


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "imu.csv").write_text("1,2\n")
    age(tmp_path / "run")
    return tmp_path / "run"


def age(folder: Path) -> None:
    for path in folder.iterdir():
        os.utime(path, (1e9, 1e9))


@pytest.fixture(autouse=True)
def an_hour_later(monkeypatch: pytest.MonkeyPatch) -> None:
    """The time of change cannot be set, but the clock that it is held against can."""
    from time import time

    monkeypatch.setattr("trackfg.fleet.known_content.time.time", lambda: time() + 3600.0)


def test_what_did_not_change_is_known_after_a_restart(tmp_path: Path, folder: Path) -> None:
    known = KnownContent(tmp_path / "known.sqlite")
    known.remember(sight("run", folder, ["imu.csv"]), "digest")
    known.save()
    assert KnownContent(tmp_path / "known.sqlite").recall("run") == "digest"
    assert KnownContent(tmp_path / "known.sqlite").recall("other") is None


def test_a_file_of_the_same_size_and_date_is_seen_to_be_another(folder: Path) -> None:
    known = KnownContent(None)
    known.remember(sight("run", folder, ["imu.csv"]), "digest")
    (folder / "imu.csv").write_text("1,3\n")
    age(folder)
    assert known.recall("run") is None


def test_a_missing_file_is_not_known(folder: Path) -> None:
    known = KnownContent(None)
    known.remember(sight("run", folder, ["imu.csv", "tach.csv"]), "digest")
    assert known.recall("run") is None


def test_a_file_that_changed_just_now_is_read_again(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()
    known = KnownContent(None)
    known.remember(sight("run", folder, ["imu.csv"]), "digest")
    assert known.recall("run") is None


def test_a_damaged_file_is_as_good_as_none(tmp_path: Path, folder: Path) -> None:
    (tmp_path / "known.sqlite").write_bytes(b"no database" * 1000)
    known = KnownContent(tmp_path / "known.sqlite")
    known.remember(sight("run", folder, ["imu.csv"]), "digest")
    known.save()
    assert known.recall("run") == "digest"
