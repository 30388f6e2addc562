"""Two displacement sensors over one rail: zero for a rigid body passing a wavy rail, and what errors look like."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.optimize import brentq

from trackfg.factors.family import Family
from trackfg.factors.rail import RailSightings, same_rail
from trackfg.factors.states import Kind, Nav, Odo, States
from trackfg.numerics.rotations import matrix_from_rpy, so3_exp

LEAD_M = 2.5
SPEED_MPS, KEYFRAME_S, KEYFRAMES = 4.0, 0.5, 12


def rotation(t: float | np.ndarray) -> np.ndarray:
    """A body that rolls, pitches and turns on its springs."""
    t = np.atleast_1d(np.asarray(t, dtype=float))
    return matrix_from_rpy(0.03 * np.sin(5 * t), 0.01 * np.cos(4 * t), 0.05 * t + 0.01 * np.sin(3 * t))


def position(t: float | np.ndarray) -> np.ndarray:
    """It runs on a gradient and bounces by centimetres."""
    t = np.atleast_1d(np.asarray(t, dtype=float))
    x = SPEED_MPS * t
    return np.stack([x, 0.05 * SPEED_MPS * t**2 / 2 + 0.01 * np.sin(7 * t), 0.02 * x + 0.02 * np.cos(6 * t)], axis=1)


def rail(x: float) -> np.ndarray:
    """Level and alignment of millimetres on a rail 0.6 m below and 0.5 m to the left."""
    t = x / SPEED_MPS
    centre = np.array([x, 0.05 * SPEED_MPS * t**2 / 2, 0.02 * x])
    return centre + np.array([0.0, 0.5 + 4e-3 * np.sin(2 * np.pi * x / 7), -0.6 + 5e-3 * np.cos(2 * np.pi * x / 9)])


def in_body(t: float, point: np.ndarray) -> np.ndarray:
    return np.asarray(rotation(t)[0].T @ (point - position(t)[0]))


def seen(t: float, along_m: float) -> np.ndarray:
    """Where on the rail the unit ``along_m`` ahead looks at time t."""
    x = position(t)[0, 0] + along_m
    return rail(brentq(lambda x: in_body(t, rail(x))[0] - along_m, x - 2.0, x + 2.0, xtol=1e-13))


@dataclass(frozen=True)
class Pairs:
    """What the factors are made of: the readings of both units in body axes, when, and the motion in between."""

    first: np.ndarray
    start: np.ndarray
    fraction: np.ndarray
    lead: np.ndarray
    trail: np.ndarray
    states: States

    def families(self, gyro_bias: np.ndarray | None = None) -> tuple[Family, Family]:
        nav, T = self.states.nav, np.full(len(self.first), KEYFRAME_S)
        late = KEYFRAME_S * (self.start + self.fraction)
        start, end, h, T1 = nav[self.start], nav[self.start + 1], self.fraction[:, None], KEYFRAME_S
        back = np.swapaxes(start.R, 1, 2)
        cubic = (
            (1 - 3 * h**2 + 2 * h**3) * start.p
            + (3 * h**2 - 2 * h**3) * end.p
            + T1 * (h - 2 * h**2 + h**3) * start.v
            + T1 * (h**3 - h**2) * end.v
        )
        turned, turn = back @ rotation(late), back @ end.R
        if gyro_bias is not None:
            turned, turn = (R @ so3_exp(gyro_bias * T1 * s) for R, s in ((turned, h), (turn, np.ones_like(h))))
        across = np.tile([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], (len(self.first), 1, 1))
        seen = RailSightings(
            first=self.first,
            start=self.start,
            fraction=self.fraction,
            interval=T,
            across=across,
            lead=self.lead,
            trail=self.trail,
            turned=turned,
            turn=turn,
            detail=position(late) - cubic,
        )
        return same_rail(seen, np.ones((len(self.first), 2)), None)


def pairs(trail_m: float) -> Pairs:
    t = KEYFRAME_S * np.arange(KEYFRAMES)
    first, late, lead, trail = [], [], [], []
    for k in range(KEYFRAMES):
        point = seen(t[k], LEAD_M)

        def beside(time: float, point: np.ndarray = point) -> float:
            return float(in_body(time, point)[0] - trail_m)

        time = brentq(beside, t[k], t[k] + 3.0, xtol=1e-13)
        if time < t[-1]:
            first.append(k)
            late.append(time)
            lead.append(in_body(t[k], point))
            trail.append(in_body(time, point))
    at = np.array(late) / KEYFRAME_S
    start = np.floor(at).astype(int)
    step = 1e-6
    v = (position(t + step) - position(t - step)) / (2 * step)
    nav, n = Nav(rotation(t), position(t), v), len(t)
    states = States(
        nav, np.zeros((n, 6)), Odo(np.zeros((n, 4))), np.zeros((1, 5)), np.zeros((1, 3)), np.zeros((1, Kind.IMU.dim))
    )
    return Pairs(np.array(first), start, at - start, np.array(lead), np.array(trail), states)


APART, WITHIN = -2.5, 1.5
"""The trailing unit's place: it comes by 1.25 s later, two or three keyframes on, or within the same interval."""


