"""Irregularities have the spectra, the standard deviations and the defects that were asked for."""

import numpy as np
import pytest
from scipy import signal

from trackfg.datasets.line.defects import Defect
from trackfg.datasets.line.irregularities import (
    FADE_M,
    KNOT_M,
    Irregularities,
    IrregularityModel,
    draw_irregularities,
    spectra,
)
from trackfg.datasets.line.wavelength_band import d1_gain

ASKED = IrregularityModel(
    "low", level_d1_sd_m=1.2e-3, alignment_d1_sd_m=0.8e-3, cross_level_d1_sd_m=1.5e-3, gauge_d1_sd_m=0.4e-3
)
SD = np.array([1.2e-3, 0.8e-3, 1.5e-3, 0.4e-3])


def draw(seed, length_m=20_000.0, model=ASKED, defects=()):
    return draw_irregularities(model, length_m, np.random.default_rng(seed), defects)


def sampled(irregularities):
    """Rows 0.25 m apart, without the fading ends."""
    return irregularities.at(np.arange(FADE_M, irregularities.length_m - FADE_M, KNOT_M))


@pytest.fixture(scope="module")
def twenty():
    """Rows of twenty tracks of the model, with seeds from 0. Nobody may change them."""
    return [sampled(draw(seed)) for seed in range(20)]


def d1(values):
    """The band D1 of rows 0.25 m apart, without 100 m at each end."""
    gain = d1_gain(2 * np.pi * np.fft.rfftfreq(len(values), KNOT_M))
    return np.fft.irfft(gain[:, None] * np.fft.rfft(values, axis=0), len(values), axis=0)[400:-400]


def test_measured_d1_standard_deviations_are_those_asked_for(twenty):
    variances = np.array([np.mean(d1(rows) ** 2, axis=0) for rows in twenty])
    error = np.std(variances, axis=0, ddof=1) / np.sqrt(len(variances))
    assert np.all(np.abs(np.mean(variances, axis=0) - SD**2) < 3.5 * error)
    assert np.all(error < 0.02 * SD**2)


def test_expected_d1_standard_deviations_are_those_asked_for(d1_standard_deviations):
    np.testing.assert_allclose(d1_standard_deviations(ASKED), SD, rtol=1e-12)


@pytest.mark.parametrize(("shape", "expected_mm"), [("low", [0.98, 0.71]), ("high", [1.61, 1.21])])
def test_unscaled_shapes_have_their_known_standard_deviations(shape, expected_mm, d1_standard_deviations):
    # Published for a band with sharp edges: those of the Butterworth band take away another 6 %.
    w = np.linspace(2 * np.pi / 25, 2 * np.pi / 3, 20_001)
    sharp = np.sqrt(np.trapezoid(spectra(IrregularityModel(shape), w), w, axis=0))
    np.testing.assert_allclose(1e3 * sharp[:2], expected_mm, atol=0.006)
    np.testing.assert_allclose(d1_standard_deviations(IrregularityModel(shape))[:2], 0.94 * sharp[:2], rtol=0.01)


@pytest.mark.parametrize("model", [IrregularityModel("high"), ASKED])
def test_measured_spectra_are_those_of_the_model(model, twenty):
    size = 4096
    measured = []
    for rows in twenty[:8] if model is ASKED else [sampled(draw(seed, model=model)) for seed in range(8)]:
        cycles, density = signal.welch(rows, 1 / KNOT_M, "hann", size, axis=0)
        measured.append(density / (2 * np.pi))
    w = 2 * np.pi * cycles
    mean, expected = np.mean(measured, axis=0), spectra(model, w)
    inside = (w > 2 * np.pi / 150) & (w < 2 * np.pi / 2)
    ratio = mean[inside] / expected[inside]
    averages = len(measured) * 20_000 / (size * KNOT_M)
    assert np.all(np.abs(ratio - 1) < 6 / np.sqrt(averages))
    np.testing.assert_allclose(np.mean(ratio, axis=0), 1.0, atol=0.02)
    absent = w > 2 * np.pi / 1.4
    assert np.all(mean[absent] < 1e-5 * mean[inside].max(axis=0))


def test_the_four_are_independent(twenty):
    correlation = np.corrcoef(np.concatenate([d1(rows) for rows in twenty[:5]]).T)
    np.testing.assert_allclose(correlation, np.eye(4), atol=0.03)


