"""Exceedances of limits: where, how large, how long; by speed, by curve and tangent; and what cannot be judged."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import pytest

from trackfg.errors import BadInputError
from trackfg.geometry.bands import D2, band_pass
from trackfg.geometry.exceedances import COLUMNS, exceedances
from trackfg.geometry.judged_quantities import ColumnLengths
from trackfg.geometry.limits import Limit, at_level, cfr_213
from trackfg.geometry.versines import uniformity_deviation_response, versine_response

CHAINAGE = 1000.0 + 0.25 * np.arange(4000)
N = len(CHAINAGE)


def limit(**keys: Any) -> Limit:
    """A limit of the D1 level of 10 mm, changed by ``keys``."""
    base: dict[str, Any] = {"standard": "own", "level": "alert", "kind": "peak", "value_mm": 10.0}
    if "parameter" not in keys:
        base |= {"parameter": "level", "band": "D1"}
    return Limit(**{**base, **keys})


def table(**columns: np.ndarray) -> pd.DataFrame:
    return pd.DataFrame({"chainage_m": CHAINAGE, **columns})


def bump(at_m: float, height: float, half_width_m: float = 1.0) -> np.ndarray:
    """A triangle."""
    return height * np.maximum(0.0, 1.0 - np.abs(CHAINAGE - at_m) / half_width_m)


def test_a_peak_is_found_with_place_size_and_length() -> None:
    geometry = table(level_mm=bump(1200.0, 16.0) - bump(1500.0, 11.0), level_left_mm=bump(1300.0, 12.0))
    found = exceedances(geometry, [limit()], speed_kmh=100.0).found
    assert tuple(found.columns) == COLUMNS
    assert found["chainage_m"].tolist() == [1200.0, 1300.0, 1500.0]
    assert found["value_mm"].tolist() == [16.0, 12.0, -11.0]
    assert found["column"].tolist() == ["level_mm", "level_left_mm", "level_mm"]
    assert found["length_m"].tolist() == [0.5, 0.0, 0.0]
    assert (found["limit_mm"] == 10.0).all()
    assert (found["speed_kmh"] == 100.0).all()


def test_an_exceedance_has_the_sigmas_of_its_value_and_place() -> None:
    sigma = np.where(CHAINAGE < 1300.0, 0.25, 0.5)
    geometry = table(level_mm=bump(1200.0, 16.0) - bump(1500.0, 11.0), level_mm_sd=sigma, chainage_m_sd=2.0 * sigma)
    found = exceedances(geometry, [limit()], speed_kmh=100.0).found
    assert found["value_mm_sd"].tolist() == [0.25, 0.5]
    assert found["chainage_m_sd"].tolist() == [0.5, 1.0]
    sections = exceedances(geometry, [limit(kind="sd", value_mm=0.1)], speed_kmh=100.0).found
    assert sections["value_mm_sd"].isna().all()
    assert len(sections) == 3  # the first one lies on both sides of 1200 m


def test_columns_are_judged_by_the_lengths_that_they_have() -> None:
    geometry = table(twist_mm=bump(1200.0, 16.0), twist_mm_sd=np.full(N, 0.1), cross_level_mm=np.zeros(N))
    on_5_m, on_3_m = (limit(parameter="twist", base_m=base) for base in (5.0, 3.0))
    assert exceedances(geometry, [on_5_m], speed_kmh=0.0).found[["column", "value_mm_sd"]].to_numpy().tolist() == [
        ["twist_mm", 0.1]
    ]
    assert exceedances(geometry, [on_3_m], speed_kmh=0.0).found.empty
    lengths = ColumnLengths(band=D2, chord_m=20.0, twist_base_m=3.0)
    assert len(exceedances(geometry, [on_3_m], speed_kmh=0.0, lengths=lengths).found) == 1
    offsets = table(level_mm=bump(1200.0, 16.0), versine_level_mm=bump(1500.0, 16.0))
    limits = [limit(band="D2"), limit(band=None, chord_m=20.0), limit(band="D1"), limit(band=None, chord_m=10.0)]
    judged = exceedances(offsets, limits, speed_kmh=0.0, lengths=lengths)
    assert judged.found["chainage_m"].tolist() == [1200.0, 1500.0]
    assert [refused for refused, _ in judged.not_judged] == limits[2:]


def test_a_limit_holds_above_its_lower_speed_up_to_its_upper_one() -> None:
    geometry = table(level_mm=bump(1200.0, 16.0) + bump(1500.0, 16.0) + bump(1800.0, 16.0))
    speed = np.select([CHAINAGE < 1400.0, CHAINAGE < 1700.0], [80.0, 120.0], np.nan)
    between = limit(speed_from_kmh=80.0, speed_to_kmh=120.0)
    assert exceedances(geometry, [between], speed_kmh=speed).found["chainage_m"].tolist() == [1500.0]
    below = limit(speed_to_kmh=80.0)
    assert exceedances(geometry, [below], speed_kmh=speed).found["chainage_m"].tolist() == [1200.0]
    assert len(exceedances(geometry, [limit()], speed_kmh=speed).found) == 3


def test_standard_deviations_and_means_are_by_section() -> None:
    wave = np.where((CHAINAGE >= 1400.0) & (CHAINAGE < 1600.0), 3.0, 1.0) * np.sin(2.0 * np.pi * CHAINAGE / 10.0)
    sd = limit(kind="sd", value_mm=1.5)
    judged = exceedances(table(level_mm=wave), [sd], speed_kmh=np.linspace(50.0, 90.0, N)).found
    assert judged[["from_m", "to_m", "length_m", "chainage_m"]].to_numpy().tolist() == [[1400.0, 1600.0, 200.0, 1500.0]]
    assert judged["value_mm"][0] == pytest.approx(3.0 / np.sqrt(2.0), rel=1e-3)
    assert judged["speed_kmh"][0] == pytest.approx(74.0, abs=0.1)
    wide = limit(parameter="gauge_wide", kind="mean", value_mm=2.0, section_m=100.0)
    gauge = 1435.0 + np.where(CHAINAGE < 1100.0, 3.0, -3.0)
    judged = exceedances(table(gauge_mm=gauge), [wide], speed_kmh=0.0, gauge_m=1.435).found
    assert judged["to_m"].tolist() == [1100.0]


def test_other_bands_and_chords_come_from_profiles() -> None:
    profile = 0.5 * (CHAINAGE - 1500.0) ** 2 / 5000.0 + 5e-3 * np.sin(2.0 * np.pi * CHAINAGE / 45.0)
    geometry = table(profile_level_left_m=profile)
    judged = exceedances(geometry, [limit(band="D2", value_mm=3.0)], speed_kmh=0.0).found
    assert judged["column"].unique().tolist() == ["profile_level_left_m"]
    assert judged["value_mm"].abs().max() == pytest.approx(1000.0 * np.nanmax(np.abs(band_pass(profile, 0.25, D2))))


@pytest.mark.parametrize("chord_m", [9.4488, 18.8976, 37.7952, 20.0])
@pytest.mark.parametrize("uniformity", [False, True])
def test_a_chord_in_feet_is_exact_on_a_grid_in_metres(chord_m: float, uniformity: bool) -> None:
    wavelength = 33.0
    geometry = table(profile_alignment_m=1e-2 * np.sin(2.0 * np.pi * CHAINAGE / wavelength))
    gain = abs(versine_response(wavelength, chord_m / 2.0, chord_m / 2.0))
    if uniformity:
        gain *= uniformity_deviation_response(wavelength, chord_m)
    own = limit(parameter="alignment", chord_m=chord_m, uniformity=uniformity, value_mm=1.0)
    found = exceedances(geometry, [own], speed_kmh=np.linspace(0.0, 10.0, N)).found
    assert found["value_mm"].abs().max() == pytest.approx(10.0 * abs(gain), rel=1e-3)
    assert len(found) > 40


def test_the_ten_metre_chord_is_there_without_a_profile() -> None:
    geometry = table(versine_level_mm=bump(1200.0, 16.0))
    judged = exceedances(geometry, [limit(band=None, chord_m=10.0)], speed_kmh=0.0)
    assert judged.found["value_mm"].tolist() == [16.0]
    uniform = exceedances(geometry, [limit(band=None, chord_m=10.0, uniformity=True)], speed_kmh=0.0)
    assert uniform.found["value_mm"].tolist() == pytest.approx([16.0 * 8.0 / 9.0])


def test_twist_over_any_base_and_warp_within_a_length() -> None:
    step = np.where(CHAINAGE < 1500.0, 0.0, 20.0)
    ramp = np.clip(CHAINAGE - 1800.0, 0.0, 30.0)  # 1 mm per m
    geometry = table(cross_level_mm=step + ramp)
    twists = exceedances(geometry, [limit(parameter="twist", base_m=3.0)], speed_kmh=0.0).found
    assert twists[["from_m", "to_m", "value_mm"]].to_numpy().tolist() == [[1500.0, 1502.75, 20.0]]
    warp = exceedances(geometry, [limit(parameter="warp", base_m=18.8976, value_mm=15.0)], speed_kmh=0.0).found
    assert warp["value_mm"].tolist() == [20.0, 18.75]
    assert warp["from_m"][0] == pytest.approx(1500.0 - 18.75 / 2.0, abs=0.3)
    assert warp["to_m"][0] == pytest.approx(1500.0 + 18.75 / 2.0, abs=0.3)


def test_warp_is_the_largest_difference_of_any_two_places() -> None:
    cross_level = np.random.default_rng(0).normal(0.0, 3.0, N)
    cross_level[2000] = np.nan
    own = limit(parameter="warp", base_m=2.5, value_mm=1e-3)
    found = exceedances(table(cross_level_mm=cross_level), [own], speed_kmh=0.0).found
    windows = np.lib.stride_tricks.sliding_window_view(cross_level, 10)
    assert found["value_mm"].max() == np.nanmax(windows.max(axis=1) - windows.min(axis=1))
    assert found["length_m"].sum() == pytest.approx((N - 9 - 10 - 2) * 0.25)


def test_cross_level_on_tangent_track_and_reversed_in_curves() -> None:
    curvature = np.select([CHAINAGE < 1300.0, CHAINAGE < 1600.0], [0.0, 1.0 / 400.0], -1.0 / 400.0)
    cross_level = np.select(
        [CHAINAGE == 1100.0, CHAINAGE == 1400.0, CHAINAGE == 1500.0, CHAINAGE == 1700.0, CHAINAGE == 1800.0],
        [-30.0, -80.0, 30.0, -30.0, 80.0],
    )
    geometry = table(curvature_1pm=curvature, cross_level_mm=cross_level)
    limits = at_level(cfr_213(), "class 5")
    found = exceedances(geometry, limits, speed_kmh=0.0).found
    found = found[found["parameter"].str.contains("cross_level")]
    assert found["parameter"].tolist() == ["cross_level", "reverse_cross_level", "reverse_cross_level"]
    assert found["chainage_m"].tolist() == [1100.0, 1500.0, 1700.0]
    assert found["value_mm"].tolist() == [-30.0, 30.0, 30.0]


def test_cross_level_relative_to_the_design() -> None:
    geometry = table(cross_level_mm=np.full(N, 80.0) + bump(1200.0, 12.0), cant_mm=np.full(N, 80.0))
    judged = exceedances(geometry, [limit(parameter="cross_level")], speed_kmh=0.0)
    assert judged.found["value_mm"].tolist() == [12.0]


def test_gauge_is_judged_on_either_side_of_the_nominal() -> None:
    geometry = table(gauge_mm=1067.0 + bump(1200.0, 12.0) - bump(1500.0, 7.0))
    limits = [limit(parameter="gauge_wide", value_mm=10.0), limit(parameter="gauge_narrow", value_mm=5.0)]
    found = exceedances(geometry, limits, speed_kmh=0.0, gauge_m=1.067).found
    assert found[["parameter", "chainage_m", "value_mm"]].to_numpy().tolist() == [
        ["gauge_wide", 1200.0, 12.0],
        ["gauge_narrow", 1500.0, 7.0],
    ]


def test_a_change_of_gauge_is_judged_between_places_less_than_the_base_apart() -> None:
    ramp = np.interp(CHAINAGE, [1200.0, 1230.0], [0.0, 12.0])  # 0.4 mm a metre
    steep = np.interp(CHAINAGE, [1500.0, 1506.0], [0.0, 8.0])
    change = limit(parameter="gauge_change", base_m=9.4488, value_mm=5.0)
    (found,) = exceedances(table(gauge_mm=1435.0 + ramp + steep), [change], speed_kmh=0.0).found.itertuples()
    assert found.value_mm == pytest.approx(8.0)
    assert 1496.0 < found.from_m < found.to_m < 1510.0


def test_the_elevation_of_a_curve_is_that_of_its_outer_rail() -> None:
    left = np.where((CHAINAGE >= 1200.0) & (CHAINAGE <= 1400.0), 1.0, 0.0)
    right = np.where((CHAINAGE >= 1600.0) & (CHAINAGE <= 1800.0), 1.0, 0.0)
    curvature = 1e-3 * (left - right)  # to the left is positive
    high = 185.0 * (right - left) + 190.0 * bump(1300.0, 1.0) * 2.0 * left  # the left rail above the right is positive
    geometry = table(cross_level_mm=high, curvature_1pm=curvature)
    found = exceedances(geometry, at_level(cfr_213(), "class 4"), speed_kmh=0.0).found
    found = found[found["parameter"] == "elevation"]
    assert found["value_mm"].unique().tolist() == [185.0]
    assert found["from_m"].min() < 1250.0
    assert found["to_m"].max() > 1750.0
    assert len(found) == 3  # the one to the left is cut where its inner rail is the higher one


def test_what_cannot_be_judged_is_said_with_the_reason() -> None:
    geometry = table(level_mm=np.zeros(N), cross_level_mm=np.zeros(N))
    judged = exceedances(geometry, cfr_213(), speed_kmh=0.0, gauge_m=1.067)
    assert judged.found.empty
    assert tuple(judged.found.columns) == COLUMNS
    reasons = {(limit.parameter, limit.track): reason for limit, reason in judged.not_judged}
    assert "profile_level_m" in reasons["level", "any"]
    assert "raised" in reasons["runoff", "any"]
    assert "curvature_1pm" in reasons["alignment", "tangent"]
    assert ("warp", "any") not in reasons
    others = [
        limit(parameter="cross_level"),
        limit(parameter="gauge_wide"),
        limit(parameter="twist", base_m=2.6),
        limit(parameter="alignment", band="D1"),
        limit(parameter="alignment", chord_m=0.2),
    ]
    bare = exceedances(geometry, others, speed_kmh=0.0)
    needs = [reason for _, reason in bare.not_judged]
    for need, word in zip(needs, ("cant_mm", "gauge", "base_m is 2.6 m", "alignment_mm", "profile"), strict=True):
        assert word in need
    nothing = exceedances(table(), [limit(parameter="warp", base_m=5.0)], speed_kmh=0.0)
    assert nothing.not_judged[0][1] == "needs the column cross_level_mm"


def test_a_profile_with_a_hole_is_judged_beside_it() -> None:
    profile = 1e-2 * np.sin(2.0 * np.pi * CHAINAGE / 20.0)
    profile[2000:2010] = np.nan
    found = exceedances(
        table(profile_level_m=profile), [limit(band=None, chord_m=9.4488, value_mm=5.0)], speed_kmh=0.0
    ).found
    for needed in (-4.7244, 0.0, 4.7244):  # the three points of a chord: in the hole, there is no versine
        assert not ((found["from_m"] + needed < 1502.0) & (found["to_m"] + needed > 1500.0)).any()
    assert found["value_mm"].abs().max() == pytest.approx(10.0 * versine_response(20.0, 4.7244, 4.7244).real, rel=5e-3)


def test_a_table_that_cannot_be_judged_at_all_is_refused() -> None:
    with pytest.raises(BadInputError, match="no column 'chainage_m'"):
        exceedances(pd.DataFrame({"x": [1.0]}), [], speed_kmh=0.0)
    with pytest.raises(BadInputError, match="data row 3: expected rising in equal steps"):
        exceedances(pd.DataFrame({"chainage_m": [0.0, 0.25, 0.6, 0.75]}), [], speed_kmh=0.0)
    with pytest.raises(BadInputError, match="rising"):
        exceedances(pd.DataFrame({"chainage_m": [1.0, 0.0]}), [], speed_kmh=0.0)
    with pytest.raises(BadInputError, match="1 rows"):
        exceedances(pd.DataFrame({"chainage_m": [1.0]}), [], speed_kmh=0.0)
    with pytest.raises(BadInputError, match="speed_kmh has shape"):
        exceedances(table(), [], speed_kmh=[1.0, 2.0])
