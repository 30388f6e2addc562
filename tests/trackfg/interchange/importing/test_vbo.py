"""VBO files as Racelogic describes them; what is none is refused with its place."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from trackfg.errors import BadInputError
from trackfg.interchange.importing.sources.vbo import Vbo

HEAD = (
    "File created on 14/03/2026 at 23:59:58\n\n[header]\nsatellites\ntime\nlatitude\nlongitude\nvelocity kmh\nX_Accel\n"
)
UNITS = "\n[channel units]\ng\n"
NAMES = "\n[column names]\nsats time lat long velocity X_Accel\n\n"
FIRST, SECOND = "009 235959.50 +02814.00000", "009 000000.50 +02814.06000"
ROWS = f"{FIRST} -00444.00000 010.000 +1.0E-01\n{SECOND} -00444.00000 010.000 +2.0E-01\n"


def _read(folder: Path, text: str):
    path = folder / "run.vbo"
    path.write_text(text)
    assert Vbo().recognises(path)
    (table,) = Vbo().tables(path, lambda _: None)
    return table


def test_minutes_west_and_midnight(tmp_path: Path) -> None:
    table = _read(tmp_path, HEAD + UNITS + NAMES + "[data]\n" + ROWS)
    np.testing.assert_allclose(table.frame["latitude"], [46.9, 46.901])
    np.testing.assert_allclose(table.frame["longitude"], 7.4)  # long is positive to the west
    assert table.frame["time_ns"].diff().iloc[1] == 1_000_000_000
    assert np.datetime64(int(table.frame["time_ns"].iloc[0]), "ns") == np.datetime64("2026-03-14T23:59:59.5")
    assert (table.units["X_Accel"], table.units["velocity"]) == ("g", "km/h")
    undated = _read(tmp_path, (HEAD + UNITS + NAMES + "[data]\n" + ROWS).replace("File created", "Made"))
    np.testing.assert_allclose(undated.frame["time_s"], [86_399.5, 86_400.5])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"no \[column names\] or no \[data\]"),
        (HEAD + NAMES, r"no \[column names\] or no \[data\]"),
        (HEAD + "[data]\n" + ROWS, r"no \[column names\] or no \[data\]"),
        (HEAD + NAMES + "[data]\n", r"no rows below \[data\]"),
        (HEAD + NAMES + "[data]\n" + ROWS + "009 00\n", "row 17 has 2 cells; expected 6"),
        (HEAD + NAMES + "[data]\n" + ROWS.replace("010.000", "fast"), r"expected numbers below \[data\]"),
        (HEAD + NAMES + "[data]\n" + ROWS.replace("000000.50", "009900.50"), "row 16: time is 9900.5; expected HHMMSS"),
        (HEAD + NAMES.replace("time", "when") + "[data]\n" + ROWS, "no column time"),
        ((HEAD + NAMES + "[data]\n" + ROWS).replace("14/03", "34/03"), "has no date"),
    ],
)
def test_what_is_no_vbo_is_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(BadInputError, match=f"run.vbo: .*{message}") as error:
        _read(tmp_path, text)
    assert "expected" in str(error.value)
