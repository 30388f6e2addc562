"""Every column of the true geometry against closed forms."""

import numpy as np
import pytest
from scipy import signal

from trackfg.datasets.line.irregularities import KNOT_M, Irregularities, IrregularityModel, draw_irregularities
from trackfg.datasets.line.track import SimulatedTrack
from trackfg.datasets.line.truth_geometry import OperatorLengths, truth_geometry
from trackfg.datasets.line.wavelength_band import d1_gain
from trackfg.results.columns import GEOMETRY_COLUMNS, RAIL_COLUMNS

BASE_M = 1.067
COLUMNS = [c for c in GEOMETRY_COLUMNS + RAIL_COLUMNS if not c.endswith("_sd") and c != "speed_mps"]


def waves(length_m, wavelength_m, amplitudes_m):
    """Sines of one wavelength in level, alignment, cross-level and gauge, m."""
    s = KNOT_M * np.arange(round(length_m / KNOT_M) + 1)
    values = np.sin(2 * np.pi * s / wavelength_m)[:, None] * np.array(amplitudes_m)
    return Irregularities.through(values, length_m)


def perfect(line):
    return SimulatedTrack(line, Irregularities.none(line.length_m), BASE_M)


def geometry(track, direction=1, origin=0.0, s_from=0.0, s_to=None, **conventions):
    s_to = track.line.length_m if s_to is None else s_to
    lengths = OperatorLengths(**conventions)
    return truth_geometry(
        track, chainage_origin_m=origin, direction=direction, s_from=s_from, s_to=s_to, lengths=lengths
    )


@pytest.fixture(scope="module")
def rough():
    return draw_irregularities(IrregularityModel("high"), 1000.0, np.random.default_rng(8))


@pytest.fixture
def winding(make_line, rough):
    """Curves both ways, canted, on gradients, in bad order."""
    line = make_line(
        [0, 200, 260, 400, 460, 500, 560, 700, 760, 1000],
        [0, 0, 1 / 300, 1 / 300, 0, 0, -1 / 400, -1 / 400, 0, 0],
        cant=[0, 0, -0.1, -0.1, 0, 0, 0.08, 0.08, 0, 0],
        grade=[0.01, 0.01, 0.02, 0.02, -0.015, -0.015, 0.01, 0.01, 0, 0],
    )
    return SimulatedTrack(line, rough, BASE_M)


def test_rows_are_whole_multiples_within_the_run(winding):
    table = geometry(winding, origin=1000.1, s_from=100.0, s_to=200.0)
    assert list(table.columns) == COLUMNS
    np.testing.assert_array_equal(table["chainage_m"], np.arange(1100.25, 1200.01, 0.25))
    backwards = geometry(winding, direction=-1, origin=1000.0, s_from=100.0, s_to=200.0)
    np.testing.assert_array_equal(backwards["chainage_m"], np.arange(800.0, 900.01, 0.25))


def test_operators_that_reach_beyond_the_ends_are_nan(winding):
    table = geometry(winding, s_from=100.0, s_to=200.0).set_index("chainage_m")
    extents = {name: (table[name].first_valid_index(), table[name].last_valid_index()) for name in table}
    assert extents["cross_level_mm"] == extents["gauge_mm"] == (100.0, 200.0)
    assert extents["twist_mm"] == (105.0, 200.0)
    assert extents["curvature_1pm"] == extents["versine_level_mm"] == extents["versine_alignment_mm"] == (105.0, 195.0)
    assert extents["gradient_permille"] == (112.5, 187.5)
    bands = [name for name in table if name.startswith(("level", "alignment"))]
    assert len(bands) == 6
    assert all(extents[name] == (125.0, 175.0) for name in bands)


