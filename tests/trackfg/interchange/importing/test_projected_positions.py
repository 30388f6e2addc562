"""Easting and northing become latitude and longitude of the reference system that a table states, or that is asked."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from interchange.foreign_forms import Drive

from trackfg.errors import BadInputError
from trackfg.interchange.importing.columns.plan_columns import plan_columns, sigma_columns, stated_system
from trackfg.interchange.importing.conversion import Imported
from trackfg.interchange.importing.source_table import SourceTable

Import = Callable[..., Imported]
UTM_32 = 32632


def _log(drive: Drive, folder: Path, east: str, north: str, **further: object) -> Path:
    """Write the drive with its positions in UTM 32, at 1 Hz among the samples of the IMU."""
    pyproj = pytest.importorskip("pyproj")
    x, y = pyproj.Transformer.from_crs(4326, UTM_32, always_xy=True).transform(drive.longitude, drive.latitude)
    frame = pd.DataFrame({"t_s": drive.t})
    for kind, values in (("gyro", drive.gyro), ("accel", drive.accel)):
        for axis, column in zip("xyz", values.T, strict=True):
            frame[f"{kind}_{axis}"] = column
    at = np.searchsorted(drive.t, drive.gnss_t)
    for name, values in {east: x, north: y, "Height [m]": drive.height}.items():
        frame[name] = pd.Series(values, index=at)
    frame.assign(**further).to_csv(folder / "log.csv", index=False)
    return folder / "log.csv"


def _is_at_its_places(made: Imported, drive: Drive) -> None:
    recording = made.loaded.recording
    assert recording is not None
    assert recording.gnss is not None
    assert recording.gnss_origin is not None
    np.testing.assert_allclose(recording.gnss_origin, [drive.latitude[0], drive.longitude[0], 500.0], atol=1e-8)
    way = 111_200.0 * (drive.latitude - drive.latitude[0])
    np.testing.assert_allclose(recording.gnss["north_m"], way, atol=0.01 + 1e-3 * way.max())
    np.testing.assert_allclose(recording.gnss["east_m"], 0.0, atol=0.01)


@pytest.mark.parametrize(
    ("east", "north", "further"),
    [
        ("Easting (UTM 32N)", "Northing (UTM 32N)", {}),
        ("E_UTM32", "N_UTM32", {}),
        ("utm_x", "utm_y", {"utm_zone": "32T"}),
        ("Rechtswert EPSG:32632", "Hochwert EPSG:32632", {}),
    ],
)
def test_a_header_that_names_the_zone_needs_no_question(
    east: str, north: str, further: dict[str, object], drive: Drive, tmp_path: Path, imported: Import
) -> None:
    _is_at_its_places(imported(_log(drive, tmp_path, east, north, **further)), drive)


@pytest.mark.parametrize("answer", ["EPSG:32632", "32632", "UTM 32N"])
def test_the_reference_system_is_asked_where_no_name_states_it(
    answer: str, drive: Drive, tmp_path: Path, imported: Import
) -> None:
    _is_at_its_places(imported(_log(drive, tmp_path, "Easting", "Northing"), gnss_crs=answer), drive)


def test_without_an_answer_the_key_that_is_needed_is_named(drive: Drive, tmp_path: Path, imported: Import) -> None:
    log = _log(drive, tmp_path, "Easting", "Northing")
    with pytest.raises(
        BadInputError, match=r"gnss\.crs: .*Easting and Northing.*expected an EPSG code such as EPSG:258"
    ):
        imported(log)
    with pytest.raises(BadInputError, match=r"row 1: .* is no place in EPSG:28992|unknown reference system"):
        imported(log, gnss_crs="EPSG:999999")


def test_local_positions_are_east_and_north_in_metres(drive: Drive, tmp_path: Path, imported: Import) -> None:
    recording = imported(_log(drive, tmp_path, "East [m]", "North [m]"), gnss_crs="local").loaded.recording
    assert recording is not None
    assert recording.gnss is not None
    assert recording.gnss_origin is None
    way = 111_200.0 * np.ptp(drive.latitude)
    assert np.hypot(np.ptp(recording.gnss["east_m"]), np.ptp(recording.gnss["north_m"])) == pytest.approx(way, rel=0.01)


def test_positions_near_their_origin_are_local_unless_another_system_is_named(
    drive: Drive, tmp_path: Path, imported: Import
) -> None:
    way = 111_200.0 * (drive.latitude - drive.latitude[0])
    log = pd.read_csv(_log(drive, tmp_path, "e_utm_32", "n_utm_32")).rename(
        columns=lambda name: name.replace("_utm_32", "")
    )
    log.loc[log["n"].notna(), ["e", "n"]] = np.stack([0.0 * way + 1.0, way + 1.0], axis=1)
    log.rename(columns={"Height [m]": "up [m]"}).to_csv(tmp_path / "log.csv", index=False)

    recording = imported(tmp_path / "log.csv").loaded.recording

    assert recording is not None
    assert recording.gnss is not None
    np.testing.assert_allclose(recording.gnss["north_m"], way + 1.0, atol=1e-6)
    np.testing.assert_allclose(recording.gnss["up_m"], 500.0)


@pytest.mark.parametrize(
    ("names", "system"),
    [
        (("ETRS89 UTM33 Easting", "ETRS89 UTM33 Northing"), "EPSG:25833"),
        (("UTM32_E", "UTM32_N"), "EPSG:32632"),
        (("Easting UTM 32", "Northing UTM 33"), None),
        (("E (LV95) [m]", "N (LV95) [m]"), "EPSG:2056"),
        (("Easting UTM 33S", "Northing UTM 33S"), None),  # the south, or the band of Sicily
        (("Easting UTM 7H", "Northing UTM 7H"), "EPSG:32707"),
        (("E", "N"), None),
    ],
)
def test_reference_systems_in_names(names: tuple[str, str], system: str | None) -> None:
    table = SourceTable("log.csv", pd.DataFrame({name: [5e5, 5e5] for name in names}))
    assert plan_columns(table) == names
    assert stated_system(table, names) == system


@pytest.mark.parametrize(
    "names", [("vel_east", "vel_north"), ("East velocity (m/s)", "North velocity (m/s)"), ("sd_east_m", "sd_north_m")]
)
def test_velocities_and_sigmas_are_no_positions(names: tuple[str, str]) -> None:
    assert plan_columns(SourceTable("log.csv", pd.DataFrame({name: [5.0, 6.0] for name in names}))) is None


@pytest.mark.parametrize(
    "names",
    [
        ("east_sd_m", "north_sd_m", "up_sd_m"),
        ("east_m_sd", "north_m_sd", "up_m_sd"),
        ("sde(m)", "sdn(m)", "sdu(m)"),
        ("Lon std [m]", "Lat std [m]", "Alt std [m]"),
        ("stdLon", "stdLat", "stdAlt"),
        ("pos_std_east", "pos_std_north", "pos_std_up"),
        ("sigma_e", "sigma_n", None),
    ],
)
def test_sigmas_of_each_axis_in_names(names: tuple[str | None, ...]) -> None:
    others = ("east_m", "north_m", "up_m", "std_vel_e", "acc_x_std", "hdop")
    table = SourceTable("log.csv", pd.DataFrame({name: [5.0, 6.0] for name in (*others, *filter(None, names))}))
    assert sigma_columns(table) == names


def test_sigmas_of_other_units_are_none() -> None:
    table = SourceTable("log.csv", pd.DataFrame({name: [1e-7] for name in ("lat_std_deg", "sigma_n [rad]")}))
    assert sigma_columns(table) == (None, None, None)
