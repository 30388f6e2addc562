"""Each format's own library writes a fixture; what comes back equals what went in, and damaged files are refused."""

from __future__ import annotations

import shutil
import sys
import zipfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from trackfg.errors import BadInputError
from trackfg.interchange.importing.registry import source_format

sys.path.insert(0, str(Path(__file__).parents[4] / "tools"))

from interchange.foreign_forms import WRITERS, format_key, write_sensor_logger

IMU = ["wx_radps", "wy_radps", "wz_radps", "fx_mps2", "fy_mps2", "fz_mps2"]


def _same_imu(made, drive, *, atol=1e-9):
    recording = made.loaded.recording
    np.testing.assert_allclose(recording.imu["t_s"], drive.t, atol=1e-9)
    np.testing.assert_allclose(recording.imu[IMU[:3]], drive.gyro, atol=atol)
    np.testing.assert_allclose(recording.imu[IMU[3:]], drive.accel, atol=atol)


def _same_positions(made, drive, *, held: bool):
    gnss = made.loaded.recording.gnss
    if held:  # at rest fewer rows are kept than the receiver gave
        moving = np.flatnonzero(np.diff(drive.latitude)) + 1
        assert np.isin(np.round(drive.gnss_t[moving], 6), np.round(gnss["t_s"], 6)).all()
        assert len(gnss) <= len(drive.gnss_t)
    else:
        np.testing.assert_allclose(gnss["t_s"], drive.gnss_t, atol=1e-9)
    latitude = drive.latitude[np.searchsorted(drive.gnss_t, gnss["t_s"] + 1e-6) - 1]
    north = (latitude - drive.latitude[0]) * np.pi / 180.0 * 6_367_800.0  # the meridian's radius at 46.9 deg
    np.testing.assert_allclose(gnss["north_m"], north, atol=0.02)


@pytest.mark.parametrize("name", WRITERS)
def test_what_a_format_s_library_writes_comes_back(name, drive, tmp_path, imported):
    source = WRITERS[name](drive, tmp_path)

    made = imported(source)

    assert source_format(source).key == format_key(name)
    _same_imu(made, drive)
    recording = made.loaded.recording
    if recording.gnss is not None:
        _same_positions(made, drive, held=name == "vbo")
    if name in ("ros", "mcap", "mdf", "vbo") or format_key(name) == "text":
        rolled = recording.tach["distance_m"].to_numpy()
        distance = np.interp(recording.tach["t_s"], drive.t, np.cumsum(drive.speed) / 100.0)
        np.testing.assert_allclose(rolled - rolled[0], distance, atol=0.05)
    assert recording.gnss is not None or name not in ("ros", "mcap", "sensor-logger", "hdf5", "vbo")


def _files(path: Path) -> list[Path]:
    return [path] if path.is_file() else sorted(file for file in path.rglob("*") if file.is_file())


@pytest.mark.parametrize("name", [name for name in WRITERS if name != "phyphox"])
def test_damaged_files_are_refused_with_a_reason(name, drive, tmp_path, imported):
    """Cut off, overwritten in the middle or at the start: never a traceback, and never a recording of other values."""
    source = WRITERS[name](drive, tmp_path)
    target = max(_files(source), key=lambda file: file.stat().st_size)
    whole = target.read_bytes()
    rng = np.random.default_rng(5)
    refused = 0
    for i in range(10):
        if i < 5:
            damaged = whole[: int(len(whole) * (i + 0.5) / 5.5)]
        else:
            at = int(rng.integers(0, len(whole) - 2000))
            damaged = whole[:at] + rng.bytes(2000) + whole[at + 2000 :]
        target.write_bytes(damaged)
        try:
            made = imported(source, None if i % 2 else format_key(name))
        except BadInputError:
            refused += 1
        else:
            assert made.loaded.recording is not None
            shutil.rmtree(made.folder)
    assert refused >= 3


def test_acceleration_without_gravity_is_refused_by_name(drive, tmp_path, imported):
    path = write_sensor_logger(drive, tmp_path)
    with zipfile.ZipFile(path) as archive:
        content = {name: archive.read(name) for name in archive.namelist()}
    content["Accelerometer.csv"] = content.pop("TotalAcceleration.csv")
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in content.items():
            archive.writestr(name, data)

    with pytest.raises(BadInputError, match=r"Accelerometer.csv is without gravity"):
        imported(path)


def test_a_damaged_zip_of_lzma_is_refused(tmp_path, imported):
    path = tmp_path / "log.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_LZMA) as archive:
        archive.writestr("log.json", '[{"sensor": "Gyroscope", "time": "1", "x": "0"}]' * 500)
    content = path.read_bytes()
    path.write_bytes(content[:60] + bytes(byte ^ 0x5A for byte in content[60:120]) + content[120:])

    with pytest.raises(BadInputError, match="cannot be unpacked"):
        imported(path)


