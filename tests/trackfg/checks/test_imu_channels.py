"""Warnings about channels of the IMU, in the sensor's own axes."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from trackfg.checks.inertial.imu_channels import findings
from trackfg.checks.limits import CheckLimits
from trackfg.recording.canonical import imu_rotation
from trackfg.recording.description import Imu
from trackfg.recording.model import IMU_COLUMNS

COUNT, RATE_HZ = 4000, 200.0


@pytest.mark.parametrize("mounting", [(0.0, 0.0, 0.0), (3.0, -2.0, 40.0)])
@pytest.mark.parametrize(("begin", "end"), [(2000, 2300), (2000, 2020), (0, COUNT)])
def test_a_stuck_channel_is_found_however_the_sensor_is_mounted(
    mounting: tuple[float, float, float], begin: int, end: int
) -> None:
    imu = Imu(file="imu.csv", time="t", gyro=("a", "b", "c"), accel=("d", "e", "f"), mount_rpy_deg=mounting)
    sensor = np.random.default_rng(0).normal(0.0, 0.01, (COUNT, 6))
    sensor[:, 5] += 9.8
    sensor[begin:end, 1] = sensor[begin, 1]
    R = imu_rotation(imu)
    body = np.hstack([sensor[:, :3] @ R.T, sensor[:, 3:] @ R.T])
    table = pd.DataFrame(np.column_stack([np.arange(COUNT) / RATE_HZ, body]), columns=list(IMU_COLUMNS))
    (finding,) = findings(imu, table, CheckLimits())
    assert (finding.code, finding.column, finding.row) == ("stuck-channel", "b", begin + 1)