def test_a_place_has_the_same_values_in_every_run(winding):
    long = geometry(winding).set_index("chainage_m")
    short = geometry(winding, s_from=400.0, s_to=600.0).set_index("chainage_m")
    known = short.notna()
    np.testing.assert_allclose(short[known], long.loc[short.index][known], rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize("radius", [250.0, -800.0])
def test_circle(make_line, radius):
    table = geometry(perfect(make_line([0, 600], [1 / radius, 1 / radius], cant=[-0.08, -0.08]))).dropna()
    np.testing.assert_allclose(table["curvature_1pm"], 1 / radius, rtol=1e-12)
    np.testing.assert_allclose(table["versine_alignment_mm"], -12500 / radius, rtol=1e-8)
    np.testing.assert_allclose(table["cross_level_mm"], -80.0, rtol=1e-12)
    np.testing.assert_allclose(table["gauge_mm"], 1067.0, rtol=1e-12)
    still = ["twist_mm", "level_mm", "alignment_mm", "alignment_left_mm", "level_right_mm", "versine_level_mm"]
    np.testing.assert_allclose(table[[*still, "gradient_permille"]], 0.0, atol=1e-6)


def test_chord_of_a_circle_far_down_the_line_keeps_its_precision(make_line):
    table = geometry(perfect(make_line([0, 100_000], [1 / 300, 1 / 300])), s_from=99_000.0, s_to=99_100.0)
    np.testing.assert_allclose(table["versine_alignment_mm"].dropna(), -12500 / 300, atol=1e-4)
    np.testing.assert_allclose(table["alignment_mm"].dropna(), 0.0, atol=1e-4)


def test_clothoid_with_a_linear_ramp(make_line):
    length, radius, cant = 100.0, 400.0, 0.1
    line = make_line([0, 100, 200, 500], [0, 0, 1 / radius, 1 / radius], cant=[0, 0, -cant, -cant])
    table = geometry(perfect(line)).set_index("chainage_m").loc[125.0:175.0]
    along = table.index.to_numpy() - 100.0
    np.testing.assert_allclose(table["twist_mm"], -1e3 * cant * 5.0 / length, rtol=1e-10)
    np.testing.assert_allclose(table["cross_level_mm"], -1e3 * cant * along / length, rtol=1e-10)
    np.testing.assert_allclose(table["curvature_1pm"], along / (radius * length), rtol=1e-10)
    np.testing.assert_allclose(table["versine_alignment_mm"], -12500 * along / (radius * length), rtol=1e-8)


def test_gradient_and_vertical_curve(make_line):
    radius = 5000.0
    line = make_line([0, 100, 200, 400], [0, 0, 0, 0], grade=[0.01, 0.01, 0.03, 0.03])
    table = geometry(perfect(line)).set_index("chainage_m")
    np.testing.assert_allclose(table.loc[12.5:80.0, "gradient_permille"], 1e3 * np.sin(0.01), rtol=1e-10)
    np.testing.assert_allclose(table.loc[220.0:387.5, "gradient_permille"], 1e3 * np.sin(0.03), rtol=1e-10)
    on_curve = table.loc[110.0:190.0, "versine_level_mm"]
    np.testing.assert_allclose(on_curve, -12500 / radius, rtol=1e-3)  # z'' = cos(gamma) / R


@pytest.mark.parametrize("wavelength", [2.0, 4.0, 8.0, 12.5, 20.0, 40.0])
def test_operators_have_their_gain_on_a_wave(make_line, wavelength):
    level, alignment, cross_level, gauge = 3e-3, 2e-3, 4e-3, 1e-3
    line = make_line([0, 1600], [0, 0])
    table = geometry(SimulatedTrack(line, waves(1600.0, wavelength, [level, alignment, cross_level, gauge]), BASE_M))
    table = table.set_index("chainage_m").loc[600.0:1000.0]
    x, w = table.index.to_numpy(), 2 * np.pi / wavelength
    sine = 1e3 * np.sin(w * x)

    def check(column, expected, atol):
        # Waves of 2 m are off by what spline and quadrature leave of them; steep ones by the cube of their slope.
        np.testing.assert_allclose(table[column], expected, atol=atol, err_msg=column)

    tolerance = 2e-3 if wavelength < 3 else 3e-4
    check("cross_level_mm", cross_level * sine, 1e-3)
    check("gauge_mm", 1e3 * BASE_M + gauge * sine, 1e-3)
    check("twist_mm", 1e3 * cross_level * (np.sin(w * x) - np.sin(w * (x - 5.0))), 1e-3)
    check("versine_level_mm", (1 - np.cos(5.0 * w)) * level * sine, tolerance)
    check("versine_alignment_mm", (1 - np.cos(5.0 * w)) * alignment * sine, tolerance)
    band = d1_gain(np.array(w)) * sine
    check("level_mm", level * band, tolerance)
    check("alignment_mm", alignment * band, tolerance)
    check("level_left_mm", (level + cross_level / 2) * band, tolerance)
    check("level_right_mm", (level - cross_level / 2) * band, tolerance)
    # The axle turns with track and roll: terms of second order in slope and roll.
    check("alignment_left_mm", (alignment + gauge / 2) * band, 2e-2)
    check("alignment_right_mm", (alignment - gauge / 2) * band, 2e-2)
    cosine = 1e3 * w * np.cos(w * x)
    check("gradient_permille", level * cosine * np.sinc(25.0 / wavelength), tolerance)
    np.testing.assert_allclose(
        table["curvature_1pm"], -alignment * w * 2 * np.sin(5.0 * w) / 10.0 * np.sin(w * x), atol=3e-8
    )


def test_band_is_a_butterworth_band_pass_run_both_ways():
    wavelength = np.array([1.0, 2.0, 3.0, 5.0, 8.66, 20.0, 25.0, 40.0, 70.0, 200.0])
    edges = 2 * np.pi / np.array([25.0, 3.0])
    _, response = signal.freqs(*signal.butter(4, edges, "bandpass", analog=True), worN=2 * np.pi / wavelength)
    np.testing.assert_allclose(d1_gain(2 * np.pi / wavelength), np.abs(response) ** 2, rtol=1e-9)
    assert d1_gain(np.zeros(1)) == 0.0


def test_conventions_are_the_caller_s(winding):
    table = geometry(winding, twist_base_m=3.0, chord_m=20.0, curvature_base_m=5.0, gradient_base_m=10.0)
    s = table["chainage_m"].to_numpy()
    cross_level, height = winding.cross_level(s), winding.centre(s)[:, 2]
    heading = winding.rpy(s)[:, 2]
    row = 2000
    assert table["twist_mm"][row] == pytest.approx(1e3 * (cross_level[row] - cross_level[row - 12]))
    versine = height[row] - 0.5 * (height[row - 40] + height[row + 40])
    assert table["versine_level_mm"][row] == pytest.approx(1e3 * versine)
    assert table["curvature_1pm"][row] == pytest.approx((heading[row + 10] - heading[row - 10]) / 5.0)
    assert table["gradient_permille"][row] == pytest.approx(1e3 * (height[row + 20] - height[row - 20]) / 10.0)
    with pytest.raises(ValueError, match=r"multiple of 0\.25 m"):
        geometry(winding, chord_m=9.449)


def test_versine_of_the_alignment_is_that_of_the_path_in_the_plane(winding):
    # In the plane, off the chord between two points of the path; second order in the turn over the chord.
    table = geometry(winding).dropna()
    s = table["chainage_m"].to_numpy()
    behind, here, ahead = (winding.centre(s + d)[:, :2] for d in (-5.0, 0.0, 5.0))
    yaw = winding.line.yaw(s)
    across = here - 0.5 * (behind + ahead)
    versine = -across[:, 0] * np.sin(yaw) + across[:, 1] * np.cos(yaw)
    np.testing.assert_allclose(table["versine_alignment_mm"], 1e3 * versine, atol=2e-2)


def test_rails_and_centre_agree(winding):
    table = geometry(winding).dropna()
    # The tops are half a base up and down along the axle, which is off the vertical by pitch.
    np.testing.assert_allclose(0.5 * (table["level_left_mm"] + table["level_right_mm"]), table["level_mm"], atol=1e-6)
    mean = 0.5 * (table["alignment_left_mm"] + table["alignment_right_mm"])
    np.testing.assert_allclose(mean, table["alignment_mm"], atol=5e-2)
    assert np.std(table["alignment_left_mm"] - table["alignment_right_mm"]) > 0.2


def test_facing_the_other_way_changes_signs_and_sides(winding):
    there = geometry(winding, origin=0.0)
    back = geometry(winding, direction=-1, origin=1000.0).iloc[::-1].reset_index(drop=True)
    same = ["level_mm", "versine_level_mm", "gauge_mm"]
    changed = ["curvature_1pm", "gradient_permille", "cross_level_mm", "alignment_mm", "versine_alignment_mm"]
    tolerance = {"rtol": 1e-9, "atol": 1e-7, "equal_nan": True}
    np.testing.assert_allclose(back["chainage_m"], 1000.0 - there["chainage_m"])
    np.testing.assert_allclose(back[same], there[same], **tolerance)
    np.testing.assert_allclose(back[changed], -there[changed], **tolerance)
    for this, other in (("left", "right"), ("right", "left")):
        np.testing.assert_allclose(back[f"level_{this}_mm"], there[f"level_{other}_mm"], **tolerance)
        np.testing.assert_allclose(back[f"alignment_{this}_mm"], -there[f"alignment_{other}_mm"], **tolerance)
    # Twist looks back along chainage: over the 5 m on the other side, turned twice.
    np.testing.assert_allclose(back["twist_mm"][:-20], there["twist_mm"].shift(-20)[:-20], **tolerance)


@pytest.mark.parametrize("direction", [1, -1])
def test_a_run_from_the_other_end_gives_the_same_table(winding, direction):
    once = geometry(winding, direction=direction, origin=500.0)
    again = geometry(winding.reversed(), direction=-direction, origin=500.0 + direction * 1000.0)
    np.testing.assert_allclose(again, once, rtol=1e-8, atol=1e-6, equal_nan=True)


def test_measured_d1_standard_deviation_is_that_asked_for(make_line):
    line = make_line([0, 40_000], [0, 0])
    model = IrregularityModel("low", level_d1_sd_m=1e-3, alignment_d1_sd_m=0.7e-3)
    track = SimulatedTrack(line, draw_irregularities(model, 40_000.0, np.random.default_rng(2)), BASE_M)
    table = geometry(track)
    assert table["level_mm"].std() == pytest.approx(1.0, rel=0.05)
    assert table["alignment_mm"].std() == pytest.approx(0.7, rel=0.05)
