"""A record in which the vehicle stands throughout: what shows in motion alone is not judged, and it is said.

Whether an angular rate is in rad/s or deg/s, gravity does not show: a bias at rest may be of any size. Where the gyro
is as at no rest, but as at one if taken for deg/s, while gravity stays where it is, the unit is doubted: surely if the
rate is about a horizontal axis, about which gravity would turn.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trackfg.checks.contradictions.description_warning import TOML, description_warning
from trackfg.checks.diagnosis import Estimates
from trackfg.checks.diagnosis_axes import specific_force_blocks
from trackfg.checks.limits import CheckLimits
from trackfg.numerics.units import STANDARD_GRAVITY, to_si
from trackfg.recording.findings import Finding
from trackfg.recording.model import IMU_COLUMNS, Recording
from trackfg.sensors.standstills import SWAY, find_standstills

_THROUGHOUT = 0.9
"""Share of a record that rests take up where the vehicle stands throughout: their ends are trimmed."""
_TURNING = 0.02
"""A median rate about a horizontal axis that is no gyro's bias, rad/s, and the turn by it that gravity would show, rad:
poor ones of consumers' devices are off by 1 deg/s."""
_DEG_PER_HOUR = np.degrees(3600.0)


def rest_findings(recording: Recording, estimates: Estimates, limits: CheckLimits) -> list[Finding]:
    """Return what is doubtful, or not judged, of a record in which the vehicle stands throughout."""
    if estimates.standstill_s > _THROUGHOUT * estimates.duration_s:
        return [_unjudged(recording, estimates)]
    if estimates.standstills or recording.description.imu.gyro_unit != "rad/s" or not _gravity_stays(recording):
        return []
    slower = to_si("angular rate", "deg/s") * recording.gyro
    imu = recording.imu.assign(**dict(zip(IMU_COLUMNS[1:4], slower.T, strict=True)))
    rests = find_standstills(replace(recording, imu=imu))
    if np.diff(rests).sum() <= _THROUGHOUT * estimates.duration_s:
        return []
    tilting = float(np.abs(np.median(recording.gyro[:, :2], axis=0)).max())
    if tilting > limits.rate_error_radps:
        return []  # an error says so
    hint = 'the data look like deg/s: set imu.gyro_unit = "deg/s", unless the gyro is that poor'
    if min(tilting, tilting * estimates.duration_s) > _TURNING:
        message = f"the gyro tilts by {tilting:.3g} rad/s, in the median, while gravity stays where it is throughout"
        return [description_warning("gyro-unit", message, "imu.gyro_unit", hint=hint)]
    message = "the gyro is as at no rest, while gravity stays where it is throughout"
    return [Finding("info", "rest-throughout", message, file=TOML, column="imu.gyro_unit", hint=hint)]


def _unjudged(recording: Recording, estimates: Estimates) -> Finding:
    imu, bias, noise = recording.description.imu, estimates.static_bias, estimates.noise_density
    shown = []
    if bias is not None:
        shown.append(f"a bias of {_DEG_PER_HOUR * max(map(abs, bias.gyro_radps)):.3g} deg/h")
    if noise is not None:
        shown.append(f"white noise of {noise.gyro_white:.3g} rad/s/√Hz")
    of_gyro = f": as declared ({imu.gyro_unit}) it has {' and '.join(shown)}" if shown else ""
    message = f"the vehicle stands throughout, so that the gyro's unit is not judged{of_gyro}"
    hint = "compare that with the sensor's data sheet, and check a record in motion for axes and the wheel, too"
    return Finding("info", "rest-throughout", message, file=TOML, column="imu.gyro_unit", hint=hint)


def _gravity_stays(recording: Recording) -> bool:
    """Return whether the mean force of blocks hardly varies over the record, in size and direction."""
    blocks = specific_force_blocks(recording.imu)
    low, high = np.quantile(blocks, (0.05, 0.95), axis=0)
    size = float(np.linalg.norm(np.median(blocks, axis=0)))
    return bool((high - low <= 2.0 * SWAY[3]).all() and abs(size - STANDARD_GRAVITY) < 1.0)
