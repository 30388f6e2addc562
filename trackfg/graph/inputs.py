"""Factors of one graph are made from the recording, where its keyframes are, and a first guess of the run."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from trackfg.config import SmoothConfig
from trackfg.factors.bias import response_terms
from trackfg.factors.states import SHARED, Nav, Odo, States
from trackfg.graph.wheel_slip import Rolling
from trackfg.numerics.arrays import Array
from trackfg.numerics.geodesy import earth_rate_enu, normal_gravity
from trackfg.numerics.key_figures import Outlined
from trackfg.numerics.spans import within
from trackfg.numerics.units import STANDARD_GRAVITY
from trackfg.recording.description import RecordingDescription
from trackfg.recording.model import Recording
from trackfg.sensors.dead_reckoning import InitialPath
from trackfg.sensors.imu_intervals import Intervals, means_around
from trackfg.sensors.imu_noise.noise_floor import NoiseFloor
from trackfg.sensors.imu_noise.vibration_power import vibration_power
from trackfg.sensors.imu_noise.white_noise import WhiteNoise
from trackfg.sensors.tach import Wheel

_BLOCK = 256
"""Intervals between keyframes that are averaged at once: 50,000 samples at 200 Hz, 1 MB."""

RATE_WINDOW_S = 0.04
"""The body rate of a keyframe is a mean over this T, s. A motion of frequency f keeps sin(pi f T) / (pi f T) of its
rate, 96 % at 4 Hz, above which a body on springs hardly turns; far from the point that follows the track the rest would
count as sideways velocity.
"""

_NO_RATE = 1e-7
"""1-sigma of a rate of the Earth that is known, or of which nothing is declared, rad/s: at the equator a heading that
is wrong by 0.1 deg makes as much. A recording without a latitude may be of a world that does not turn, as simulated
ones are: the data contradict it where it does (:mod:`trackfg.smoothing.wide_priors`)."""


@dataclass(frozen=True, repr=False)
class World(Outlined):
    """The world has a gravity (m/s^2) and turns in n (rad/s, (3,)): not at all where latitude is not known.

    ``unknown_rate_sd``, rad/s, is the 1-sigma of what its rate about each horizontal axis may be besides.
    """

    gravity: float
    earth_rate: Array
    start_yaw: float
    unknown_rate_sd: float = _NO_RATE


def world_of(recording: Recording) -> World:
    """Return gravity, the Earth's rotation and the heading at the start, as far as the recording declares them."""
    track = recording.description.track
    latitude = track.latitude_deg if recording.gnss_origin is None else float(recording.gnss_origin[0])
    height = 0.0 if recording.gnss_origin is None else float(recording.gnss_origin[2])
    gravity = STANDARD_GRAVITY if latitude is None else normal_gravity(latitude, height)
    georeferenced = recording.gnss_origin is not None or track.heading_deg is not None
    start_yaw = 0.0 if track.heading_deg is None else np.pi / 2.0 - np.radians(track.heading_deg)
    if latitude is None:
        return World(gravity, np.zeros(3), start_yaw)
    rate, unknown = earth_rate_enu(latitude), _NO_RATE
    if not georeferenced:  # its direction in n is not known
        unknown = float(np.hypot(*rate[:2]) / np.sqrt(2.0))
        rate[:2] = 0.0
    return World(gravity, rate, start_yaw, unknown)


def hole_noise(config: SmoothConfig) -> tuple[float, float]:
    """Return the densities of body rates and accelerations over a hole in the inertial record."""
    return config.imu.bridge_gyro_white, config.imu.bridge_accel_white


def declared_noise(description: RecordingDescription, config: SmoothConfig) -> tuple[float, float]:
    """Return the densities of the noise of gyro and accelerometer: the declared ones times their level."""
    declared, level = description.imu.noise, config.noise
    return declared.gyro_white * level.gyro, declared.accel_white * level.accel


def still_between(t: Array, rests: Array) -> np.ndarray:
    """Return whether ends and middles of the intervals between ``t`` (n,) are in a rest, shape (n - 1,)."""
    resting = within(t, rests)
    still: np.ndarray = resting[:-1] & resting[1:] & within(0.5 * (t[1:] + t[:-1]), rests)
    return still