def test_ubx_and_nmea_positions_come_back(tmp_path):
    import pyubx2

    from trackfg.interchange.importing.sources.receivers.gnss_log import read_gnss_log

    message = pyubx2.UBXMessage(
        "NAV", "NAV-PVT", pyubx2.GET,
        year=2026, month=5, day=1, hour=3, min=12, second=0, nano=250_000_000, fixType=3, gnssFixOk=1,
        lat=46.9, lon=7.4, height=500_000, hAcc=1414, vAcc=2000,
    )  # fmt: skip
    ubx = tmp_path / "log.ubx"
    ubx.write_bytes(message.serialize())
    nmea = tmp_path / "log.nmea"
    nmea.write_text(
        _sentence("GNZDA,031200.00,01,05,2026,00,00")
        + _sentence("GNGST,031200.25,,,,,1.1,1.2,2.0")
        + _sentence("GNGGA,031200.25,4654.0000,N,00724.0000,E,1,10,0.9,450.0,M,50.0,M,,")
    )

    for path, sd in ((ubx, (1.0, 1.0, 2.0)), (nmea, (1.2, 1.1, 2.0))):
        frame = read_gnss_log(path).frame
        assert len(frame) == 1
        assert frame["time_ns"][0] == 1_777_605_120_250_000_000
        np.testing.assert_allclose(frame.loc[0, ["latitude", "longitude", "height"]], [46.9, 7.4, 500.0], atol=1e-7)
        np.testing.assert_allclose(frame.loc[0, ["sd_east_m", "sd_north_m", "sd_up_m"]], sd, atol=1e-3)


def test_the_quality_of_a_gga_sentence_is_that_of_its_position(tmp_path):
    from trackfg.interchange.importing.sources.receivers.gnss_log import read_gnss_log

    nmea = tmp_path / "log.nmea"
    nmea.write_text(
        _sentence("GNZDA,031200.00,01,05,2026,00,00")
        + "".join(
            _sentence(f"GNGGA,03120{quality}.00,4654.0000,N,00724.0000,E,{quality},10,0.8,450.0,M,50.0,M,,")
            for quality in range(9)
        )
    )

    frame = read_gnss_log(nmea).frame

    np.testing.assert_allclose(frame["sd_east_m"], 0.8 * np.array([3.0, 1.0, 3.0, 0.05, 0.5]))


def test_the_mode_of_an_rmc_sentence_is_that_of_its_position(tmp_path):
    from trackfg.interchange.importing.sources.receivers.gnss_log import read_gnss_log

    nmea = tmp_path / "log.nmea"
    nmea.write_text(
        "".join(
            _sentence(f"GNRMC,03120{i}.00,A,4654.0000,N,00724.0000,E,24.0,90.0,010526,,,{mode}")
            for i, mode in enumerate("ADEFR")
        )
    )

    frame = read_gnss_log(nmea).frame  # an estimated position and its speed are no measurements

    np.testing.assert_allclose(frame["sd_east_m"], [3.0, 1.0, 0.5, 0.05])
    np.testing.assert_allclose(np.diff(frame["time_ns"]) / 1e9, [1.0, 2.0, 1.0])


@pytest.mark.parametrize("beginning", ["", "$GNGGA"])
def test_a_receiver_log_that_ends_in_zeros_is_given_up(beginning, tmp_path):
    from trackfg.interchange.importing.sources.receivers.gnss_log import read_gnss_log

    path = tmp_path / "log.nmea"
    path.write_text(_sentence("GNZDA,031200.00,01,05,2026,00,00") + beginning)
    with path.open("ab") as file:
        file.truncate(50 * 2**30)
    with pytest.raises(BadInputError, match=r"log\.nmea: cannot be read \(no message within 1 MiB before byte \d+\)"):
        read_gnss_log(path)


def test_a_receiver_s_log_goes_beside_the_table_of_an_imu(tmp_path, drive, imported):
    source = tmp_path / "source"
    source.mkdir()
    columns = {f"gyro_{axis}": drive.gyro[:, i] for i, axis in enumerate("xyz")}
    columns |= {f"acc_{axis}": drive.accel[:, i] for i, axis in enumerate("xyz")}
    pd.DataFrame({"time": drive.ns, **columns}).to_csv(source / "imu.csv", index=False)
    sentences = [_sentence("GNZDA,031200.00,01,05,2026,00,00")]
    for second in range(10):
        sentences.append(_sentence(f"GNGST,0312{second:02d}.00,,,,,1.1,1.2,2.0"))
        sentences.append(_sentence(f"GNGGA,0312{second:02d}.00,4654.0000,N,00724.0000,E,1,10,0.9,450.0,M,50.0,M,,"))
    (source / "receiver.nmea").write_text("".join(sentences))

    gnss = imported(source).loaded.recording.gnss

    np.testing.assert_allclose(gnss["t_s"], np.arange(10.0))
    assert gnss[["east_sd_m", "north_sd_m", "up_sd_m"]].iloc[0].tolist() == [1.2, 1.1, 2.0]


def _sentence(text: str) -> str:
    checksum = 0
    for character in text:
        checksum ^= ord(character)
    return f"${text}*{checksum:02X}\r\n"
