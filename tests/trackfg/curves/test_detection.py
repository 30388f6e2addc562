"""Curves found in the geometry of designed lines: exactly without irregularities, within their sigmas with them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
import pytest

import trackfg
from trackfg.curves import CURVE_COLUMNS, POINTS, QUANTITIES, Curve, curve_table, find_curves
from trackfg.datasets.line.built_in_lines import GOOD_TRACK, MAIN_LINE, WORN_TRACK
from trackfg.datasets.line.irregularities import Irregularities, IrregularityModel, draw_irregularities
from trackfg.datasets.line.line import Line
from trackfg.datasets.line.line_description import LineDescription, line_from
from trackfg.datasets.line.line_design import random_line
from trackfg.datasets.line.track import SimulatedTrack
from trackfg.datasets.line.truth_geometry import truth_geometry
from trackfg.datasets.scenarios import simulate
from trackfg.errors import BadInputError

SD_1PM = 1e-8
"""The profile's own sigma: next to nothing."""


@dataclass(frozen=True)
class Part:
    """An element of a line: a straight (no radius), a circle, or a transition (a law)."""

    length_m: float
    radius_m: float = 0.0
    cant_mm: float = 0.0
    law: str = ""


def straight(length_m: float) -> Part:
    return Part(length_m)


def transition(length_m: float, law: str = "clothoid") -> Part:
    return Part(length_m, law=law)


def circle(radius_m: float, length_m: float, cant_mm: float = 0.0) -> Part:
    return Part(length_m, radius_m, cant_mm)


def designed(parts: list[Part]) -> Line:
    elements: list[dict[str, object]] = []
    for part in parts:
        kind = "transition" if part.law else "curve" if part.radius_m else "straight"
        own: dict[str, dict[str, object]] = {
            "transition": {"law": part.law},
            "curve": {"radius_m": part.radius_m, "cant_mm": part.cant_mm},
            "straight": {},
        }
        elements.append({"type": kind, "length_m": part.length_m, **own[kind]})
    text = {"format": "trackfg-line/1", "id": "designed", "gauge_m": 1.067, "cross_level_base_m": 1.067}
    limit = [{"chainage_m": 0.0, "kmh": 100.0}]
    return line_from(LineDescription.model_validate({**text, "speed_limit": limit, "element": elements})).line


def profile(line: Line, model: IrregularityModel | None = None, seed: int = 0) -> pd.DataFrame:
    nothing = Irregularities.none(line.length_m)
    rng = np.random.default_rng([seed, 1])
    irregularities = nothing if model is None else draw_irregularities(model, line.length_m, rng)
    track = SimulatedTrack(line, irregularities, MAIN_LINE.gauge_m)
    table = truth_geometry(track, chainage_origin_m=0.0, direction=1, s_from=0.0, s_to=line.length_m)
    return table[["chainage_m", "curvature_1pm", "cross_level_mm"]].assign(curvature_1pm_sd=SD_1PM)


def curves_of(line: Line) -> np.ndarray:
    """The quantities of the curves of a line of straights, clothoids and circles. Shape (n, 6)."""
    x = line.curvature.x
    middles = 0.5 * (x[1:] + x[:-1])
    level = line.curvature(middles)
    flat = np.abs(line.curvature(middles, 1)) < 1e-12
    rows = [i for i in range(1, len(middles) - 1) if flat[i] and level[i] != 0.0]
    cant = -1e3 * np.sign(level) * line.cant(middles)
    return np.array([[*x[i - 1 : i + 3], level[i], cant[i]] for i in rows])


def quantities(curves: list[Curve]) -> np.ndarray:
    return np.array([[getattr(curve, name) for name in QUANTITIES] for curve in curves])


def sigmas(curves: list[Curve]) -> np.ndarray:
    return np.array([[curve.sd(name) for name in QUANTITIES] for curve in curves])


BOTH_SENSES = [
    straight(300),
    *(transition(60, "clothoid"), circle(400, 150, 60), transition(70, "clothoid"), straight(250)),
    *(transition(50, "clothoid"), circle(-700, 200, 40), transition(40, "clothoid"), straight(300)),
]


