"""The J-turn: the paper's conditions, and that the truth is a car's."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from trackfg.datasets.j_turn import FRICTION, STEP_S, STRETCHES_S, j_turn


@pytest.fixture(scope="module")
def drive():
    return j_turn(3)


def test_one_seed_repeats(drive):
    again = j_turn(3)
    pd.testing.assert_frame_equal(drive.measured, again.measured)
    pd.testing.assert_frame_equal(drive.truth, again.truth)
    assert not np.allclose(drive.measured["front_mps2"], j_turn(4).measured["front_mps2"])


def test_conditions_are_the_papers(drive):
    t, friction = drive.truth["t_s"], drive.truth["friction"]
    assert len(t) == 600
    np.testing.assert_allclose(np.diff(t), STEP_S)
    for (start, end), mu in zip(STRETCHES_S, FRICTION, strict=True):
        assert set(friction[(t > start - 1e-6) & (t < end - 1e-6)]) == {mu}
    steer = drive.measured["steer_rad"]
    assert steer.iloc[0] == 0.0
    assert (np.diff(steer) >= 0).all()
    assert np.degrees(steer.iloc[-1]) == pytest.approx(3.0)


def test_noise_is_what_was_asked(drive):
    for axle in ("front_mps2", "rear_mps2"):
        error = drive.measured[axle] - drive.truth[axle]
        assert error.std() == pytest.approx(0.5, rel=0.1)
        assert abs(error.mean()) < 4 * 0.5 / np.sqrt(len(error))


def test_without_noise_the_forces_are_those_of_the_tyres():
    """Settled in a turn the car turns with what the tyres give: a = V gamma, no yaw acceleration."""
    quiet = j_turn(0, noise=False)
    np.testing.assert_array_equal(quiet.measured["front_mps2"], quiet.truth["front_mps2"])
    before_change = quiet.truth[(quiet.truth["t_s"] > 5.5) & (quiet.truth["t_s"] < 5.99)]
    turning = 80.0 / 3.6 * before_change["yaw_rate_radps"]
    np.testing.assert_allclose(before_change["front_mps2"], turning, rtol=2e-3)
    np.testing.assert_allclose(before_change["rear_mps2"], turning, rtol=2e-3)
    # No more than friction gives, and the slippery stretch less than the dry one.
    assert (turning < 0.8 * 9.81).all()
    last = quiet.truth.iloc[-1]
    assert last["front_mps2"] < 0.3 * 9.81 < turning.min()


def test_the_turn_is_that_of_a_car(drive):
    settled = drive.truth.set_index("t_s")["slip_angle_rad"]
    assert settled.iloc[195] == pytest.approx(-0.019, abs=0.003)
    assert settled.iloc[-1] == pytest.approx(-0.036, abs=0.006)
    assert drive.truth["front_mps2"].max() == pytest.approx(4.4, abs=0.4)
