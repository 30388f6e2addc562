"""The inertial factors are GTSAM's own preintegration.

Forster et al., "On-manifold preintegration for real-time visual-inertial odometry", IEEE Trans. Robotics 33 (2017), as
implemented by GTSAM, with the Earth's rotation (``omegaCoriolis``) when latitude and heading are known. The residual of
``gtsam.ImuFactor2`` is (rad, m, m/s) in body axes of the predicted state.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import gtsam
import numpy as np

from trackfg.factors.linear import LinearFactors, Slot
from trackfg.factors.states import Kind, Nav
from trackfg.numerics.arrays import Array

_INTEGRATION_DENSITY = 1e-5
"""m/sqrt(s): process noise on position, for what the trapezoid inside one increment leaves out."""


@dataclass(frozen=True)
class PreintegrationNoise:
    """The white noise that GTSAM assumes has these densities.

    Gyro (3,) rad/s/sqrt(Hz) and accelerometer (3,) m/s^2/sqrt(Hz) along the body's axes, the position itself m/sqrt(s).
    """

    gyro: Array
    accel: Array
    position: float = _INTEGRATION_DENSITY

    @classmethod
    def alike(cls, gyro: float, accel: float, position: float = _INTEGRATION_DENSITY) -> PreintegrationNoise:
        """Return the noise of sensors whose axes are all alike."""
        return cls(np.full(3, gyro), np.full(3, accel), position)

    def parameters(self, gravity: float, frame_rate: Array) -> gtsam.PreintegrationParams:
        """Return GTSAM's parameters for a z-up frame n with this gravity (m/s^2).

        The frame turns at ``frame_rate`` (3,), rad/s in n.
        """
        parameters = gtsam.PreintegrationParams.MakeSharedU(gravity)
        parameters.setGyroscopeCovariance(np.eye(3) * self.gyro**2)
        parameters.setAccelerometerCovariance(np.eye(3) * self.accel**2)
        parameters.setIntegrationCovariance(np.eye(3) * self.position**2)
        parameters.setOmegaCoriolis(frame_rate)
        return parameters


def preintegrate(
    parameters: gtsam.PreintegrationParams, bias: Array, duration: Array, rotation: Array, velocity: Array
) -> gtsam.PreintegratedImuMeasurements:
    """Preintegrate increments (duration (m,) s, rotation (m, 3) rad, velocity (m, 3) m/s) around ``bias`` (6,)."""
    preintegrated = gtsam.PreintegratedImuMeasurements(
        parameters, gtsam.imuBias.ConstantBias(bias[:3].copy(), bias[3:].copy())
    )
    accel, gyro = velocity / duration[:, None], rotation / duration[:, None]
    integrate = preintegrated.integrateMeasurement
    for f, w, dt in zip(accel, gyro, duration.tolist(), strict=True):
        integrate(f, w, dt)
    return preintegrated


@dataclass(frozen=True)
class Preintegration:
    """The inertial sensor measured these increments over an interval, as :func:`preintegrate` takes them.

    With them are their white noise, and the ``gravity`` (m/s^2) and turning (``frame_rate`` (3,), rad/s) of the frame.
    GTSAM's own object does not tell them, and where it is written down it loses the frame's turning; from them it can
    be made again at any time, the same to the last bit.
    """

    noise: PreintegrationNoise
    gravity: float
    frame_rate: Array
    bias: Array
    duration: Array
    rotation: Array
    velocity: Array

    @cached_property
    def measured(self) -> gtsam.PreintegratedImuMeasurements:
        """GTSAM's object of the same increments."""
        parameters = self.noise.parameters(self.gravity, self.frame_rate)
        return preintegrate(parameters, self.bias, self.duration, self.rotation, self.velocity)

    def predicted(self, nav: Nav, bias: Array) -> Nav:
        """Return the state at the end of the interval, from that at its start (one row) with ``bias`` (6,)."""
        state = gtsam.NavState(gtsam.Rot3(nav.R[0]), nav.p[0], nav.v[0])
        end = self.measured.predict(state, gtsam.imuBias.ConstantBias(bias[:3].copy(), bias[3:].copy()))
        return Nav(end.attitude().matrix()[None], end.position()[None], end.velocity()[None])


def imu_factors(preintegrated: Iterable[gtsam.PreintegratedImuMeasurements]) -> list[gtsam.ImuFactor2]:
    """Factor k ties the states of keyframes k and k + 1 and the bias of keyframe k."""
    measurements = list(preintegrated)
    index = np.arange(len(measurements) + 1)
    nav, bias = Kind.NAV.keys(index).tolist(), Kind.BIAS.keys(index).tolist()
    return [gtsam.ImuFactor2(nav[k], nav[k + 1], bias[k], pim) for k, pim in enumerate(measurements)]


def linearize_imu_factors(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> LinearFactors:
    """Return a graph of :func:`imu_factors` linearised by GTSAM's own derivatives."""
    linear = graph.linearize(values)
    systems = np.array([linear.at(k).augmentedJacobian() for k in range(linear.size())])
    first = np.arange(len(systems))
    slots = (Slot(Kind.NAV, first), Slot(Kind.NAV, first + 1), Slot(Kind.BIAS, first))
    return LinearFactors(slots, systems)
