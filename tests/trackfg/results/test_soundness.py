"""Numbers that are none are neither written nor read, whatever they stand in."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from trackfg.errors import BadInputError, TrackfgError
from trackfg.results.place_covariance import PlaceCovariance
from trackfg.results.result import Result

Spoil = Callable[[Result], Result]
PLACES = np.array([0.0, 250.0])


def put(table: str, column: str, value: Any, row: int = 3) -> Spoil:
    def spoil(result: Result) -> Result:
        frame = getattr(result, table).copy()
        if isinstance(value, str):
            frame[column] = frame[column].astype(object)
        frame.loc[min(row, len(frame) - 1), column] = value
        return replace(result, **{table: frame})

    return spoil


def with_matrix(matrix: np.ndarray) -> Spoil:
    return lambda result: replace(result, covariance=PlaceCovariance.of(PLACES, matrix))


def reversed_rows(table: str) -> Spoil:
    return lambda result: replace(result, **{table: getattr(result, table)[::-1].reset_index(drop=True)})


SPOILT: dict[str, tuple[Spoil, str]] = {
    "a speed that is none": (put("trajectory", "speed_mps", np.nan), r"'speed_mps', row 4: is nan"),
    "an infinite sigma": (put("trajectory", "roll_rad_sd", np.inf), r"'roll_rad_sd', row 4: is inf"),
    "a sigma of zero": (put("trajectory", "chainage_m_sd", 0.0), "expected a sigma above 0"),
    "a sigma whose weight is infinite": (put("geometry", "twist_mm_sd", 5e-324), "expected a sigma of 1e-15 or more"),
    "a negative sigma": (put("geometry", "twist_mm_sd", -1.0), "expected a sigma above 0"),
    "a value without a sigma": (put("geometry", "twist_mm_sd", np.nan), "expected a sigma beside every value"),
    "a place without chainage": (put("geometry", "chainage_m", np.nan), "expected a number"),
    "one place twice": (put("geometry", "chainage_m", 0.5, row=1), "expected more than in the row before"),
    "time that runs back": (reversed_rows("trajectory"), "expected more than in the row before"),
    "a number without bounds": (put("geometry", "cross_level_mm", -1e300), r"at most 1e\+12"),
    "an event's sigma of zero": (put("events", "chainage_m_sd", 0.0), "expected a sigma above 0"),
    "a variance of zero": (with_matrix(np.zeros((4, 4))), "variances above 0"),
    "an infinite covariance": (with_matrix(np.full((4, 4), np.inf)), "finite"),
    "a matrix that is not symmetric": (with_matrix(np.triu(np.ones((4, 4))) + np.eye(4)), "symmetric"),
    "no covariance": (with_matrix(3.0 * np.ones((4, 4)) - 2.0 * np.eye(4)), "positive definite"),
}


@pytest.mark.parametrize("name", SPOILT)
def test_a_number_that_is_none_is_not_written(
    name: str, make_result: Callable[..., Result], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spoil, message = SPOILT[name]
    spoilt = spoil(make_result())
    with pytest.raises(TrackfgError, match=message) as caught:
        spoilt.write(tmp_path / "out")
    assert "please report it" in str(caught.value)
    assert not (tmp_path / "out").exists()
    with monkeypatch.context() as unguarded:
        unguarded.setattr(Result, "refuse_unsound", lambda self: None)
        spoilt.write(tmp_path / "out")
    with pytest.raises(BadInputError, match=message):
        Result.read(tmp_path / "out")


@pytest.mark.parametrize("table", ["trajectory", "geometry"])
def test_text_for_numbers_is_not_read(table: str, make_result: Callable[..., Result], tmp_path: Path) -> None:
    folder = make_result().write(tmp_path / "out")
    file = folder / f"{table}.parquet"
    frame = pd.read_parquet(file)
    frame.assign(speed_mps="fast").to_parquet(file)
    with pytest.raises(BadInputError, match=rf"{table}\.parquet: column 'speed_mps' is .*: expected numbers"):
        Result.read(folder)


@pytest.mark.parametrize(("key", "value"), [("step_m", 0.0), ("step_m", 1e-300), ("gauge_m", -1.0), ("chord_m", 1e300)])
def test_conventions_that_are_none_are_not_read(
    key: str, value: float, make_result: Callable[..., Result], tmp_path: Path
) -> None:
    folder = make_result().write(tmp_path / "out")
    summary = json.loads((folder / "summary.json").read_text())
    summary["geometry"][key] = value
    (folder / "summary.json").write_text(json.dumps(summary))
    with pytest.raises(BadInputError, match=key):
        Result.read(folder)


def test_what_is_not_known_is_empty_with_its_sigma(make_result: Callable[..., Result], tmp_path: Path) -> None:
    result = make_result()
    geometry = result.geometry.copy()
    geometry.loc[:5, ["twist_mm", "twist_mm_sd"]] = np.nan
    sound = replace(result, geometry=geometry, covariance=PlaceCovariance.of(PLACES, np.eye(4) + 1.0))
    pd.testing.assert_frame_equal(Result.read(sound.write(tmp_path / "out")).geometry, geometry)


@pytest.mark.parametrize("value", ["NaN", "-Infinity", "1e999"])
@pytest.mark.parametrize("part", ["settings", "configuration"])
def test_a_number_that_is_none_in_what_was_used(result: Result, part: str, value: str, tmp_path: Path) -> None:
    folder = result.write(tmp_path / "out")
    summary = json.loads((folder / "summary.json").read_text())
    (folder / "summary.json").write_text(json.dumps(summary | {part: {"a": [1.0, "here"]}}).replace('"here"', value))
    with pytest.raises(BadInputError, match=rf"(?s){part}.*is no number of JSON"):
        Result.read(folder)
