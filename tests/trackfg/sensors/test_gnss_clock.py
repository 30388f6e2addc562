"""The offset of a receiver's clock, from the shape of the path."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from trackfg.datasets.scenarios import Simulation
from trackfg.recording.description import Gnss
from trackfg.recording.model import GNSS_COLUMNS, IMU_COLUMNS, Recording
from trackfg.sensors.gnss_clock import gnss_clock


def drive(offset_s: float, seed: int, template: Recording, ahead_m: float = 0.0) -> Recording:
    """A drive through curves at a speed that changes, 0.5 m of noise; the gyro drifts by 0.1 deg/s, the wheel by 2 %.

    Written without trackfg: speed 15 + 5 sin(t / 20), yaw rate 0.03 sin(t / 13). The antenna is
    ``ahead_m`` ahead, which is not declared.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 300.0, 0.02)
    speed, rate = 15.0 + 5.0 * np.sin(t / 20.0), 0.03 * np.sin(t / 13.0)
    heading = -0.03 * 13.0 * (np.cos(t / 13.0) - 1.0) + 1.0
    east, north = (np.cumsum(speed * wave(heading)) * 0.02 + ahead_m * wave(heading) for wave in (np.cos, np.sin))
    imu = pd.DataFrame(0.0, index=range(len(t)), columns=list(IMU_COLUMNS)).assign(
        t_s=t, wz_radps=rate + np.radians(0.1), fz_mps2=9.8
    )
    tach = pd.DataFrame({"t_s": t, "distance_m": np.cumsum(speed) * 0.02 * 1.02})
    at = np.arange(5.0, 295.0, 1.0)
    gnss = pd.DataFrame(0.5, index=range(len(at)), columns=list(GNSS_COLUMNS)).assign(
        t_s=at - offset_s,
        east_m=np.interp(at, t, east) + 0.5 * rng.standard_normal(len(at)),
        north_m=np.interp(at, t, north) + 0.5 * rng.standard_normal(len(at)),
    )
    part = Gnss(file="gnss.csv", position=("e", "n", "u"), sd=("se", "sn", "su"), frame="local")
    description = template.description.model_copy(update={"gnss": part})
    return replace(template, description=description, imu=imu, tach=tach, gnss=gnss)


def with_arm(recording: Recording, ahead_m: float) -> Recording:
    """Declare where the antenna is."""
    assert recording.description.gnss is not None
    part = recording.description.gnss.model_copy(update={"lever_arm_m": (ahead_m, 0.0, 0.0)})
    return replace(recording, description=recording.description.model_copy(update={"gnss": part}))


@pytest.mark.parametrize("offset_s", [-2.0, -0.4, 0.0, 1.5])
def test_the_offset_is_found_with_its_sigma(offset_s: float, simulated: Callable[..., Simulation]) -> None:
    template = simulated("mainline-gnss", seed=2, duration_s=40.0).recording
    errors = []
    for seed in range(12):
        found = gnss_clock(with_arm(drive(offset_s, seed, template), 0.0))
        assert found is not None
        errors.append((found.offset_s - offset_s) / found.sd_s)
        assert found.sd_s < 0.25
    assert np.sqrt(np.mean(np.square(errors))) < 2.5


def test_errors_that_last_are_no_offset(simulated: Callable[..., Simulation]) -> None:
    """Errors of 6 m for 10 s make the cost uneven from one lag to the next, and its bend there no measure of sigma."""
    recording = simulated("mainline-gnss", seed=3, duration_s=400.0).recording
    assert recording.gnss is not None
    measured = recording.gnss[["east_m", "north_m"]]
    off = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        lasting = np.zeros(measured.shape)
        for k in range(len(lasting)):
            lasting[k] = np.exp(-0.1) * lasting[k - 1] + 2.55 * rng.standard_normal(2)
        moved = measured + lasting + 1.8 * rng.standard_normal(measured.shape)
        clock = gnss_clock(replace(recording, gnss=recording.gnss.assign(**moved)))
        assert clock is not None
        off.append(clock.offset_s / clock.sd_s)
    assert np.max(np.abs(off)) < 4.0


@pytest.mark.parametrize(("ahead_m", "declared"), [(6.0, True), (6.0, False), (-6.0, False), (12.0, False)])
def test_an_antenna_ahead_is_no_clock_that_is_early(
    ahead_m: float, declared: bool, simulated: Callable[..., Simulation]
) -> None:
    """At 15 m/s 6 m are 0.4 s. Where the antenna is declared nothing is left of it, else no sure offset."""
    template = simulated("mainline-gnss", seed=2, duration_s=40.0).recording
    found = []
    for seed in range(12):
        run = drive(0.0, seed, template, ahead_m)
        clock = gnss_clock(with_arm(run, ahead_m) if declared else run)
        assert clock is not None
        found.append((clock.offset_s, clock.sd_s))
    offset, sd = np.array(found).T
    assert (np.abs(offset) < 3.0 * sd).all()
    assert abs(offset.mean()) < (0.03 if declared else 0.2)


def test_a_short_run_says_nothing(simulated: Callable[..., Simulation]) -> None:
    assert gnss_clock(simulated("mainline-gnss", seed=2, duration_s=40.0).recording) is None