def test_one_seed_repeats_to_the_bit_and_another_differs():
    s = np.linspace(0, 500, 1001)
    first, again, other = (draw(seed, 500.0).at(s) for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert np.std(first - other) > 1e-4


@pytest.mark.parametrize(("shorter_m", "longer_m"), [(1000.0, 3000.0), (29_500.0, 40_000.0)])
def test_a_longer_track_begins_as_a_shorter_one(shorter_m, longer_m):
    """The longest of these is convolved in blocks, of which the second begins to count at 27.5 km."""
    s = np.arange(0.0, shorter_m - FADE_M - 10.0, 0.1)
    np.testing.assert_allclose(draw(1, longer_m).at(s), draw(1, shorter_m).at(s), atol=1e-15)


@pytest.mark.parametrize("nu", [1, 2])
def test_derivatives_are_derivatives(nu):
    irregularities = draw(3, 300.0)
    s, step = np.linspace(1, 299, 997), 1e-4
    numeric = (irregularities.at(s + step, nu - 1) - irregularities.at(s - step, nu - 1)) / (2 * step)
    np.testing.assert_allclose(irregularities.at(s, nu), numeric, atol=1e-9)


def test_track_begins_and_ends_smooth_and_is_nothing_beyond():
    irregularities = draw(3, 300.1)
    for nu in (0, 1, 2):
        # The spline rings a little where the fade sets in: 2e-7 1/m of curvature.
        np.testing.assert_allclose(irregularities.at(np.array([-1.0, 0.0, 300.1, 400.0]), nu), 0.0, atol=5e-7)
    assert irregularities.at(np.zeros((2, 3))).shape == (2, 3, 4)


def test_no_irregularities_are_nothing():
    for nu in (0, 1, 2):
        assert np.all(Irregularities.none(100.0).at(np.array([-5.0, 0.0, 50.0, 100.0, 120.0]), nu) == 0.0)


def test_from_the_other_end_left_is_right():
    irregularities = draw(4, 777.3)
    turned = irregularities.reversed()
    s = np.linspace(0, 777.3, 5000)
    signs = np.array([1.0, -1.0, -1.0, 1.0])
    for nu in (0, 1, 2):
        expected = (-1) ** nu * signs * irregularities.at(777.3 - s, nu)
        np.testing.assert_allclose(turned.at(s, nu), expected, atol=1e-12)
    np.testing.assert_allclose(turned.reversed().at(s), irregularities.at(s), atol=1e-15)


def rails(values):
    """Left level, right level, left alignment, right alignment."""
    level, alignment, cross_level, gauge = np.moveaxis(values, -1, 0)
    return np.stack([level + cross_level / 2, level - cross_level / 2, alignment + gauge / 2, alignment - gauge / 2])


def added(defect):
    """What a defect adds at s."""
    with_it, without = draw(5, 200.0, defects=[defect]), draw(5, 200.0)
    return lambda s, nu=0: with_it.at(s, nu) - without.at(s, nu)


@pytest.mark.parametrize(
    ("kind", "rail", "expected"),
    [
        ("dip", "left", [-1, 0, 0, 0]),
        ("dip", "right", [0, -1, 0, 0]),
        ("dip", "both", [-1, -1, 0, 0]),
        ("kink", "left", [0, 0, 1, 0]),
        ("kink", "right", [0, 0, 0, 1]),
        ("kink", "both", [0, 0, 1, 1]),
    ],
)
def test_dips_and_kinks_move_their_rail_by_their_size(kind, rail, expected):
    deviation = added(Defect(kind, at_m=100.1, size_m=0.012, length_m=6.0, rail=rail))
    np.testing.assert_allclose(rails(deviation(np.array(100.1))), 0.012 * np.array(expected), atol=2e-6)
    # The spline through the knots rings a little beyond the ends, where the third derivative jumps.
    outside = np.array([50.0, 90.0, 96.0, 104.2, 110.0, 150.0])
    np.testing.assert_allclose(deviation(outside), 0.0, atol=2e-6)


@pytest.mark.parametrize(("rail", "moved"), [("left", [1, 0]), ("right", [0, -1]), ("both", [0.5, -0.5])])
def test_twist_has_its_size_over_its_length(rail, moved):
    deviation = added(Defect("twist", at_m=100.0, size_m=0.015, length_m=3.0, rail=rail))
    s = np.arange(90.0, 110.0, 0.05)
    twist = deviation(s)[:, 2] - deviation(s - 3.0)[:, 2]
    assert s[np.argmax(twist)] == pytest.approx(101.5)
    assert twist.max() == pytest.approx(0.015, rel=1e-3)
    assert twist.min() > -0.0095
    high = rails(deviation(np.array(101.5)))
    np.testing.assert_allclose(high, 0.0075 * np.array([*moved, 0, 0]), atol=1e-5)
    np.testing.assert_allclose(deviation(np.array([95.0, 105.0])), 0.0, atol=2e-6)


def test_defects_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="beyond the track"):
        draw(1, 100.0, defects=[Defect("dip", 99.0, 0.01, 5.0)])
    with pytest.raises(ValueError, match=r"at least 1\.5 m"):
        Defect("kink", 50.0, 0.01, 1.0)
