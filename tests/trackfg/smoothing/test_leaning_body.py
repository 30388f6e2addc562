"""A car body that is declared rigid: its lean in curves shows where the speed changes in them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from trackfg.config import SmoothConfig
from trackfg.numerics.units import STANDARD_GRAVITY
from trackfg.recording.model import Recording
from trackfg.smoothing.leaning_body import Lean, circle_sums, circles, lean_of, leaning_body, pull
from trackfg.smoothing.passage import STEP_M, Passage
from trackfg.smoothing.smoother import SmoothedStates, smooth_states


def braking(share: float, cant_rad: float, noise_rad: float, backwards: bool = False) -> Passage:
    """Return a passage of 1 km with a circle of R 500 to the left from 300 to 700 m, from 25 down to 15 m/s."""
    s = np.arange(0.0, 1000.0, STEP_M)
    heading = np.clip(s - 300.0, 0.0, 400.0) / 500.0
    speed = np.linspace(25.0, 15.0, len(s))
    inside = (s >= 300.0) & (s < 700.0)
    pull = inside * speed**2 / 500.0 / STANDARD_GRAVITY
    roll = -cant_rad * inside + share * (pull - cant_rad * inside)
    roll += noise_rad * np.random.default_rng(0).standard_normal(len(s))
    way = -1.0 if backwards else 1.0
    return Passage(way * heading, roll, np.full(len(s), 1e-6), way * speed)


def lean(at: Passage) -> Lean:
    return lean_of(circle_sums(pull(at.speed, at.heading), at.roll, circles(at.heading)))


@pytest.mark.parametrize("share", [0.0, 0.2, 0.4])
@pytest.mark.parametrize("backwards", [False, True])
def test_roll_changes_with_the_speed_in_a_circle_by_the_share(share: float, backwards: bool) -> None:
    seen = lean(braking(share, cant_rad=0.05, noise_rad=3e-4, backwards=backwards))
    assert abs(seen.share - share) < 4.0 * seen.sd
    assert seen.sd < 0.02


def test_at_one_speed_nothing_is_known() -> None:
    at = braking(0.2, 0.05, 0.0)
    assert lean(replace(at, speed=np.full(len(at.speed), 20.0))).sd == np.inf


def test_a_body_declared_rigid_is_found_out_and_its_geometry_not_trusted(
    smoothed: Callable[..., SmoothedStates], on_springs: Callable[..., tuple[Recording, Recording]]
) -> None:
    """Seed 0 brakes in curves. The vehicle of the scenario itself is rigid, and nothing is said of it."""
    recording, declared_rigid = on_springs(0.2, seed=0, duration_s=300.0)
    body = smooth_states(declared_rigid, SmoothConfig())
    (finding,) = leaning_body(body).findings
    assert "of the cant deficiency" in finding.message
    verdicts = {verdict.quantity: verdict.status for verdict in body.verdicts}
    assert verdicts["cross_level"] == verdicts["twist"] == "not_trusted"
    assert verdicts["roll"] == "widened"
    assert not leaning_body(smoothed("mainline", seed=0, duration_s=150.0)).findings
    assert not leaning_body(smooth_states(recording, SmoothConfig())).findings