@dataclass(frozen=True, repr=False)
class GraphInputs(Outlined):
    """Factors are made from these inputs.

    The keyframes are at times ``t`` (n,), s, which are ``edges`` (n,) of the inertial ``data``; ``rests`` (r, 2), s."""

    recording: Recording
    config: SmoothConfig
    world: World
    data: Intervals
    floor: NoiseFloor
    wheel: Wheel | None
    rests: Array
    path: InitialPath
    rolling: Rolling | None
    edges: np.ndarray
    t: Array
    clock_origin: float
    """When the offset of other clocks is what it is declared to be, before it drifts: the middle of a run."""

    @property
    def lever_arm(self) -> Array:
        """The IMU's position in the vehicle, m, shape (3,)."""
        return np.array(self.recording.description.imu.lever_arm_m)

    @cached_property
    def still(self) -> np.ndarray:
        """Return whether both ends of an interval and its middle are in a standstill, shape (n - 1,)."""
        return still_between(self.t, self.rests)

    @cached_property
    def durations(self) -> Array:
        """Return the time from each keyframe to the next, s, shape (n - 1,)."""
        return np.diff(self.t)

    @cached_property
    def mean_accel(self) -> Array:
        """The accelerometer's mean between keyframes, m/s^2, shape (n - 1, 3)."""
        return self._mean(self.data.accel)

    @cached_property
    def mean_gyro(self) -> Array:
        """The gyro's mean between keyframes, rad/s, shape (n - 1, 3)."""
        return self._mean(self.data.gyro)

    @property
    def mean_rate(self) -> Array:
        """:attr:`mean_gyro` less the initial bias."""
        return self.mean_gyro - self.path.bias(self.t[:-1])

    @cached_property
    def body_rate(self) -> Array:
        """The body rate at the keyframes, rad/s, shape (n, 3): the gyro's mean around them, less the initial bias."""
        return means_around(self.t, RATE_WINDOW_S, self.data.edges, self.data.gyro) - self.path.bias(self.t)

    @cached_property
    def vibration(self) -> Array:
        """The power of the vibration along each axis between keyframes, (m/s^2)^2, shape (n - 1, 3)."""
        return np.column_stack([self._mean(power) for power in vibration_power(self.data)])

    def _mean(self, samples: Array) -> Array:
        """Return the means of samples (n, ...) between keyframes, by blocks: their products are as long as a run."""
        integrals = []
        for first in range(0, len(self.durations), _BLOCK):
            edges = self.edges[first : first + _BLOCK + 1]
            rows = slice(edges[0], edges[-1])
            integrals.append(np.add.reduceat((samples[rows].T * self.data.durations[rows]).T, edges[:-1] - edges[0]))
        return np.asarray((np.concatenate(integrals).T / self.durations).T)

    @cached_property
    def distance(self) -> Array:
        """Initial distance between keyframes, m, shape (n - 1,)."""
        return np.asarray(np.diff(self.distance_at(self.t)))

    def distance_at(self, t: Array) -> Array:
        """Return the initial distance, m: the wheel's without slip, or the length of the initial path. (m,) to (m,).

        Before the first and after the last row of the wheel the speed goes on.
        """
        if self.rolling is not None:
            wheel, path = self.rolling.wheel, self.path
            distance, speeds = wheel.at(t), np.interp(wheel.t[[0, -1]], path.t, path.speed)
            for beyond, end, speed in zip((t < wheel.t[0], t > wheel.t[-1]), wheel.t[[0, -1]], speeds, strict=True):
                distance[beyond] += speed * (t[beyond] - end)
            return distance
        step = np.diff(self.path.p, axis=0)
        length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(step, axis=1))])
        return np.asarray(np.interp(t, self.path.t, length))

    @cached_property
    def noise(self) -> WhiteNoise:
        """White noise of the inertial samples as assumed, from each keyframe to the next."""
        seen = self.floor.between(self.t, *declared_noise(self.recording.description, self.config))
        return seen.over_holes(self.data.bridged[self.edges[:-1]], *hole_noise(self.config))

    @cached_property
    def response(self) -> Array:
        """The derivative of the bias from each keyframe on by the IMU's calibration (n, 6, dim); 0 at the last."""
        middle = 0.5 * (self.t[1:] + self.t[:-1])
        attitude, velocity = self.path.attitude(middle), self.path.velocity(middle)
        terms = response_terms(self.mean_accel, self.mean_rate, self.vibration, attitude, velocity)
        return np.concatenate([terms, np.zeros((1, *terms.shape[1:]))])

    def with_rows(self, recording: Recording, wheel: Wheel | None) -> GraphInputs:
        """Return inputs with other rows than the inertial sensor's: nothing that is computed once depends on them."""
        inputs = copy(self)
        vars(inputs).update(recording=recording, wheel=wheel)
        return inputs

    def with_motion(self, path: InitialPath, rolling: Rolling) -> GraphInputs:
        """Return inputs with another first guess of the motion, and the means as they were computed."""
        return replace(self, path=path, rolling=rolling).knowing(
            durations=self.durations,
            mean_accel=self.mean_accel,
            mean_gyro=self.mean_gyro,
            vibration=self.vibration,
            noise=self.noise,
        )

    def knowing(self, **computed: Array | WhiteNoise) -> GraphInputs:
        """Return inputs with what is ``computed`` once, by name, as it was found elsewhere."""
        inputs = copy(self)
        vars(inputs).update(computed)
        return inputs

    def initial_states(self) -> States:
        """Return the first guess of every variable."""
        n = len(self.t)
        R = self.path.attitude(self.t)
        p = self.path.position(self.t) + R @ self.lever_arm
        bias = np.zeros((n, 6))
        bias[:, 3:] = self.path.bias(self.t)
        bias[:, :3] = 0.0 if self.path.start is None else self.path.start.accel
        distance = np.concatenate([[0.0], np.cumsum(self.distance)])
        count = distance if self.wheel is None else self.wheel.at(self.t)
        start = self._start_distance(distance)
        odo = Odo.of(start + distance, np.ones(n), count, np.diff(distance, prepend=0.0))
        nav, shared = Nav(R, p, self.path.velocity(self.t)), (np.zeros((1, kind.dim)) for kind in SHARED)
        return States(nav, bias, odo, *shared)

    def _start_distance(self, distance: Array) -> float:
        """Return where the run starts, in the sense of running, so that the first fix agrees; 0 without fixes."""
        fixes = self.recording.fixes
        if fixes is None or fixes.empty:
            return 0.0
        at_first = np.interp(fixes["t_s"].iloc[0], self.t, distance)
        return float(self.recording.description.track.direction * fixes["chainage_m"].iloc[0] - at_first)