@pytest.mark.parametrize(
    "law", ["clothoid", "half-sine", *(pytest.param(law, marks=pytest.mark.slow) for law in ("sine", "bloss"))]
)
def test_exact_without_irregularities(law: str) -> None:
    line = designed([replace(part, law=law) if part.law else part for part in BOTH_SENSES])
    left, right = find_curves(profile(line))
    for curve, points, radius, cant in (
        (left, (300, 360, 510, 580), 400, 60),
        (right, (830, 880, 1080, 1120), 700, 40),
    ):
        assert [getattr(curve, name) for name in POINTS] == pytest.approx(points, abs=0.02)
        assert curve.radius_m == pytest.approx(radius, rel=1e-4)
        assert curve.cant_mm == pytest.approx(cant, abs=0.01)
        assert (curve.law_in, curve.law_out, curve.kind) == (law, law, "simple")
        assert min(curve.law_in_probability, curve.law_out_probability) > 0.99
    assert (left.id, left.sense, right.id, right.sense) == (1, "left", 2, "right")
    assert left.length_in_m == pytest.approx(60.0, abs=0.02)
    assert left.middle_out_m == pytest.approx(545.0, abs=0.01)


def test_reverse_curves_that_meet_and_that_do_not() -> None:
    line = designed(
        [
            straight(300),
            *(transition(50), circle(400, 120, 50), transition(50), transition(40), circle(-300, 100, 60)),
            *(transition(60), straight(200), transition(50), circle(500, 100, 40), transition(40), straight(60)),
            *(transition(40), circle(-500, 100, 40), transition(40), straight(300)),
        ]
    )
    curves = find_curves(profile(line, GOOD_TRACK, 1))
    assert [curve.kind for curve in curves] == ["reverse part", "reverse part", "simple", "simple"]
    assert [curve.sense for curve in curves] == ["left", "right", "left", "right"]
    assert curves[0].etc_m == curves[1].btc_m == pytest.approx(520.0, abs=1.0)
    expected = [(300, 350, 470, 520), (520, 560, 660, 720), (920, 970, 1070, 1110), (1170, 1210, 1310, 1350)]
    away = np.array(expected) - quantities(curves)[:, :4]
    assert np.all(np.abs(away) < 4.0 * sigmas(curves)[:, :4])
    assert np.all(np.abs(away) < 2.0)


def test_compound_curves() -> None:
    line = designed(
        [
            straight(300),
            *(transition(50), circle(300, 150, 60), transition(40), circle(600, 150, 40), transition(50)),
            *(straight(300), transition(50), circle(-350, 150, 60), circle(-500, 150, 60), transition(50)),
            straight(300),
        ]
    )
    first, second, third, fourth = find_curves(profile(line, GOOD_TRACK, 5))
    assert {curve.kind for curve in (first, second, third, fourth)} == {"compound part"}
    assert [first.radius_m, second.radius_m] == pytest.approx([300, 600], rel=5e-3)
    assert [third.radius_m, fourth.radius_m] == pytest.approx([350, 500], rel=5e-3)
    assert (first.ecc_m, first.etc_m) == (second.btc_m, second.bcc_m) == pytest.approx((500, 540), abs=3.0)
    assert third.law_out == fourth.law_in == "none"
    assert third.ecc_m == fourth.bcc_m == pytest.approx(1240.0, abs=0.5)
    assert [first.cant_mm, second.cant_mm] == pytest.approx([60, 40], abs=0.3)


def test_curves_without_transitions_short_ones_and_wide_ones() -> None:
    line = designed(
        [
            *(straight(300), circle(300, 100), straight(200), circle(-1000, 60), straight(300)),
            *(transition(30), circle(300, 15, 40), transition(30), straight(300)),
            *(
                transition(60),
                circle(-5000, 300, 20),
                transition(60),
                straight(300),
                circle(30_000, 400),
                straight(400),
            ),
        ]
    )
    curves = find_curves(profile(line, GOOD_TRACK, 3))
    bare, wide_bare, short, wide = curves
    for curve, begin, end in ((bare, 300.0, 400.0), (wide_bare, 600.0, 660.0)):
        assert (curve.law_in, curve.law_out) == ("none", "none")
        assert curve.btc_m == curve.bcc_m == pytest.approx(begin, abs=1.5)
        assert curve.ecc_m == curve.etc_m == pytest.approx(end, abs=1.5)
        assert abs(curve.cant_mm) < 1.0
    away = quantities([short, wide]) - [[960, 990, 1005, 1035, 1 / 300, 40], [1335, 1395, 1695, 1755, -1 / 5000, 20]]
    assert np.all(np.abs(away) < 3.5 * sigmas([short, wide]))


