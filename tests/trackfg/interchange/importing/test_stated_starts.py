"""A clock that counts from a zero of its own is brought to the dates of other tables by what stands above it."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from interchange.foreign_forms import Drive

from trackfg.errors import BadInputError
from trackfg.interchange.importing.conversion import Imported

Import = Callable[..., Imported]
START = datetime(2026, 5, 1, 3, 12, tzinfo=UTC)


def _imu(drive: Drive, folder: Path, *above: str) -> None:
    names = [f"{kind} {axis} [{unit}]" for kind, unit in (("gyro", "rad/s"), ("acc", "m/s^2")) for axis in "xyz"]
    table = pd.DataFrame(np.hstack([drive.gyro, drive.accel]), columns=names)
    table.insert(0, "t [s]", drive.t)
    (folder / "imu.csv").write_text("".join(f"{line}\n" for line in above) + table.to_csv(index=False), "utf-8")


def _wheel(drive: Drive, folder: Path, times: object, *above: str) -> None:
    table = pd.DataFrame({"time": times, "wheel speed [km/h]": 3.6 * drive.speed})
    (folder / "wheel.csv").write_text("".join(f"{line}\n" for line in above) + table.to_csv(index=False), "utf-8")


def _dates(drive: Drive) -> pd.Index:
    return pd.to_datetime(drive.ns).strftime("%Y-%m-%dT%H:%M:%S.%fZ")


def _clocks_agree(made: Imported, drive: Drive) -> None:
    recording = made.loaded.recording
    assert recording is not None
    assert recording.tach is not None
    assert recording.description.start == START
    np.testing.assert_allclose(recording.imu["t_s"], drive.t, atol=1e-6)
    np.testing.assert_allclose(recording.tach["t_s"], drive.t, atol=1e-6)


@pytest.mark.parametrize(
    ("line", "zone"),
    [
        ("# Start time: 2026-05-01T03:12:00.000Z", None),
        ("Recorded from 2026-05-01 05:12:00+0200 on", None),
        ("Startzeit: 01.05.2026 05:12:00", "Europe/Berlin"),
        ("Start: 2026-05-01; 3:12:00,000", "UTC"),
    ],
)
def test_a_line_above_a_table_states_when_it_counts_0(
    line: str, zone: str | None, drive: Drive, tmp_path: Path, imported: Import
) -> None:
    _imu(drive, tmp_path, "Recorder: XY", line)
    _wheel(drive, tmp_path, _dates(drive))
    _clocks_agree(imported(tmp_path, **({} if zone is None else {"time_zone": zone})), drive)


def test_two_recorders_that_started_apart_are_brought_together(drive: Drive, tmp_path: Path, imported: Import) -> None:
    _imu(drive, tmp_path, "start: 2026-05-01 03:12:00Z")
    _wheel(drive, tmp_path, drive.t + 7.0, "start: 2026-05-01 03:11:53Z")
    _clocks_agree(imported(tmp_path), drive)


@pytest.mark.parametrize("above", [(), ("started 2026-05-01 03:12:00Z, ended 2026-05-01 03:12:20Z",)])
def test_what_no_line_states_is_asked(above: tuple[str, ...], drive: Drive, tmp_path: Path, imported: Import) -> None:
    _imu(drive, tmp_path, *above)
    _wheel(drive, tmp_path, _dates(drive))
    _clocks_agree(imported(tmp_path, start="2026-05-01T05:12:00+02:00"), drive)
    for answer in ("", "2026-05-01T03:12:00", "at night"):
        with pytest.raises(BadInputError, match=r"start: .* expected a date with its zone"):
            imported(tmp_path, start=answer)


def test_a_date_above_tables_of_one_clock_is_not_needed(drive: Drive, tmp_path: Path, imported: Import) -> None:
    """It may be that of the export."""
    _imu(drive, tmp_path, "2026-06-01 12:00:00Z")
    _wheel(drive, tmp_path, drive.t)
    recording = imported(tmp_path).loaded.recording
    assert recording is not None
    assert recording.description.start is None
