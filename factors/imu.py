"""The inertial factors are GTSAM's own preintegration, or the same computed by a compiled kernel.

Forster et al., "On-manifold preintegration for real-time visual-inertial odometry", IEEE Trans. Robotics 33 (2017), as
implemented by GTSAM, with the Earth's rotation (``omegaCoriolis``) when latitude and heading are known. The residual of
``gtsam.ImuFactor2`` is (rad, m, m/s) in body axes of the predicted state.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING
from weakref import WeakValueDictionary

import numpy as np

from trackfg.factors.linear import LinearFactors, Slot
from trackfg.factors.states import Kind, Nav, States
from trackfg.numerics.arrays import Array
from trackfg.numerics.kernels import compiled_kernels, kernel_argument
from trackfg.numerics.key_figures import Outlined

if TYPE_CHECKING:
    import gtsam

_INTEGRATION_DENSITY = 1e-5
"""m/sqrt(s): process noise on position, for what the trapezoid inside one increment leaves out."""

_AXES = np.eye(3)


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

    def scaled(self, gyro: Array | float, accel: Array | float) -> PreintegrationNoise:
        """Return the noise with so many times the densities of gyro and accelerometer, per axis or of all."""
        return PreintegrationNoise(self.gyro * gyro, self.accel * accel, self.position)

    def parameters(self, gravity: float, frame_rate: Array) -> gtsam.PreintegrationParams:
        """Return GTSAM's parameters for a z-up frame n with this gravity (m/s^2).

        The frame turns at ``frame_rate`` (3,), rad/s in n.
        """
        import gtsam

        parameters = gtsam.PreintegrationParams.MakeSharedU(gravity)
        parameters.setGyroscopeCovariance(_AXES * self.gyro**2)
        parameters.setAccelerometerCovariance(_AXES * self.accel**2)
        parameters.setIntegrationCovariance(_AXES * self.position**2)
        parameters.setOmegaCoriolis(frame_rate)
        return parameters


def preintegrate(
    parameters: gtsam.PreintegrationParams, bias: Array, duration: Array, rotation: Array, velocity: Array
) -> gtsam.PreintegratedImuMeasurements:
    """Preintegrate increments (duration (m,) s, rotation (m, 3) rad, velocity (m, 3) m/s) around ``bias`` (6,)."""
    import gtsam

    preintegrated = gtsam.PreintegratedImuMeasurements(
        parameters, gtsam.imuBias.ConstantBias(bias[:3].copy(), bias[3:].copy())
    )
    accel, gyro = velocity / duration[:, None], rotation / duration[:, None]
    integrate = preintegrated.integrateMeasurement
    for f, w, dt in zip(accel, gyro, duration.tolist(), strict=True):
        integrate(f, w, dt)
    return preintegrated


@dataclass(frozen=True, repr=False)
class Preintegration(Outlined):
    """The inertial sensor measured these increments over an interval, as :func:`preintegrate` takes them.

    With them are their white noise, and the ``gravity`` (m/s^2) and turning (``frame_rate`` (3,), rad/s) of the frame.
    GTSAM's own object does not give them, and where it is written down it loses the frame's turning; from them it can
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

    @cached_property
    def delta(self) -> Array:
        """The preintegrated measurement as the compiled kernels keep it, shape (DELTA_SIZE,)."""
        from trackfg.numerics import compiled

        frame = np.append(self.gravity, self.frame_rate)
        noise = np.concatenate([self.noise.gyro, self.noise.accel, [self.noise.position]]) ** 2
        given = (self.bias, self.duration, self.rotation, self.velocity)
        bias, duration, rotation, velocity = map(kernel_argument, given)
        out = np.empty(compiled.DELTA_SIZE)
        compiled.preintegrate(frame, bias, noise, duration, rotation, velocity, out)
        return out

    def predicted(self, nav: Nav, bias: Array) -> Nav:
        """Return the state at the end of the interval, from that at its start (one row) with ``bias`` (6,)."""
        if compiled_kernels():
            from trackfg.numerics import compiled

            out = np.empty(15)
            R, p, v, b = map(kernel_argument, (nav.R[0], nav.p[0], nav.v[0], bias))
            compiled.predict(self.delta, R, p, v, b, out)
            return Nav(out[None, :9].reshape(1, 3, 3), out[None, 9:12], out[None, 12:])
        import gtsam

        state = gtsam.NavState(gtsam.Rot3(nav.R[0]), nav.p[0], nav.v[0])
        end = self.measured.predict(state, gtsam.imuBias.ConstantBias(bias[:3].copy(), bias[3:].copy()))
        return Nav(end.attitude().matrix()[None], end.position()[None], end.velocity()[None])


