"""Times in the notations of databases, spreadsheets and languages come in as what they say, or are refused by name."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from interchange.foreign_forms import Drive

from trackfg.errors import BadInputError
from trackfg.interchange.importing.columns.calendar_columns import with_whole_dates
from trackfg.interchange.importing.conversion import Imported
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.interchange.importing.times.clock import Times
from trackfg.interchange.importing.times.notation import TimeNotation
from trackfg.interchange.importing.times.reading import read_times
from trackfg.interchange.importing.times.zones import states_zone

Import = Callable[..., Imported]
MARCH = datetime(2026, 3, 14, 3, 12, tzinfo=UTC)


def _read(*cells: str, zone: str = "UTC") -> Times:
    table = SourceTable("log.csv", pd.DataFrame({"time": pd.Series(cells, dtype="string")}))
    return read_times(table, ("time",), TimeNotation(zone=zone))


@pytest.mark.parametrize(
    "date",
    [
        *("14. März 2026", "14. Mrz. 2026", "14-Mär-2026", "Sa, 14. März 2026", "Samstag, 14. März 2026"),
        *("14 mars 2026", "samedi, 14 mars 2026", "14 mar 2026", "14 marzo 2026", "14 maart 2026", "14 марта 2026"),
        *("14 Mar 2026", "14 March 2026", "14-Mar-2026"),
    ],
)
@pytest.mark.parametrize("clock", ["{}:12:00", "{}:12:00.500", "{}:12:00,500"])
def test_months_in_words(date: str, clock: str) -> None:
    times = _read(*(f"{date} {clock.format(hour)}" for hour in ("03", "04")))
    half = 0.5 if "500" in clock else 0.0
    np.testing.assert_allclose(times.since(int(MARCH.timestamp()) * 1_000_000_000), [half, 3600.0 + half])


@pytest.mark.parametrize("month", ["Dez", "décembre", "dicembre", "grudnia"])
def test_a_month_of_no_known_language_is_refused(month: str) -> None:
    cells = (f"14 {month} 2025 03:12:00", f"14 {month} 2025 03:12:01")
    if month == "grudnia":  # the Polish genitive
        with pytest.raises(BadInputError, match=r"row 1: .* no time in a known notation.*time_format"):
            _read(*cells)
    else:
        assert _read(*cells).first_ns == int(datetime(2025, 12, 14, 3, 12, tzinfo=UTC).timestamp()) * 1_000_000_000


@pytest.mark.parametrize(
    ("cell", "stated"),
    [
        *(("2026-05-01 05:12:00.0025+02", True), ("2026-05-01 05:12:00+0200", True), ("20260501T051200+02:00", True)),
        *(("2026-05-01", False), ("05:12:00 05-01-2026", False), ("2026-05-01 05:12:00", False)),
    ],
)
def test_an_offset_without_minutes_states_a_zone(cell: str, stated: bool) -> None:
    assert states_zone(cell) == stated


def test_an_offset_without_minutes() -> None:
    times = _read("2026-03-14 05:12:00.5+02", "2026-03-14 05:12:01.5+02")
    np.testing.assert_allclose(times.since(int(MARCH.timestamp()) * 1_000_000_000), [0.5, 1.5])


def test_dates_of_gps_are_ahead_of_utc() -> None:
    times = _read("2026-03-14 03:12:18", "2026-03-14 03:12:19", zone="GPS")
    np.testing.assert_allclose(times.since(int(MARCH.timestamp()) * 1_000_000_000), [0.0, 1.0])


def test_a_time_before_its_date() -> None:
    times = _read("03:12:00.5 14.03.2026", "03:12:01.5 14.03.2026")
    np.testing.assert_allclose(times.since(int(MARCH.timestamp()) * 1_000_000_000), [0.5, 1.5])


@pytest.mark.parametrize(
    "cells",
    [
        ("27:12:00.003", "27:12:01.003"),
        ("P1DT3H12M0.003S", "P1DT3H12M1.003S"),
        ("1 days 03:12:00.003", "1 days 03:12:01.003"),
        ("1 day, 3:12:00.003", "1 day, 3:12:01.003"),
    ],
)
def test_durations_have_a_zero_of_their_own(cells: tuple[str, str]) -> None:
    times = _read(*cells)
    assert times.have_own_zero
    np.testing.assert_allclose(times.since(None), [97_920.003, 97_921.003])


def test_times_of_day_go_on_beyond_24_hours() -> None:
    cells = [f"{h}:{m:02d}:00" for h in (23, 24) for m in range(60)]
    np.testing.assert_allclose(np.diff(_read(*cells).since(None)), 60.0)


def _samples(drive: Drive, **times: object) -> pd.DataFrame:
    names = [f"{what}{axis} [{unit}]" for what, unit in (("g", "rad/s"), ("a", "m/s2")) for axis in "xyz"]
    return pd.DataFrame({**times, **dict(zip(names, np.hstack([drive.gyro, drive.accel]).T, strict=True))})


def _of(drive: Drive) -> dict[str, dict[str, object]]:
    local = pd.to_datetime(drive.ns + 7_200_000_000_000)
    midnight_ns = int(datetime(2026, 5, 1, tzinfo=UTC).timestamp()) * 1_000_000_000
    return {
        "epoch and ms": {"epoch": drive.ns // 1_000_000_000, "ms": drive.ns // 1_000_000 % 1000},
        "offset": {"local time": local.strftime("%Y-%m-%d %H:%M:%S.%f"), "utc offset": "+02:00"},
        "of the day": {"date": "2026-05-01", "time of day [ms]": (drive.ns - midnight_ns) / 1e6},
    }


@pytest.mark.parametrize("form", ["epoch and ms", "offset", "of the day"])
def test_a_time_in_two_columns(drive: Drive, tmp_path: Path, imported: Import, form: str) -> None:
    _samples(drive, **_of(drive)[form]).to_csv(tmp_path / "log.csv", index=False)
    recording = imported(tmp_path / "log.csv").loaded.recording
    assert recording is not None
    assert recording.description.start == datetime(2026, 5, 1, 3, 12, tzinfo=UTC)
    np.testing.assert_allclose(recording.imu["t_s"], drive.t, atol=2e-3)


def test_seconds_that_do_not_say_from_where_are_of_no_date(drive: Drive) -> None:
    table = SourceTable("log.csv", _samples(drive, Datum="01.05.2026", Sekunden=drive.t))
    assert with_whole_dates(table).columns == table.columns
