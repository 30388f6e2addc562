"""Runs located on a map, with few fixes or none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from trackfg.errors import BadInputError
from trackfg.mapping.recognition.conventions import recognised_near
from trackfg.mapping.recognition.recognition import Recognition
from trackfg.maps.feature_map import FeatureMap
from trackfg.recording.line_kilometrage import LineKilometrage
from trackfg.smoothing import localisation
from trackfg.smoothing.smoother import smooth

Ride = Callable[..., Any]


def cut(recording: Any, start_s: float) -> Any:
    """The recording from then on, without fixes."""
    imu, tach = (table[table["t_s"] > start_s].reset_index(drop=True) for table in (recording.imu, recording.tach))
    return replace(recording, fixes=None, imu=imu, tach=tach)


@pytest.mark.parametrize("run", [4, 5])
@pytest.mark.parametrize("fixes", ["first", "none", "none, from the middle"])
def test_a_run_finds_itself(line_map: FeatureMap, ride: Ride, run: int, fixes: str) -> None:
    recording = ride(run).simulation.recording
    given = {
        "first": replace(recording, fixes=recording.fixes.iloc[:1]),
        "none": replace(recording, fixes=None),
        "none, from the middle": cut(recording, 120.0),
    }[fixes]
    result = smooth(given, feature_map=line_map)
    assert result.summary.map is not None
    assert result.summary.map.probability > 0.99
    assert result.summary.map.sections > 5
    error = ride(run).errors(result)
    sd = result.trajectory["chainage_m_sd"].to_numpy()
    assert np.abs(error).max() < 0.6
    assert np.abs(error / sd).max() < 4.0
    used = result.events[result.events["kind"] == "landmark used"]
    assert len(used) == result.summary.map.sections
    assert len(result.covariance.chainage_m) == 0


@pytest.mark.parametrize(("fixes", "named"), [(True, "2+000"), (False, "10+000")])
def test_official_places_are_of_the_chainage_that_a_run_has(
    line_map: FeatureMap, ride: Ride, fixes: bool, named: str
) -> None:
    """Without a fix a run's own kilometrage counts from its start, of which a located run's chainage is not."""
    of_map, own = (
        LineKilometrage.model_validate({"equation": [{"chainage_m": 0.0, "km": km}]}) for km in ("10+000", "2+000")
    )
    described = {**line_map.configuration, "first": {"kilometrage": of_map.model_dump(mode="json")}}
    recording = ride(4).simulation.recording
    description = recording.description.model_copy(update={"kilometrage": own})
    given = replace(recording, description=description, fixes=recording.fixes if fixes else None)
    result = smooth(given, feature_map=replace(line_map, configuration=described))
    assert result.summary.run is not None
    assert result.summary.run.kilometrage is not None
    assert result.summary.run.kilometrage.equation[0].km == named


def test_a_run_elsewhere_is_not_located(line_map: FeatureMap, ride: Ride) -> None:
    recording = replace(ride(0, seed=4).simulation.recording, fixes=None)
    result = smooth(recording, feature_map=line_map)
    assert result.summary.map is not None
    assert result.summary.map.sections == 0
    assert [finding.code for finding in result.summary.findings] == ["not-on-map"]
    assert result.trajectory["chainage_m"].iloc[0] == pytest.approx(0.0, abs=1.0)


def test_a_run_at_rest_is_not_located(line_map: FeatureMap, ride: Ride) -> None:
    recording = ride(4).simulation.recording
    imu, tach = (table[table["t_s"] < 20.0] for table in (recording.imu, recording.tach))
    result = smooth(replace(recording, fixes=None, imu=imu, tach=tach), feature_map=line_map)
    assert result.summary.map is not None
    assert result.summary.map.sections == 0
    assert "not-on-map" in [finding.code for finding in result.summary.findings]


def test_wrong_matches_are_outliers_and_no_jumps(
    line_map: FeatureMap, ride: Ride, monkeypatch: pytest.MonkeyPatch
) -> None:
    recording = ride(4).simulation.recording
    given = replace(recording, fixes=recording.fixes.iloc[:1])
    before = smooth(given, feature_map=line_map)

    def mistaken(*args: Any, **kwargs: Any) -> Recognition:
        right = recognised_near(*args, **kwargs)
        sections: pd.DataFrame = right.sections.copy()
        wrong = sections.index[sections["used"]][4:20:5]
        sections.loc[wrong, "reference_m"] += 12.0
        return Recognition(sections, right.probability, right.found_after_m)

    monkeypatch.setattr(localisation, "recognised_near", mistaken)
    after = smooth(given, feature_map=line_map)
    assert (after.events["kind"] == "landmark set aside").sum() == 4
    apart = np.abs(after.trajectory["chainage_m"] - before.trajectory["chainage_m"])
    assert apart.max() < 0.02


def test_a_map_with_other_conventions_is_refused(line_map: FeatureMap, ride: Ride) -> None:
    other = replace(line_map, conventions=replace(line_map.conventions, chord_m=20.0))
    with pytest.raises(BadInputError, match="chord_m is 10; expected that of the map, 20"):
        smooth(ride(4).simulation.recording, feature_map=other)
