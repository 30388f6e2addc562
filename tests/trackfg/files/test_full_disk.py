"""A disk that is full while something is written: one error that names the place, and nothing is left there."""

from __future__ import annotations

import errno
import os
import sqlite3
from pathlib import Path
from typing import NoReturn

import pytest
import sqlalchemy as sa

from trackfg.errors import BadInputError, OutputError
from trackfg.files.atomic_folder import replaced_folder
from trackfg.maps.location import locate
from trackfg.plots.draw import drawn
from trackfg.plots.sheet import Sheet


def no_space() -> NoReturn:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_folder(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"out: cannot be written \(No space left"), replaced_folder(tmp_path / "out"):
        no_space()
    assert not list(tmp_path.iterdir())


def test_another_fault_in_a_folder_stays_what_it_is(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError), replaced_folder(tmp_path / "out"):
        (tmp_path / "absent").read_text()


@pytest.mark.parametrize(("suffix", "module"), [(".png", "matplotlib_picture"), (".html", "plotly_page")])
def test_a_picture(suffix: str, module: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def half(sheet: Sheet, path: Path) -> None:
        path.write_text("half")
        no_space()

    monkeypatch.setattr(f"trackfg.plots.{module}.write", half)
    path = tmp_path / f"out{suffix}"
    path.write_text("the old one")
    with pytest.raises(OutputError, match=rf"out{suffix}: cannot be written"):
        drawn(Sheet("", (), "", (0.0, 1.0)), path)
    assert [(file.name, file.read_text()) for file in tmp_path.iterdir()] == [(path.name, "the old one")]


@pytest.mark.parametrize(
    ("code", "kind"), [(sqlite3.SQLITE_FULL, OutputError), (sqlite3.SQLITE_CORRUPT, BadInputError)]
)
def test_a_map(code: int, kind: type[Exception], tmp_path: Path) -> None:
    fault = sqlite3.OperationalError("database or disk is full")
    fault.sqlite_errorcode = code
    path = tmp_path / "line.gpkg"
    with pytest.raises(kind, match=r"line\.gpkg"), locate(path).connect("create"):
        raise sa.exc.OperationalError("", {}, fault)
    assert not path.exists()
