"""Defects of the track and holes of the profile make no curves, and do not move those that are there."""

from __future__ import annotations

from functools import cache

import numpy as np
import pandas as pd
import pytest

from trackfg.curves import POINTS, Curve, find_curves
from trackfg.datasets.line.built_in_lines import GOOD_TRACK, MAIN_LINE
from trackfg.datasets.line.defects import Defect
from trackfg.datasets.line.irregularities import draw_irregularities
from trackfg.datasets.line.line import Line
from trackfg.datasets.line.line_design import random_line
from trackfg.datasets.line.track import SimulatedTrack
from trackfg.datasets.line.truth_geometry import truth_geometry

BTC, BCC, ECC, ETC = 3441.2, 3483.2, 3625.0, 3667.0
PLACES = {"straight": BTC - 120.0, "near": BTC - 25.0, "transition": 0.5 * (BTC + BCC), "circle": 0.5 * (BCC + ECC)}
everywhere = pytest.mark.parametrize("place", PLACES)


@cache
def line() -> Line:
    return random_line(MAIN_LINE, 6000.0, np.random.default_rng(3))


@cache
def profile(*defects: Defect) -> pd.DataFrame:
    rng = np.random.default_rng([3, 1])
    track = SimulatedTrack(line(), draw_irregularities(GOOD_TRACK, line().length_m, rng, defects), MAIN_LINE.gauge_m)
    table = truth_geometry(track, chainage_origin_m=0.0, direction=1, s_from=2300.0, s_to=3900.0)
    return table[["chainage_m", "curvature_1pm", "cross_level_mm"]].assign(curvature_1pm_sd=1e-8)


@cache
def undisturbed() -> list[Curve]:
    return find_curves(profile())


def moved(table: pd.DataFrame) -> float:
    """By how many sigmas the point has moved that has moved most."""
    curves = find_curves(table)
    assert [curve.sense for curve in curves] == [curve.sense for curve in undisturbed()]
    pairs = [(a, b, name) for a, b in zip(undisturbed(), curves, strict=True) for name in POINTS]
    return max(abs(getattr(b, name) - getattr(a, name)) / b.sd(name) for a, b, name in pairs)


def hole(at: float, length: float) -> np.ndarray:
    return np.asarray((profile()["chainage_m"] - at).abs() < 0.5 * length)


def holed(at: float, length: float) -> pd.DataFrame:
    table, seen = profile(), ~hole(at, length)
    return table.assign(**{name: table[name].where(seen) for name in ("curvature_1pm", "cross_level_mm")})


@everywhere
def test_a_kink_moves_no_point(place: str) -> None:
    assert moved(profile(Defect("kink", PLACES[place], 3e-3, 5.0))) < 1.0


@everywhere
def test_a_kick_of_the_alignment_moves_no_point(place: str) -> None:
    assert moved(profile(Defect("kink", PLACES[place], 10e-3, 5.0))) < 1.0


@everywhere
def test_a_step_of_cross_level_moves_no_point(place: str) -> None:
    table = profile()
    higher = np.where(table["chainage_m"] > PLACES[place], 5.0, 0.0)
    assert moved(table.assign(cross_level_mm=table["cross_level_mm"] + higher)) < 1.0


@everywhere
@pytest.mark.parametrize("length", [3.0, 8.0])
def test_a_hole_moves_no_point(place: str, length: float) -> None:
    assert moved(holed(PLACES[place], length)) < 1.1


def test_rows_that_are_missing_are_a_hole() -> None:
    missing = find_curves(profile()[~hole(BCC, 8.0)])
    for curve, other in zip(missing, find_curves(holed(BCC, 8.0)), strict=True):
        assert [getattr(curve, name) for name in POINTS] == pytest.approx([getattr(other, name) for name in POINTS])


def test_a_curve_with_a_hole_is_less_certain() -> None:
    curves = find_curves(holed(0.5 * (BTC + BCC), 25.0))
    assert curves[1].sd("middle_in_m") > 2.0 * undisturbed()[1].sd("middle_in_m")
    assert curves[0].sd("middle_in_m") == pytest.approx(undisturbed()[0].sd("middle_in_m"), rel=0.2)


def test_defects_of_straights_are_no_curves() -> None:
    """A kick, a turn of 2 mrad from one metre to the next, a step of cross-level, a hole."""
    table = profile(Defect("kink", BTC - 300.0, 10e-3, 8.0))
    chainage = table["chainage_m"].to_numpy()
    kinked = table["curvature_1pm"] + np.where(np.abs(chainage - (ETC + 150.0)) < 5.0, 2e-4, 0.0)
    stepped = table["cross_level_mm"] + np.where(chainage > ETC + 100.0, 5.0, 0.0)
    curves = find_curves(table.assign(curvature_1pm=kinked.mask(hole(BTC - 150.0, 5.0)), cross_level_mm=stepped))
    assert len(curves) == len(undisturbed())
