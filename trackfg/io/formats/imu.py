"""The table of the inertial sensor."""

from __future__ import annotations

from functools import partial

import numpy as np
import pandas as pd

from trackfg.checks.inertial.packet_stamps import spread_evenly
from trackfg.checks.limits import CheckLimits
from trackfg.io.formats.sensor_format import ReadColumns, RowsAlone, SensorFormat, WrittenTable
from trackfg.numerics import spans
from trackfg.numerics.arrays import Array
from trackfg.recording import canonical
from trackfg.recording.description import Imu
from trackfg.recording.findings import Finding
from trackfg.recording.model import IMU_COLUMNS
from trackfg.sensors.sampling_rate import local_intervals


class ImuFormat(SensorFormat[Imu]):
    """Angular rates and specific forces. Stamps are moved to the centre of a sample's interval."""

    key = "imu"
    model = Imu
    canonical = IMU_COLUMNS

    def columns(self, part: Imu) -> tuple[str, ...]:
        """Return three columns of the gyro and three of the accelerometer."""
        return (*part.gyro, *part.accel)

    def converter(self, part: Imu) -> RowsAlone:
        """Convert to vehicle axes, rad/s and m/s^2."""
        return RowsAlone(partial(canonical.imu_in_body, part, canonical.imu_rotation(part)))

    def on_common_clock(self, part: Imu, t: Array) -> Array:
        """Shift stamps at the start or end of a sample by half a median interval of the rate that there is."""
        if len(t) < 2:
            return canonical.on_common_clock(part, t)
        steps = local_intervals(np.diff(t), spans.median_interval(t))
        return canonical.on_common_clock(part, t, np.append(steps, steps[-1]))

    def with_even_times(self, part: Imu, read: ReadColumns) -> tuple[Array | None, list[Finding]]:
        """Spread samples that a logger stamps by the packet."""
        channels = [channel for name in self.columns(part) if (channel := read.named[name]) is not None]
        if read.t is None or len(channels) < len(self.columns(part)):
            return read.t, []
        even = spread_evenly(read.t, channels)
        return (read.t, []) if even is None else (even.t, [even.finding(part)])

    def gap_limits_s(self, limits: CheckLimits) -> tuple[float, float | None] | None:
        """Return the limits of a warning and of an error, where attitude is lost."""
        return limits.imu_gap_warning_s, limits.imu_gap_error_s

    def written(self, part: Imu, table: pd.DataFrame) -> WrittenTable:
        """Write vehicle axes and SI, stamped at the centre."""
        keys = {
            "stamp": "centre",
            "gyro": IMU_COLUMNS[1:4],
            "gyro_unit": "rad/s",
            "accel": IMU_COLUMNS[4:7],
            "accel_unit": "m/s^2",
            "axes": "FLU",
            "mount_rpy_deg": (0.0, 0.0, 0.0),
        }
        return WrittenTable(keys, table)
