"""A wheel's count is unwrapped at any modulus; one that was reset, or whose values drop out, stays as it is."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from interchange.foreign_forms import Drive

from trackfg.errors import BadInputError
from trackfg.interchange.importing.conversion import Imported, write_imported
from trackfg.interchange.importing.mapping import mapping_of
from trackfg.interchange.importing.registry import source_format
from trackfg.interchange.importing.sensors.wheel_count import unwrapped_count

Import = Callable[..., Imported]


def rolled(rate: float, rows: int = 6000, seed: int = 0) -> np.ndarray:
    """Whole counts of a wheel that starts, and then rolls by about ``rate`` a row, faster and slower."""
    rng = np.random.default_rng(seed)
    k = np.arange(rows)
    speed = rate * np.clip(k / 500.0, 0.0, 1.0) * (1.0 + 0.3 * np.sin(k / 300.0 + rng.uniform(0.0, 6.0)))
    return np.floor(rng.integers(0, 10**6) + np.cumsum(speed))


@pytest.mark.parametrize("modulus", [1000, 4096, 36_000, 50_000, 60_000, 65_536, 100_000, 1_000_000])
@pytest.mark.parametrize("wraps", [1, 2, 7])
def test_a_count_is_unwrapped_at_a_round_modulus(modulus: int, wraps: int) -> None:
    true = rolled((wraps + 0.5) * modulus / 6000.0)
    true = true - true[0] + 10.0
    assert np.floor(true[-1] / modulus) >= wraps

    np.testing.assert_array_equal(unwrapped_count(true % modulus), true)


def test_a_count_is_unwrapped_at_any_modulus_that_several_wraps_show() -> None:
    true = rolled(53.0)
    true -= true[0]

    read = unwrapped_count(true % 43_217)

    assert true[-1] > 7 * 43_217
    np.testing.assert_allclose(read, true, rtol=1e-4)
    once = true[:1500] % 43_217
    assert 43_217 < true[1499] < 2 * 43_217
    np.testing.assert_array_equal(unwrapped_count(once), once)


@given(st.sampled_from([60_000, 100_000, 25_000, 65_536]), st.integers(30, 4000), st.integers(0, 10**6))
@example(60_000, 3000, 0)  # so fast that it looks like 16 bits with a row missing at each wrap
@example(25_000, 1750, 502)  # wraps at the last row
@settings(max_examples=60, deadline=None)
def test_a_fast_count_is_unwrapped(modulus: int, rate: int, seed: int) -> None:
    true = rolled(min(rate, 0.07 * modulus), seed=seed)

    read = unwrapped_count(true % modulus)

    np.testing.assert_array_equal(np.diff(read), np.diff(true))


@pytest.mark.parametrize("modulus", [60_000, 65_536, 43_210])
@pytest.mark.parametrize("lowest", [0, -30_000])
def test_a_count_that_also_runs_back_is_unwrapped_at_both_ends(modulus: int, lowest: int) -> None:
    true = np.floor(150_000.0 * np.sin(np.arange(20_000) / 2500.0))

    read = unwrapped_count((true - lowest) % modulus + lowest)

    np.testing.assert_array_equal(np.diff(read), np.diff(true))


def test_a_distance_with_decimals_is_unwrapped() -> None:
    true = np.round(np.cumsum(0.2 + 0.05 * np.sin(np.arange(30_000) / 900.0)), 2)

    np.testing.assert_allclose(unwrapped_count(np.round(true % 2000.0, 2)), true, atol=1e-6)


def test_a_count_that_is_set_to_zero_or_drops_out_stays() -> None:
    reset = np.concatenate([np.arange(0.0, 60_000.0, 7.0), np.arange(0.0, 30_000.0, 7.0)])
    twice = np.concatenate([reset, np.arange(0.0, 50_000.0, 7.0)])
    dropped = np.concatenate([np.arange(30_000.0, 60_000.0, 20.0), [0.0], np.arange(60_000.0, 30_000.0, -20.0)])
    to_and_fro = 100.0 + 90.0 * np.sin(np.arange(500.0))

    for count in (reset, twice, dropped, to_and_fro):
        np.testing.assert_array_equal(unwrapped_count(count), count)


def log_of(drive: Drive, folder: Path, count: np.ndarray) -> Path:
    """The drive with a count of the wheel."""
    names = "time_s;" + ";".join(f"{sensor}_{a}" for sensor in ("gyro", "acc") for a in "xyz") + ";pulses"
    rows = [
        ";".join([f"{t:.3f}", *(f"{v:.9f}" for v in (*gyro, *accel)), f"{int(counted)}"])
        for t, gyro, accel, counted in zip(drive.t, drive.gyro, drive.accel, count, strict=True)
    ]
    path = folder / "log.csv"
    path.write_text("\n".join([names, *rows]) + "\n")
    return path


def test_a_log_comes_in_with_a_count_of_60000(drive: Drive, tmp_path: Path, imported: Import) -> None:
    true = np.floor(np.cumsum(drive.speed) / 100.0 / 2e-4)
    path = log_of(drive, tmp_path, true % 60_000)

    back = imported(path, tach_pulses_per_rev="5000", tach_wheel_diameter_m=str(1.0 / np.pi)).loaded.recording

    assert true[-1] > 60_000
    assert back is not None
    assert back.tach is not None
    np.testing.assert_allclose(back.tach["distance_m"] - back.tach["distance_m"][0], 2e-4 * true, atol=1e-6)


def test_one_wrap_at_an_odd_modulus_is_refused_where_it_is_and_comes_in_as_declared(
    drive: Drive, tmp_path: Path
) -> None:
    true = np.floor(np.cumsum(drive.speed) / 100.0 / 2e-4)
    path = log_of(drive, tmp_path, true % 123_457)
    sections = {
        "format": "trackfg-mapping/1",
        "imu": {
            "file": "log.csv",
            "time": "time_s",
            "gyro": [f"gyro_{a}" for a in "xyz"],
            "accel": [f"acc_{a}" for a in "xyz"],
            "axes": "FLU",
        },
        "tach": {
            "file": "log.csv",
            "time": "time_s",
            "column": "pulses",
            "kind": "pulses",
            "pulses_per_rev": 5000,
            "wheel_diameter_m": 1.0 / np.pi,
        },
    }
    tables = source_format(path, None).tables(path, lambda _: None)
    row = int(np.argmax(true >= 123_457)) + 1
    refusal = rf"log.csv, column 'pulses', data row {row} .*the tach runs backwards.*wraps_at"
    with pytest.raises(BadInputError, match=refusal):
        write_imported(tables, mapping_of(sections, "mapping"), tmp_path / "refused", run_id="log")

    sections["tach"]["wraps_at"] = 123_457
    imported = write_imported(tables, mapping_of(sections, "mapping"), tmp_path / "declared", run_id="log")

    assert imported.loaded.recording is not None
    assert imported.loaded.recording.tach is not None
    np.testing.assert_allclose(imported.loaded.recording.tach["distance_m"], 2e-4 * true, atol=1e-6)
