from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from trackfg.errors import BadInputError, OutputError
from trackfg.geometry.limits import Limit, LimitChoice
from trackfg.report.track_limits import judge, write_exceedances
from trackfg.report.track_statistics import track_statistics
from trackfg.results.result import Result

TWIST = Limit(standard="rule", level="alert", parameter="twist", base_m=5.0, kind="peak", value_mm=1.9)
FAST = TWIST.model_copy(update={"speed_from_kmh": 80.0, "level": "fast"})


def test_a_result_is_judged_by_its_own_conventions(result: Result) -> None:
    """Twist is 2 mm times a sine of 20 m, and has a sigma of 0.1 mm."""
    found = judge(result, [TWIST]).found
    assert len(found) == pytest.approx(2 * result.geometry["chainage_m"].iloc[-1] / 20.0, abs=1.0)
    assert found["value_mm"].abs().to_numpy() == pytest.approx(2.0)
    assert (found["value_mm_sd"] == 0.1).all()
    other = result.summary.model_copy(
        update={"geometry": result.summary.geometry.model_copy(update={"twist_base_m": 3.0})}
    )
    recomputed = judge(replace(result, summary=other), [TWIST]).found
    assert recomputed["column"].unique().tolist() == ["cross_level_mm"]
    assert recomputed["value_mm_sd"].isna().all()


def test_a_smoothed_run_is_judged_on_chords_of_the_law(result: Result) -> None:
    """The level is 3 mm times a sine of 20 m, of which a chord of 62 ft shows ``1 - cos(pi 62 ft / 20 m)`` = 1.985."""
    chord = Limit(standard="rule", level="alert", parameter="level", chord_m=18.8976, kind="peak", value_mm=5.0)
    found = judge(result, [chord]).found
    assert found["value_mm"].abs().to_numpy() == pytest.approx(3.0 * 1.985, rel=0.05)  # D1 has a little less of 20 m
    assert len(found) > 100
    assert len(judge(result, LimitChoice("cfr-213-class-9").table()).not_judged) == 3  # of gauge, without rails
    of_another_system = replace(result, summary=result.summary.model_copy(update={"solver": None}))
    assert len(judge(of_another_system, [chord]).not_judged) == 1


def test_a_hole_in_the_chainage_ends_an_exceedance(result: Result) -> None:
    geometry = result.geometry.assign(twist_mm=3.0)
    kept = geometry[(geometry["chainage_m"] < 500.0) | (geometry["chainage_m"] > 600.0)].reset_index(drop=True)
    found = judge(replace(result, geometry=kept), [TWIST]).found
    assert found[["from_m", "to_m"]].to_numpy().tolist() == [[0.0, 499.75], [600.25, geometry["chainage_m"].iloc[-1]]]


def test_limits_by_speed_need_the_speed_of_the_line(result: Result) -> None:
    assert judge(result, [TWIST, FAST], 80.0).found["level"].unique().tolist() == ["alert"]
    assert set(judge(result, [TWIST, FAST], 81.0).found["level"]) == {"alert", "fast"}
    with pytest.raises(BadInputError, match="give the line's speed"):
        judge(result, [FAST])


def test_a_result_without_geometry_cannot_be_judged(result: Result) -> None:
    with pytest.raises(BadInputError, match=r"no track geometry; expected it for limits\. Hint: it comes from"):
        judge(replace(result, geometry=result.geometry.iloc[:0]), [TWIST])


def test_the_file_holds_the_table(result: Result, tmp_path: Path) -> None:
    judgement = judge(result, LimitChoice("cfr-213-class-4").table())
    write_exceedances(judgement, tmp_path / "a.csv")
    assert tuple(pd.read_csv(tmp_path / "a.csv").columns) == tuple(judgement.found.columns)
    judgement = judge(result, [TWIST])
    write_exceedances(judgement, tmp_path / "a.csv")
    written = pd.read_csv(tmp_path / "a.csv")
    assert np.array_equal(written["value_mm"], judgement.found["value_mm"])
    with pytest.raises(OutputError, match="cannot be written"):
        write_exceedances(judgement, tmp_path / "a.csv" / "a.csv")


def test_what_is_not_known_is_neither_beyond_nor_within(result: Result) -> None:
    """Of the section from 400 m 50 m are NaN, of that from 800 m 50 m have no rows; of that from 1000 m nothing is
    known."""
    x = result.geometry["chainage_m"]
    twist = np.where((x >= 450.0) & (x < 500.0) | (x >= 1000.0) & (x < 1200.0), np.nan, 3.0)
    geometry = result.geometry.assign(twist_mm=twist)[(x < 900.0) | (x >= 950.0)].reset_index(drop=True)
    of_holes = replace(result, geometry=geometry)
    judgement = judge(of_holes, [TWIST])
    table = track_statistics(of_holes, judgement=judgement).set_index("from_m").loc[400.0:1000.0]
    assert table["share_beyond_twist_mm_alert"].tolist() == pytest.approx([1.0, 1.0, 1.0, np.nan], nan_ok=True)
    assert table["unknown_m_twist_mm_alert"].tolist() == [50.0, 0.0, 50.0, 200.0]
    assert judgement.unknown_m() == {("twist over 5 m", "alert"): 300.0}
    assert judgement.unknown_levels() == {("twist over 5 m", "300"): "alert"}
