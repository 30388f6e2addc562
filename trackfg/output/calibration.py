"""The calibration table has wheel scale and the inertial sensor's own biases at any times, each with its sigma."""

from __future__ import annotations

import numpy as np
import pandas as pd

from trackfg.factors.states import Kind, Odo, States, offset_in_keyframe
from trackfg.numerics.arrays import Array
from trackfg.solver.covariance import Covariance

_NAMES = (
    "wheel_scale",
    *(f"accel_bias_{axis}_mps2" for axis in "xyz"),
    *(f"gyro_bias_{axis}_radps" for axis in "xyz"),
)


def calibration_table(
    t: Array, keyframe_t: Array, response: Array, states: States, covariance: Covariance
) -> pd.DataFrame:
    """Return one row per time ``t`` (m,), s: ``t_s``, and wheel scale and biases (m/s^2, rad/s), each with its sigma.

    Values and variances are linear in time between the keyframes at ``keyframe_t`` (n,), s. ``response`` (n, 6, dim) is
    the derivative of each keyframe's bias b by the IMU's calibration c: the sensor's own one is ``b - response c``.
    """
    left = np.clip(np.searchsorted(keyframe_t, t, side="right") - 1, 0, len(keyframe_t) - 2)
    needed = np.unique([left, left + 1])
    values, variances = _at_keyframes(needed, response[needed], states, covariance)
    table = {"t_s": t}
    for name, value, variance in zip(_NAMES, values.T, variances.T, strict=True):
        table[name] = np.interp(t, keyframe_t[needed], value)
        table[f"{name}_sd"] = np.sqrt(np.interp(t, keyframe_t[needed], variance))
    return pd.DataFrame(table)


def _at_keyframes(
    keyframes: np.ndarray, response: Array, states: States, covariance: Covariance
) -> tuple[Array, Array]:
    """Return the values of :data:`_NAMES` at some keyframes, and their variances, (m, 7) each."""
    odo, bias, imu = (offset_in_keyframe(kind) for kind in (Kind.ODO, Kind.BIAS, Kind.IMU))
    rows = np.concatenate([[odo + Odo.SCALE], np.arange(bias, bias + Kind.BIAS.dim)])
    of_rows = covariance.rows(keyframes, rows)
    own_bias = states.bias[keyframes] - response @ states.imu[0]
    variances = np.take_along_axis(of_rows, rows[None, :, None], axis=2)[:, :, 0]
    by_response = response @ covariance.of(Kind.IMU)[0] - 2.0 * of_rows[:, 1:, imu : imu + Kind.IMU.dim]
    variances[:, 1:] += np.einsum("nij,nij->ni", by_response, response)
    return np.column_stack([states.odo.scale[keyframes], own_bias]), variances
