"""A file that several write at once is always one of theirs, whole."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from trackfg.errors import OutputError
from trackfg.files.atomic_file import replaced_file, write_whole


def test_who_writes_the_same_file_waits(tmp_path: Path) -> None:
    path = tmp_path / "map.toml"
    second = threading.Thread(target=write_whole, args=(path, b"second"))
    with replaced_file(path) as new:
        new.write_bytes(b"first")
        second.start()
        second.join(0.2)
        assert second.is_alive()
        assert new.read_bytes() == b"first"
        assert not path.exists()
    second.join()
    assert path.read_bytes() == b"second"
    assert [each.name for each in tmp_path.iterdir()] == ["map.toml"]


def test_many_writers_at_once_leave_the_file_of_one(tmp_path: Path) -> None:
    path, contents = tmp_path / "map.toml", [bytes([65 + i]) * 100_000 for i in range(8)]
    failures: list[OutputError] = []

    def write(content: bytes) -> None:
        try:
            for _ in range(20):
                write_whole(path, content)
        except OutputError as error:
            failures.append(error)

    writers = [threading.Thread(target=write, args=(content,)) for content in contents]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
    assert not failures
    assert path.read_bytes() in contents
    assert [each.name for each in tmp_path.iterdir()] == ["map.toml"]


def test_what_a_killed_process_left_is_taken_over(tmp_path: Path) -> None:
    for name in (".unfinished-map.toml", ".unfinished-map.toml.lock"):
        (tmp_path / name).write_bytes(b"left")
    write_whole(tmp_path / "map.toml", b"new")
    assert {each.name: each.read_bytes() for each in tmp_path.iterdir()} == {"map.toml": b"new"}


def test_an_error_leaves_the_earlier_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "map.toml"
    write_whole(path, b"old")
    with pytest.raises(OutputError, match="cannot be written"):
        _fill_the_disk(path)
    assert {each.name: each.read_bytes() for each in tmp_path.iterdir()} == {"map.toml": b"old"}


def _fill_the_disk(path: Path) -> None:
    with replaced_file(path) as new:
        new.write_bytes(b"half")
        raise OSError(28, "No space left on device")
