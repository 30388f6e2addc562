"""Streams located on a map, with few fixes or none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pytest

from trackfg.errors import BadInputError
from trackfg.maps.feature_map import FeatureMap
from trackfg.recording.model import Recording
from trackfg.streaming.estimates import Estimates
from trackfg.streaming.fixed_lag import FixedLagSmoother
from trackfg.streaming.intake.intake import Intake
from trackfg.streaming.sources.source import RecordingSource

Ride = Callable[..., Any]
LAG_S = 20.0


class Streamed(NamedTuple):
    filtered: pd.DataFrame
    smoothed: pd.DataFrame
    geometry: pd.DataFrame
    kinds: list[str]


def streamed(recording: Recording, feature_map: FeatureMap) -> Streamed:
    source = RecordingSource(recording, batch_s=1.0)
    intake = Intake.of(source)
    smoother = FixedLagSmoother(recording.description, lag_s=LAG_S, feature_map=feature_map)
    pieces: list[Estimates] = [smoother.put(intake.push(batch)[0]) for batch in source]
    pieces += [smoother.put(intake.finish()[0]), smoother.finish()]
    tables = (pd.concat([piece[i] for piece in pieces], ignore_index=True) for i in range(3))
    return Streamed(*tables, [event.kind for piece in pieces for event in piece.events])


def with_fixes(recording: Recording, count: int, from_s: float = 0.0, until_s: float = 300.0) -> Recording:
    imu, tach = (
        table[table["t_s"].between(from_s, until_s, inclusive="right")].reset_index(drop=True)
        for table in (recording.imu, recording.tach)
    )
    if count:
        return replace(recording, imu=imu, tach=tach, fixes=recording.fixes.iloc[:count])
    described = recording.description.model_copy(update={"fixes": None})
    return replace(recording, description=described, imu=imu, tach=tach, fixes=None)


def errors(table: pd.DataFrame, run: Any) -> np.ndarray:
    return np.asarray(table["chainage_m"] - run.true_chainage(table["t_s"].to_numpy()))


def jumps(geometry: pd.DataFrame) -> int:
    """How often a row is not next to the one before: where the place has become known, and nowhere else."""
    return int((np.abs(np.abs(np.diff(geometry["chainage_m"])) - 0.25) > 1e-9).sum())


def test_with_a_fix_at_its_start_a_stream_stays_where_it_is(line_map: FeatureMap, ride: Ride) -> None:
    run = ride(5)
    ours = streamed(with_fixes(run.simulation.recording, 1), line_map)
    located = ours.smoothed[ours.smoothed["chainage_m_sd"] < 100.0]
    assert len(located) > 0.8 * len(ours.smoothed)
    assert np.abs(errors(located, run)).max() < 2.0
    assert (np.abs(errors(located, run)) < 4.0 * located["chainage_m_sd"]).all()
    assert ours.kinds.count("located") == 1
    assert ours.kinds.count("landmark used") > 15
    assert jumps(ours.geometry) <= 1


@pytest.mark.parametrize(("number", "from_s"), [(4, 0.0), pytest.param(5, 120.0, marks=pytest.mark.slow)])
def test_without_any_fix_it_finds_itself(line_map: FeatureMap, ride: Ride, number: int, from_s: float) -> None:
    run = ride(number)
    ours = streamed(with_fixes(run.simulation.recording, 0, from_s), line_map)
    assert ours.kinds.count("located") == 1
    assert "lost" not in ours.kinds
    for table in (ours.filtered, ours.smoothed):
        known = table["chainage_m_sd"].to_numpy() < 100.0
        first = int(np.argmax(known))
        assert 0 < first < 0.7 * len(table)
        assert (table["chainage_m_sd"].iloc[:first] > 1e4).all()
        assert known[first:].all()
    located = ours.smoothed[ours.smoothed["chainage_m_sd"] < 100.0]
    assert np.abs(errors(located, run)).max() < 2.0
    assert (np.abs(errors(located, run)) < 4.0 * located["chainage_m_sd"]).all()
    assert jumps(ours.geometry) <= 1


def test_on_another_line_it_is_never_located(line_map: FeatureMap, ride: Ride) -> None:
    ours = streamed(with_fixes(ride(0, seed=4).simulation.recording, 0, until_s=170.0), line_map)
    assert not {"located", "landmark used", "landmark set aside", "lost"}.intersection(ours.kinds)
    assert (ours.smoothed["chainage_m_sd"] > 1e4).all()


def test_a_map_with_other_conventions_is_refused(line_map: FeatureMap, ride: Ride) -> None:
    other = replace(line_map, conventions=replace(line_map.conventions, chord_m=20.0))
    with pytest.raises(BadInputError, match="chord_m is 10; expected that of the map, 20"):
        FixedLagSmoother(ride(4).simulation.recording.description, feature_map=other)


@pytest.mark.slow
def test_a_sensor_on_springs_is_located_though_it_has_no_geometry(line_map: FeatureMap, ride: Ride) -> None:
    run = ride(4)
    recording = with_fixes(run.simulation.recording, 0)
    recording = replace(recording, imu=recording.imu[recording.imu["t_s"] < 180.0])
    imu = recording.description.imu.model_copy(update={"rigid": False})
    recording = replace(recording, description=recording.description.model_copy(update={"imu": imu}))
    ours = streamed(recording, line_map)
    assert "located" in ours.kinds
    assert ours.geometry.empty
    located = ours.smoothed[ours.smoothed["chainage_m_sd"] < 100.0]
    assert np.abs(errors(located, run)).max() < 4.0
    assert (located["chainage_m_sd"] > 0.7).all()
