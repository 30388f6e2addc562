"""Where a speed may be at rest, by hand: a movement of constant jerk whose speed is cut off to steps."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from trackfg.sensors.tach_rests import tach_rests


@pytest.mark.parametrize("step_mps", [0.1, 0.5])
@pytest.mark.parametrize("jerk", [0.3, 1.0])
def test_a_speed_in_steps_is_at_rest_once_the_vehicle_is(step_mps: float, jerk: float) -> None:
    """At rest from 20 to 40 s; the speed shows nothing for sqrt(2 step / jerk), 0.4 to 1.8 s, at either end.

    What is cut off the speed is half a step on average, so the rest is known to 0.2 s.
    """
    t = np.arange(0.0, 60.0, 0.02)
    speed = np.minimum(0.5 * jerk * np.maximum(np.abs(t - 30.0) - 10.0, 0.0) ** 2, 10.0)
    shown = np.floor(speed / step_mps) * step_mps
    distance = np.concatenate([[0.0], np.cumsum(0.5 * (shown[1:] + shown[:-1])) * 0.02])
    tach = pd.DataFrame({"t_s": t, "distance_m": distance})
    spans = tach_rests(tach, (0.0, 60.0), integrates_speed=True, silent_at_rest=None).spans
    assert spans == pytest.approx(np.array([[20.0, 40.0]]), abs=0.2)


def test_a_count_without_its_slips_rests_as_before() -> None:
    """The rows of a distance without a slip are no multiples of a count, which is given then.

    Of 0.03 m, at a jerk of 0.3 m/s^3: the count stands for up to 0.6 s while the vehicle still moves.
    """
    quantum, t = 0.03, np.arange(0.0, 60.0, 0.02)
    away = np.maximum(np.abs(t - 30.0) - 10.0, 0.0)
    tach = pd.DataFrame({"t_s": t, "distance_m": np.floor(np.sign(t - 30.0) * 0.05 * away**3 / quantum) * quantum})
    slipped = 0.2 * np.clip(t - 5.0, 0.0, 1.0)
    without = tach.assign(distance_m=tach["distance_m"] - slipped)
    given = tach_rests(without, (0.0, 60.0), integrates_speed=False, quantum_m=quantum).spans
    assert given == pytest.approx(tach_rests(tach, (0.0, 60.0), integrates_speed=False).spans)
    assert given[0, 0] >= 20.0
    assert given[0, 1] <= 40.0