@pytest.fixture(scope="module", params=[APART, WITHIN], ids=["apart", "within"])
def passing(request: pytest.FixtureRequest) -> Pairs:
    return pairs(request.param)


def whole(families: tuple[Family, Family], states: States) -> np.ndarray:
    return np.concatenate([family.residual(states) for family in families if len(family)])


def test_families_are_distinguished_by_their_keyframes() -> None:
    for place, (within, apart) in ((APART, (0, 9)), (WITHIN, (11, 0))):
        assert [len(family) for family in pairs(place).families()] == [within, apart]


def test_residual_is_zero_for_a_rigid_body_that_passes_a_wavy_rail(passing: Pairs) -> None:
    """Rolling, pitching, turning and bouncing by centimetres, over a rail with waves of millimetres."""
    assert np.abs(whole(passing.families(), passing.states)).max() < 1e-9
    # The readings themselves differ by centimetres.
    assert np.abs(passing.lead - passing.trail)[:, 1:].max() > 0.01


def test_steady_gyro_bias_is_not_seen(passing: Pairs) -> None:
    """What the gyro says of the turn until then is closed at the end: of 2e-3 rad/s, 5 mrad in all, little is left."""
    bias = np.array([2e-3, -2e-3, 2e-3])
    assert np.abs(whole(passing.families(bias), passing.states)).max() < 2e-5


def test_wrong_pitch_at_the_leading_unit_shows_by_its_arm() -> None:
    """A keyframe nose-down by 1 mrad puts the leading unit's point 2.5 mm lower; and with it that of a trailing one."""
    passing = pairs(APART)
    k = 4
    nav, tilt = passing.states.nav, so3_exp(np.array([[0.0, 1e-3, 0.0]]))[0]
    R = nav.R.copy()
    R[k] = R[k] @ tilt
    askew = States(
        Nav(R, nav.p, nav.v), *(getattr(passing.states, name) for name in ("bias", "odo", "mount", "clock", "imu"))
    )
    (_, apart) = passing.families()
    residual = apart.residual(askew)
    row = np.flatnonzero(passing.first == k)[0]
    assert residual[row, 1] == pytest.approx(-1e-3 * LEAD_M, rel=0.05)
    touched = (passing.first == k) | (passing.start == k) | (passing.start + 1 == k)
    assert np.abs(residual[~touched]).max() < 1e-9


def test_a_step_of_one_reading_is_the_residual(passing: Pairs) -> None:
    """1 mm more at the leading unit, upwards in the body, is 1 mm up: the trailing unit saw another point."""
    raised = replace(passing, lead=passing.lead + np.array([0.0, 0.0, 1e-3]))
    np.testing.assert_allclose(
        whole(raised.families(), passing.states), np.tile([0.0, 1e-3], (len(passing.first), 1)), atol=1e-8
    )


def test_points_apart_along_the_rail_show_nothing_of_the_heading(passing: Pairs) -> None:
    """A match that is off by 10 mm has the same residual when the whole run is turned by 0.1 rad."""
    off = replace(passing, trail=passing.trail + np.array([0.01, 0.0, 0.0])).families()
    nav, turn = passing.states.nav, so3_exp(np.array([[0.0, 0.0, 0.1]]))[0]
    turned = replace(passing.states, nav=Nav(turn @ nav.R, nav.p @ turn.T, nav.v @ turn.T))
    # What the accelerometer saw of the path turns with the run; the factors have it in axes of navigation.
    details = [family.with_data(detail=family.data["detail"] @ turn.T) for family in off if len(family)]
    after = np.concatenate([family.residual(turned) for family in details])
    assert np.abs(whole(off, passing.states)).max() < 1e-3
    np.testing.assert_allclose(after, whole(off, passing.states), atol=1e-9)
