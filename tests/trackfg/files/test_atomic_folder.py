"""Paths of folders and of files beside them."""

from __future__ import annotations

from pathlib import Path

import pytest

from trackfg.files.atomic_folder import beside


def test_a_file_beside_a_folder_has_the_path_that_was_written_where_that_has_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "out1").mkdir()
    (tmp_path / "link").symlink_to("out1")
    monkeypatch.chdir(tmp_path)
    assert [beside(Path(name), ".html") for name in ("out1", "out1/", "./out1")] == [Path("out1.html")] * 3
    absolute = tmp_path.resolve() / "out1.html"
    assert beside(Path("link"), ".html") == absolute
    monkeypatch.chdir(tmp_path / "out1")
    assert beside(Path(), ".html") == absolute
