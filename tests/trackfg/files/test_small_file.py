"""Small files: regular ones only, up to a size, and nothing in them takes minutes."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from trackfg.config import SmoothConfig
from trackfg.errors import BadInputError
from trackfg.files.atomic_folder import recover, replaced_folder
from trackfg.files.owned_folder import refuse_unwritable
from trackfg.files.small_file import MOST_TOML_BYTES, json_of, read_small, read_toml, toml_of
from trackfg.io.description_reader import read_description


def test_what_is_no_file_is_refused_without_waiting(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.toml")
    (tmp_path / "zero.toml").symlink_to("/dev/zero")
    for name in ("pipe.toml", "zero.toml", "."):
        with pytest.raises(BadInputError, match=r"is no regular file|Is a directory"):
            read_toml(tmp_path / name)
    assert "is no regular file" in str(read_description(tmp_path / "pipe.toml").findings[0])
    with pytest.raises(BadInputError, match=r"none\.toml: cannot be read: No such file"):
        read_toml(tmp_path / "none.toml")


def test_a_file_has_at_most_its_size(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"12345")
    assert read_small(tmp_path / "a", 5) == b"12345"
    with pytest.raises(OSError, match="is larger than"):
        read_small(tmp_path / "a", 4)
    with (tmp_path / "huge.toml").open("wb") as file:
        file.truncate(50 * 2**30)
    with pytest.raises(BadInputError, match="is larger than 1 MiB"):
        read_toml(tmp_path / "huge.toml")


@pytest.mark.parametrize("text", ["a." * 100_000 + "a = 1", "[" + "a." * 9000 + "a]", "a = " + "[" * 100_000])
def test_absurd_depth_is_refused_at_once(text: str) -> None:
    start = time.monotonic()
    with pytest.raises(ValueError, match=r"dots|deeply"):
        toml_of(text.encode())
    assert time.monotonic() - start < 2.0


def test_json_of_absurd_depth_is_refused() -> None:
    assert json_of(b'{"a": [1.5]}') == {"a": [1.5]}
    for text in ("[" * 200_000, "{"):
        with pytest.raises(ValueError, match=r"deeply|Expecting"):
            json_of(text)


def test_a_hundred_thousand_unknown_keys_are_reported_in_short(tmp_path: Path) -> None:
    (tmp_path / "recording.toml").write_text("".join(f"key{i}=1\n" for i in range(90_000))[:MOST_TOML_BYTES])
    assert 1 < len(read_description(tmp_path).findings) < 100


def test_an_unknown_setting_is_named_with_the_nearest_one(tmp_path: Path) -> None:
    (path := tmp_path / "c.toml").write_text("ouput = {}\n[geometry]\nstep_n = 1.0\n")
    with pytest.raises(BadInputError) as refused:
        SmoothConfig.from_toml(path)
    message = str(refused.value)
    assert message.startswith(f"{path}: ")
    assert "ouput: unknown key; expected one of keyframes, imu," in message
    assert "did you mean 'output'?" in message
    assert "geometry.step_n: unknown key; expected one of step_m," in message


def test_a_byte_order_mark_is_no_content() -> None:
    assert toml_of(b"\xef\xbb\xbfa = 1.5") == {"a": 1.5}


def test_a_place_where_no_folder_can_be_is_refused_before_any_work(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "loop").symlink_to("loop")
    for place, message in (
        (tmp_path / "file" / "x", "file is a file"),
        (tmp_path / ("a" * 250), "its name is too long"),
        (tmp_path / ("a" * 300) / "x", "File name too long"),
        (tmp_path / "loop", "circle"),
        (tmp_path / "x\0y", "null"),
    ):
        with pytest.raises(BadInputError, match=message):
            refuse_unwritable(place)
    refuse_unwritable(tmp_path / "new" / "out")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "loop"]


def test_what_only_has_the_name_of_a_leftover_is_left_alone(tmp_path: Path) -> None:
    mine, linked = tmp_path / ".out.trackfg-mine", tmp_path / ".out.trackfg-link"
    (mine / "old").mkdir(parents=True)
    (mine / "old" / "precious").touch()
    (tmp_path / "elsewhere").mkdir()
    linked.symlink_to("elsewhere")
    recover(tmp_path / "out")
    with replaced_folder(tmp_path / "out") as new:
        (new / "a").touch()
    assert (mine / "old" / "precious").exists()
    assert list((tmp_path / "elsewhere").iterdir()) == []
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["a"]
