"""Passages and planned places of balises are read whole, or refused with file, column and row."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from trackfg.errors import BadInputError
from trackfg.io.balises import read_places
from trackfg.io.content import named_files
from trackfg.io.reader import load, read_recording, write_recording
from trackfg.recording.model import BALISE_COLUMNS

Draft = Any


@pytest.fixture
def folder(draft: Draft, tmp_path: Path) -> Path:
    """A recording with passages of two balises and a post, of which one place is not known."""
    folder: Path = draft.write(tmp_path / "rec")
    t = read_recording(folder).imu["t_s"].to_numpy()
    some = t[[0, len(t) // 3, len(t) // 2]]
    (folder / "balises.csv").write_text(
        "t,id\n" + "".join(f"{at:.6f},{one}\n" for at, one in zip(some, ("17", " km 1.5", "B;2"), strict=True))
    )
    (folder / "places.csv").write_text("id,chainage_m,sd_m\nkm 1.5,1500,2\n17,1204.3,0.2\nB;2,,\nunseen,5,0.1\n")
    _describe(folder, 'file = "balises.csv"\nplaces = "places.csv"')
    return folder


def _describe(folder: Path, keys: str) -> None:
    toml = folder / "recording.toml"
    toml.write_text(toml.read_text().partition("\n[balises]")[0] + f"\n[balises]\n{keys}\n")


def test_passages_get_their_planned_places(folder: Path) -> None:
    balises = read_recording(folder).balises
    assert balises is not None
    assert tuple(balises.columns) == BALISE_COLUMNS
    assert list(balises["id"]) == ["17", "km 1.5", "B;2"]
    np.testing.assert_array_equal(balises["chainage_m"], [1204.3, 1500.0, np.nan])
    np.testing.assert_array_equal(balises["chainage_sd_m"], [0.2, 2.0, np.nan])


def test_without_a_table_of_places_none_is_known(folder: Path) -> None:
    _describe(folder, 'file = "balises.csv"')
    balises = read_recording(folder).balises
    assert balises is not None
    assert balises["chainage_m"].isna().all()


@pytest.mark.parametrize("table_format", ["parquet", "csv"])
def test_what_is_written_is_read(folder: Path, tmp_path: Path, table_format: Any) -> None:
    first = read_recording(folder)
    again = read_recording(write_recording(first, tmp_path / "copy", table_format=table_format))
    assert first.balises is not None
    assert again.balises is not None
    pd.testing.assert_frame_equal(first.balises, again.balises, check_exact=True)
    write_recording(first, tmp_path / "copy", table_format=table_format)  # it is its own, and may be replaced


def test_ids_are_the_same_as_text_and_as_numbers(folder: Path) -> None:
    passages = pd.read_csv(folder / "balises.csv").assign(id=[17.0, 18.0, 17.0])
    passages.to_parquet(folder / "balises.parquet")
    (folder / "places.csv").write_text("id,chainage_m,sd_m\n17,1204.3,0.2\n")
    _describe(folder, 'file = "balises.parquet"\nplaces = "places.csv"')
    balises = read_recording(folder).balises
    assert balises is not None
    assert list(balises["id"]) == ["17", "18", "17"]
    np.testing.assert_array_equal(balises["chainage_m"], [1204.3, np.nan, 1204.3])


def test_both_tables_are_content_of_the_recording(folder: Path) -> None:
    assert {"balises.csv", "places.csv"} <= set(named_files(folder))
    before = read_recording(folder).files_sha256
    (folder / "places.csv").write_text("id,chainage_m,sd_m\n17,1204.4,0.2\n")
    assert read_recording(folder).files_sha256 != before


@pytest.mark.parametrize(
    ("file", "text", "said"),
    [
        ("balises.csv", "t,name\n0,a\n", "column 'id': no such column"),
        ("balises.csv", "t,id\n0.1,a\n0.1,b\n", "column 't', data row 2"),
        ("balises.csv", "t,id\n0.1,a\n0.2,\n", "column 'id', data row 2: no id"),
        ("balises.csv", "t,id\nx,a\n", "column 't', data row 1"),
        ("balises.csv", "t,id\n0.1,a,b\n", "data row 1"),
        ("balises.csv", f"t,id\n0.1,{'a' * 300}\n", "column 'id', data row 1: an id of 300 letters"),
        ("places.csv", "id,chainage_m\na,1\n", "column 'sd_m': no such column"),
        ("places.csv", "id,chainage_m,sd_m\na,1,0\n", "column 'sd_m', data row 1"),
        ("places.csv", "id,chainage_m,sd_m\na,1,1\nb,1e300,1\n", "column 'chainage_m', data row 2"),
        (
            "places.csv",
            "id,chainage_m,sd_m\na,1,1\nb,2,1\na,3,1\n",
            "data row 3: balise 'a' has 3",
        ),
        ("places.csv", "id,chainage_m,sd_m\na,1,1\na,1,2\n", "column 'sd_m', data row 2: balise 'a' has 2"),
        ("places.csv", "id,chainage_m,sd_m\n\xff,1,1\n", "cannot be read"),
    ],
)
def test_bad_tables_are_refused_by_file_column_and_row(folder: Path, file: str, text: str, said: str) -> None:
    (folder / file).write_bytes(text.encode("latin-1"))
    report = load(folder)
    found = [str(finding) for finding in report.findings if finding.level == "error"]
    assert len(found) >= 1
    assert found[0].startswith(f"{file}")
    assert said in found[0]
    if file == "places.csv":
        with pytest.raises(BadInputError, match=r"places\.csv"):
            read_places(folder / file)


def test_one_file_does_not_count_as_fixes_and_as_balises(folder: Path) -> None:
    _describe(folder, 'file = "fixes.csv"')
    (error, *_) = [finding for finding in load(folder).findings if finding.level == "error"]
    assert "count twice" in str(error)


def test_a_table_out_of_the_folder_is_refused(folder: Path) -> None:
    _describe(folder, 'file = "../balises.csv"')
    with pytest.raises(BadInputError, match="out of the recording"):
        read_recording(folder)