@dataclass(frozen=True, repr=False)
class InertialFactors(Outlined):
    """Factor k ties the states of keyframes k and k + 1 and the bias of keyframe k.

    Compiled kernels compute them where these are in use, GTSAM elsewhere, with the same result.
    """

    measured: tuple[Preintegration, ...]

    @classmethod
    def of(cls, measured: tuple[Preintegration, ...]) -> InertialFactors:
        """Return the factors of these measurements: what was made of them is shared by all problems that have them."""
        factors = _MADE.get(id(measured))
        if factors is None:
            factors = _MADE[id(measured)] = cls(measured)
        return factors

    @cached_property
    def graph(self) -> gtsam.NonlinearFactorGraph:
        """GTSAM's own factors."""
        import gtsam

        graph = gtsam.NonlinearFactorGraph()
        for factor in imu_factors(preintegration.measured for preintegration in self.measured):
            graph.add(factor)
        return graph

    def linearize(self, states: States) -> LinearFactors:
        """Return all factors linearised at ``states``: rows (n - 1, 9, 25) of rotation, position and velocity."""
        if not compiled_kernels():
            return linearize_imu_factors(self.graph, states.inertial_values)
        return LinearFactors(_slots(len(self.measured)), self._rows(states, Kind.NAV.dim * 2 + Kind.BIAS.dim + 1))

    def costs(self, states: States) -> Array:
        """Return half the square of each factor's whitened residual at ``states``, shape (n - 1,)."""
        if not compiled_kernels():
            values = states.inertial_values
            return np.array([self.graph.at(k).error(values) for k in range(self.graph.size())])
        return np.asarray(0.5 * np.sum(self._rows(states, 1) ** 2, axis=(1, 2)))

    def cost(self, states: States) -> float:
        """Return the sum of the costs of all factors at ``states``."""
        if not compiled_kernels():
            return float(self.graph.error(states.inertial_values))
        return float(np.sum(self.costs(states)))

    @cached_property
    def deltas(self) -> Array:
        """All preintegrated measurements, shape (n - 1, DELTA_SIZE). Each interval keeps its row, and no copy of it."""
        from trackfg.numerics import compiled

        rows = np.empty((len(self.measured), compiled.DELTA_SIZE))
        for interval, row in zip(self.measured, rows, strict=True):
            row[:] = interval.delta
            vars(interval)["delta"] = row
        return rows

    def _rows(self, states: States, columns: int) -> Array:
        from trackfg.numerics import compiled

        rows = np.empty((len(self.measured), Kind.NAV.dim, columns))
        if len(rows):
            nav = states.nav
            R, p, v, bias = map(kernel_argument, (nav.R, nav.p, nav.v, states.bias))
            compiled.inertial_factors(self.deltas, R, p, v, bias, rows)
        return rows


_MADE: WeakValueDictionary[int, InertialFactors] = WeakValueDictionary()
"""Factors by the identity of their measurements, which they keep alive."""


def imu_factors(preintegrated: Iterable[gtsam.PreintegratedImuMeasurements]) -> list[gtsam.ImuFactor2]:
    """Factor k ties the states of keyframes k and k + 1 and the bias of keyframe k."""
    import gtsam

    measurements = list(preintegrated)
    index = np.arange(len(measurements) + 1)
    nav, bias = Kind.NAV.keys(index).tolist(), Kind.BIAS.keys(index).tolist()
    return [gtsam.ImuFactor2(nav[k], nav[k + 1], bias[k], pim) for k, pim in enumerate(measurements)]


@lru_cache(maxsize=1)
def linearize_imu_factors(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> LinearFactors:
    """Return a graph of :func:`imu_factors` linearised by GTSAM's own derivatives; the last one is kept, since a run
    asks at its solution for it again and again.
    """
    linear = graph.linearize(values)
    systems = np.array([linear.at(k).augmentedJacobian() for k in range(linear.size())])
    return LinearFactors(_slots(len(systems)), systems)


def _slots(count: int) -> tuple[Slot, ...]:
    first = np.arange(count)
    return Slot(Kind.NAV, first), Slot(Kind.NAV, first + 1), Slot(Kind.BIAS, first)
