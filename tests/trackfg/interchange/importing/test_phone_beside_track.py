"""A phone's log and tracks of GPX: the finest clock is taken, and positions are found in whichever file has them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from interchange.foreign_forms import START_NS, Drive

from trackfg.errors import BadInputError
from trackfg.interchange.importing.conversion import Imported
from trackfg.interchange.importing.registry import source_format
from trackfg.interchange.importing.times.zones import states_zone
from trackfg.recording.model import Recording

Import = Callable[..., Imported]


def _samples(drive: Drive) -> pd.DataFrame:
    columns = {f"gyro_{axis}": column for axis, column in zip("xyz", drive.gyro.T, strict=True)}
    return pd.DataFrame(columns | {f"acc_{axis}": column for axis, column in zip("xyz", drive.accel.T, strict=True)})


def _recording(made: Imported) -> Recording:
    assert made.loaded.recording is not None
    return made.loaded.recording


def _went_north(recording: Recording, drive: Drive) -> None:
    assert recording.gnss is not None
    way = 111_200.0 * (
        np.interp(recording.gnss["t_s"], drive.t, np.interp(drive.t, drive.gnss_t, drive.latitude)) - 46.9
    )
    np.testing.assert_allclose(recording.gnss["north_m"], way, atol=0.05 + 2e-3 * way.max())


def _gpx(drive: Drive, path: Path, point: str) -> None:
    points = "".join(
        point.format(lat=lat, lon=lon, time=pd.Timestamp(ns).isoformat())
        for lat, lon, ns in zip(drive.latitude, drive.longitude, drive.gnss_ns, strict=True)
    )
    head = '<?xml version="1.0"?>\n<gpx version="1.1" xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>'
    path.write_text(f"{head}{points}</trkseg></trk></gpx>\n")


@pytest.mark.parametrize("speed", ["", "<extensions><a:speed xmlns:a='b'>3.5</a:speed></extensions>"])
def test_a_track_lies_beside_the_samples(speed: str, drive: Drive, tmp_path: Path, imported: Import) -> None:
    pytest.importorskip("lxml")
    folder = tmp_path / "log"
    folder.mkdir()
    _samples(drive).assign(time=pd.to_datetime(drive.ns).astype(str) + "Z").to_csv(folder / "imu.csv", index=False)
    _gpx(
        drive,
        folder / "track.gpx",
        '<trkpt lat="{lat:.9f}" lon="{lon:.9f}"><ele>500</ele><time>{time}Z</time>' + speed + "</trkpt>",
    )

    recording = _recording(imported(folder))

    _went_north(recording, drive)
    assert recording.description.gnss is not None
    assert (recording.description.gnss_speed is not None) == bool(speed)


def test_a_track_without_times_is_refused_by_name(drive: Drive, tmp_path: Path) -> None:
    pytest.importorskip("lxml")
    _samples(drive).assign(t=drive.t).to_csv(tmp_path / "imu.csv", index=False)
    _gpx(drive, tmp_path / "track.gpx", '<trkpt lat="{lat:.9f}" lon="{lon:.9f}"/>')
    with pytest.raises(BadInputError, match=r"track\.gpx: has 20 points, none with a time; expected"):
        source_format(tmp_path).tables(tmp_path, lambda _: None)


def test_a_time_of_the_newest_position_is_none_of_the_samples(drive: Drive, tmp_path: Path, imported: Import) -> None:
    newest = np.searchsorted(drive.gnss_t, drive.t, side="right") - 1
    places = {"locationLatitude": drive.latitude, "locationLongitude": drive.longitude}
    log = pd.DataFrame(
        {
            "loggingTime(txt)": pd.to_datetime(drive.ns).astype(str) + " +0000",
            "locationTimestamp_since1970(s)": (START_NS / 1e9 + drive.gnss_t)[newest],
            **{name: values[newest] for name, values in places.items()},
        }
    )
    log.join(_samples(drive)).to_csv(tmp_path / "log.csv", index=False)

    recording = _recording(imported(tmp_path / "log.csv"))

    np.testing.assert_allclose(recording.imu["t_s"], drive.t, atol=1e-3)
    _went_north(recording, drive)


def test_positions_in_rows_of_a_coarse_clock_are_spread_as_the_samples_are(
    drive: Drive, tmp_path: Path, imported: Import
) -> None:
    log = _samples(drive).assign(
        t_s=np.floor(drive.t * 10.0 + 1e-6) / 10.0,
        latitude=np.interp(drive.t, drive.gnss_t, drive.latitude),
        longitude=np.interp(drive.t, drive.gnss_t, drive.longitude),
    )
    log.to_csv(tmp_path / "log.csv", index=False)

    recording = _recording(imported(tmp_path / "log.csv"))

    t = recording.imu["t_s"].to_numpy()
    np.testing.assert_allclose(np.diff(t), 0.01, atol=1e-3)
    assert recording.gnss is not None
    assert set(recording.gnss["t_s"]) <= set(t)


def test_positions_alone_are_refused_in_one_sentence(drive: Drive, tmp_path: Path, imported: Import) -> None:
    log = pd.DataFrame({"time_s": drive.gnss_t, "lat": drive.latitude, "lon": drive.longitude, "speed_kmh": 36.0})
    log.to_csv(tmp_path / "gps.csv", index=False)
    with pytest.raises(BadInputError, match=r"^positions, but no gyro and no accelerometer found among gps"):
        imported(tmp_path / "gps.csv")


@pytest.mark.parametrize(("cell", "stated"), [("2026-05-01 03:12:00.005 +0000", True), ("2026-05-01 03:12:00", False)])
def test_an_offset_after_a_blank_states_the_zone(cell: str, stated: bool) -> None:
    assert states_zone(cell) == stated