def test_a_line_of_half_sines_is_known_for_one() -> None:
    parts = [straight(300)]
    for radius in (300, -500, 400, -350):
        parts += [transition(70, "half-sine"), circle(radius, 150, 60), transition(80, "half-sine"), straight(250)]
    curves = find_curves(profile(designed(parts), GOOD_TRACK, 5))
    assert [curve.law_in for curve in curves] + [curve.law_out for curve in curves] == 8 * ["half-sine"]
    expected = np.array(
        [[300, 370, 520, 600], [850, 920, 1070, 1150], [1400, 1470, 1620, 1700], [1950, 2020, 2170, 2250]]
    )
    away = quantities(curves)[:, :4] - expected
    assert np.all(np.abs(away) < 3.0 * sigmas(curves)[:, :4])


def test_curve_upon_curve() -> None:
    """Many with little straight between: fitted in parts."""
    parts, expected, begin = [straight(300)], [], 300.0
    for k in range(9):
        between, length = 20.0 + 4 * k, 120.0 + 10.0 * k
        parts += [transition(50), circle((-1) ** k * (300.0 + 30.0 * k), length, 60), transition(50), straight(between)]
        expected.append(begin + np.cumsum([0.0, 50.0, length, 50.0]))
        begin = expected[-1][-1] + between
    curves = find_curves(profile(designed([*parts, straight(300)]), GOOD_TRACK, 3))
    assert [curve.sense for curve in curves] == (5 * ["left", "right"])[:9]
    away = quantities(curves)[:, :4] - expected
    assert np.all(np.abs(away) < 3.5 * sigmas(curves)[:, :4])
    assert np.all(np.abs(away) < 2.0)


def test_cant_with_ramps_of_its_own() -> None:
    """The cant of one line and the curvature of another, whose transitions are 20 m further on."""
    parts = [straight(300), transition(60), circle(400, 150, 60), transition(70), straight(400)]
    table = profile(designed(parts), GOOD_TRACK, 5)
    elsewhere = profile(designed([straight(320), *parts[1:-1], straight(380)]), GOOD_TRACK, 5)
    (curve,) = find_curves(table.assign(cross_level_mm=elsewhere["cross_level_mm"]))
    assert [getattr(curve, name) for name in POINTS] == pytest.approx([300, 360, 510, 580], abs=3.0)
    assert curve.cant_mm == pytest.approx(60.0, abs=0.3)


def test_no_false_curves_on_50_km_of_straight() -> None:
    assert find_curves(profile(designed([straight(50_000)]), WORN_TRACK, 4)) == []


def scored(seeds: range, length_m: float, model: IrregularityModel) -> tuple[np.ndarray, np.ndarray]:
    """Errors and sigmas of all curves of random lines. Each (n, 6)."""
    away, sd = [], []
    for seed in seeds:
        line = random_line(MAIN_LINE, length_m, np.random.default_rng(seed))
        truth, curves = curves_of(line), find_curves(profile(line, model, seed))
        assert len(curves) == len(truth)
        away.append(quantities(curves) - truth)
        sd.append(sigmas(curves))
    return np.concatenate(away), np.concatenate(sd)


def test_errors_are_within_their_sigmas() -> None:
    away, sd = scored(range(100, 102), 12_000.0, GOOD_TRACK)
    assert len(away) > 20
    assert np.all(np.mean(np.abs(away) < 2.0 * sd, axis=0) > 0.88)
    assert np.all(np.sqrt(np.mean((away / sd) ** 2, axis=0)) < 1.2)
    assert np.all(np.sqrt(np.mean(away[:, :4] ** 2, axis=0)) < 0.5)
    assert np.sqrt(np.mean(away[:, 5] ** 2)) < 0.1


@pytest.mark.slow
@pytest.mark.parametrize(("model", "length_m"), [(GOOD_TRACK, 6000.0), (WORN_TRACK, 10_000.0)])
def test_coverage_over_seeds(model: IrregularityModel, length_m: float) -> None:
    away, sd = scored(range(10), length_m, model)
    assert np.all(np.mean(np.abs(away) < 2.0 * sd, axis=0) > 0.93)
    assert np.all(np.median(np.abs(away / sd), axis=0) / 0.6745 > 0.4)


