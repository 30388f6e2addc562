"""Paths of folders and of files beside them."""

from __future__ import annotations

from pathlib import Path

import pytest

from trackfg.errors import BadInputError
from trackfg.files.atomic_folder import beside, replaced_folder
from trackfg.files.owned_folder import refuse_used
from trackfg.results.result import RESULT_FOLDER


def test_the_folder_that_a_command_runs_in_is_not_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A shell in it would be left in the folder that is deleted, and see it empty."""
    inside = tmp_path / "out1" / "deeper"
    inside.mkdir(parents=True)
    monkeypatch.chdir(inside)
    for name in (".", inside):
        with pytest.raises(BadInputError, match="runs in"), replaced_folder(Path(name)):
            pass
    with pytest.raises(BadInputError, match="runs in"), replaced_folder(Path("..")):
        pass
    with pytest.raises(BadInputError, match="runs in"):
        RESULT_FOLDER.refuse_foreign(Path())
    with pytest.raises(BadInputError, match="is the folder that the command runs in, or above it"):
        refuse_used(Path(), "never overwritten")
    with replaced_folder(Path("new")) as new:
        (new / "file").touch()
    assert (inside / "new" / "file").exists()


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