def test_mirrored_and_reversed_profiles_hold_the_same_curves() -> None:
    table = profile(designed(BOTH_SENSES), GOOD_TRACK, 7)
    curves = find_curves(table)
    mirrored = find_curves(table.assign(curvature_1pm=-table["curvature_1pm"], cross_level_mm=-table["cross_level_mm"]))
    assert [curve.sense for curve in mirrored] == ["right", "left"]
    same = np.array([1, 1, 1, 1, -1, 1])
    np.testing.assert_allclose(quantities(mirrored), same * quantities(curves), rtol=1e-6)
    # Who faces the other way has left on the right: signs change, and so does the order. The cells are others, too.
    end = table["chainage_m"].iloc[-1]
    turned = table.iloc[::-1].assign(
        chainage_m=end - table["chainage_m"].to_numpy()[::-1],
        curvature_1pm=-table["curvature_1pm"].to_numpy()[::-1],
        cross_level_mm=-table["cross_level_mm"].to_numpy()[::-1],
    )
    back = quantities(find_curves(turned))[::-1]
    back[:, :4] = end - back[:, 3::-1]
    back[:, 4] *= -1.0
    assert np.all(np.abs(back - quantities(curves)) < 1.5 * sigmas(curves))


def test_ends_and_gaps() -> None:
    line = designed([circle(400, 150, 50), transition(50), straight(300), transition(50), circle(-500, 200, 40)])
    first, last = find_curves(profile(line, GOOD_TRACK, 5))
    assert np.isnan([first.btc_m, first.sd("btc_m"), last.etc_m, last.length_out_m]).all()
    assert (first.law_in, last.law_out) == ("unseen", "unseen")
    assert [first.ecc_m, first.etc_m, last.btc_m, last.bcc_m] == pytest.approx([150, 200, 500, 550], abs=2.0)
    whole = profile(designed(BOTH_SENSES), GOOD_TRACK, 5)
    gap = (whole["chainage_m"] > 690.0) & (whole["chainage_m"] < 720.0)
    for holed in (whole[~gap], whole.assign(curvature_1pm=whole["curvature_1pm"].where(~gap))):
        assert [curve.sense for curve in find_curves(holed)] == ["left", "right"]


def test_curvature_alone_will_do() -> None:
    table = profile(designed(BOTH_SENSES), GOOD_TRACK, 5).drop(columns="cross_level_mm")
    curves = find_curves(table)
    assert len(curves) == 2
    assert all(np.isnan([curve.cant_mm, curve.sd("cant_mm")]).all() for curve in curves)


def test_table_has_a_row_per_curve() -> None:
    curves = find_curves(profile(designed(BOTH_SENSES), GOOD_TRACK, 5))
    table = curve_table(curves)
    assert tuple(table.columns) == CURVE_COLUMNS
    assert table["radius_m"].tolist() == [curve.radius_m for curve in curves]
    assert table["radius_m_sd"].to_numpy() == pytest.approx(table["curvature_1pm_sd"] * table["radius_m"] ** 2)
    # Ends of a transition err against each other: its middle is known better than either, its length worse.
    assert np.all(table["middle_in_m_sd"] < table[["btc_m_sd", "bcc_m_sd"]].min(axis=1))
    assert tuple(curve_table([]).columns) == CURVE_COLUMNS


def test_unusable_profiles_are_refused() -> None:
    table = profile(designed(BOTH_SENSES))
    with pytest.raises(BadInputError, match="curvature_1pm_sd"):
        find_curves(table.drop(columns="curvature_1pm_sd"))
    with pytest.raises(BadInputError, match="whole part"):
        find_curves(table, base_m=10.1)
    assert find_curves(table.head(20)) == []


@pytest.mark.slow
def test_curves_of_a_smoothed_run() -> None:
    simulation = simulate("mainline", seed=1, duration_s=300.0)
    geometry = trackfg.smooth(simulation.recording).geometry
    curves = find_curves(geometry)
    truth = curves_of(simulation.track.line)
    truth = truth[truth[:, 3] < geometry["chainage_m"].max()]
    assert len(curves) == len(truth) == 4
    place_sd = np.interp(truth[:, 0], geometry["chainage_m"], geometry["chainage_m_sd"])[:, None]
    away = quantities(curves) - truth
    assert np.all(np.abs(away[:, :4]) < 3.0 * np.hypot(sigmas(curves)[:, :4], place_sd))
    assert np.all(np.abs(away[:, 5]) < 3.0 * sigmas(curves)[:, 5])
    assert np.all(np.abs(away[:, 4] / truth[:, 4]) < 2e-3)
