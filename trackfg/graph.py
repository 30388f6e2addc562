"""From a recording to a factor graph with initial values.

==================  =============================================================================================
native factors      inertial factors, GTSAM's own
families            priors, bias walk, distance chain, tach, arc length, path, non-holonomic, standstill, fixes, GNSS
==================  =============================================================================================

Each accelerometer sample is counted once: it is in the inertial factors, and no gravity factor uses it again. A
recording in which nothing measures speed (no tach, no GNSS) is the exception: there the inertial factors' accelerometer
gets no weight and gravity tilt factors carry the samples instead, with a sigma that covers the unknown accelerations.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import gtsam
import numpy as np
import pandas as pd

from trackfg.config import SmoothConfig
from trackfg.description import Gnss
from trackfg.errors import UnsolvableError
from trackfg.factors.bias import bias_walk, response_sigmas, response_terms
from trackfg.factors.family import Family, Loss
from trackfg.factors.gnss import gnss_position
from trackfg.factors.gravity import gravity_tilt
from trackfg.factors.imu import ImuNoise, imu_factors, preintegrate
from trackfg.factors.motion import at_rest, non_holonomic, stays
from trackfg.factors.odometry import absolute_fix, arc_length, distance_chain, tach_distance, tach_reading
from trackfg.factors.path import follows_path
from trackfg.factors.prior import nav_prior, prior
from trackfg.factors.states import SHARED, Kind, Nav, States
from trackfg.frames import EARTH_RADIUS, Array, earth_rate_enu, normal_gravity, transport_rate
from trackfg.inertial import Intervals, compress, intervals, means_around, turning
from trackfg.initial import InitialPath, initial_path
from trackfg.keyframes import nearest, place_keyframes
from trackfg.recording import Recording
from trackfg.spans import within
from trackfg.standstill import find_standstills
from trackfg.units import STANDARD_GRAVITY
from trackfg.wheel import Wheel, read_wheel

_INCREMENT_S = 0.02
"""What GTSAM preintegrates at a time; finer samples are compressed exactly first."""

_UNKNOWN_ACCELERATION = 0.3
"""m/s^2, with a correlation time of 10 s: the accelerations that the tilt of a run without speed has to allow for."""

_RATE_WINDOW_S = 0.1
"""The body rate of a keyframe is a mean over this."""

_DISTANCE_SD_M = 1e-5
_ARC_SD_M = 2e-4
_ARC_SD_RELATIVE = 1e-5
_MOVED_SD_M = 1e4
"""For an interval in which the wheel says nothing: any distance."""


@dataclass(frozen=True)
class World:
    """Gravity (m/s^2) and the Earth's rotation in n (rad/s, (3,)), zero where latitude is not known."""

    gravity: float
    earth_rate: Array
    start_yaw: float


@dataclass(frozen=True)
class Problem:
    """A graph to be solved, and what is needed to interpret the solution."""

    t: Array
    """Keyframe times, s, shape (n,)."""
    native: gtsam.NonlinearFactorGraph
    families: tuple[Family, ...]
    initial: States
    world: World
    lever_arm: Array
    rests: Array
    gaps: Array
    wheel: Wheel | None
    inertial: Intervals
    noise: ImuNoise
    """White noise of the inertial samples as assumed in the graph."""
    edges: np.ndarray
    """The keyframes as indices into ``inertial.edges``, shape (n,)."""
    mount_roll_sd: float
    """Uncertainty of the mounting's roll, rad."""
    response: Array
    """The derivative of each keyframe's bias by the IMU's calibration, shape (n, 6, 21)."""

    def family(self, name: str) -> Family | None:
        """The family of that name, if the graph has it."""
        return next((f for f in self.families if f.name == name), None)


def build_problem(recording: Recording, config: SmoothConfig) -> Problem:
    """Lay out keyframes, factors and initial values. Raises ``UnsolvableError`` for a run too short to hold a graph."""
    data = intervals(recording)
    if len(data) < 10 or data.edges[-1] - data.edges[0] < 0.5:
        raise UnsolvableError(
            f"the IMU record has {len(recording.imu)} samples over {data.edges[-1] - data.edges[0]:.3g} s: "
            "at least 10 samples and 0.5 s are needed"
        )
    world = _world(recording)
    wheel = read_wheel(recording, config.tach.max_gap_s)
    speedless = wheel is None and recording.gnss is None
    rests = np.zeros((0, 2)) if speedless else find_standstills(recording, config.motion.min_rest_s)
    rests = data.edges[nearest(data.edges, rests.ravel())].reshape(-1, 2)
    path = initial_path(recording, data, wheel, rests, world.earth_rate, world.start_yaw)
    gaps = data.gaps()
    edges = place_keyframes(
        data.edges, path.t, path.speed, rests, _required_times(recording, gaps, rests), config.keyframes
    )
    t = data.edges[edges]
    layout = _Layout(recording, config, world, data, wheel, rests, path, edges, t)
    states = layout.initial_states()
    native = layout.native(states, speedless)
    families = layout.families(states, speedless)
    return Problem(
        t=t,
        native=native,
        families=families,
        initial=states,
        world=world,
        lever_arm=layout.lever_arm,
        rests=rests,
        gaps=gaps,
        wheel=wheel,
        inertial=data,
        noise=layout.noise,
        edges=edges,
        mount_roll_sd=np.radians(recording.description.imu.mount_roll_sd_deg),
        response=layout.response,
    )


def _world(recording: Recording) -> World:
    track = recording.description.track
    latitude = track.latitude_deg if recording.gnss_origin is None else float(recording.gnss_origin[0])
    height = 0.0 if recording.gnss_origin is None else float(recording.gnss_origin[2])
    gravity = STANDARD_GRAVITY if latitude is None else normal_gravity(latitude, height)
    georeferenced = recording.gnss_origin is not None or track.heading_deg is not None
    start_yaw = 0.0 if track.heading_deg is None else np.pi / 2.0 - np.radians(track.heading_deg)
    if latitude is None:
        return World(gravity, np.zeros(3), start_yaw)
    rate = earth_rate_enu(latitude)
    if not georeferenced:
        rate[:2] = 0.0  # its direction in n is not known: the gyro bias takes it up
    return World(gravity, rate, start_yaw)


def _required_times(recording: Recording, gaps: Array, rests: Array) -> Array:
    times = [gaps.ravel()]
    if recording.fixes is not None:
        times.append(recording.fixes["t_s"].to_numpy())
    if recording.gnss is not None:
        gnss = recording.gnss["t_s"].to_numpy()
        times.append(gnss[~within(gnss, rests)])
    return np.concatenate(times)


@dataclass(frozen=True)
class _Layout:
    """What the factors of one graph are made from."""

    recording: Recording
    config: SmoothConfig
    world: World
    data: Intervals
    wheel: Wheel | None
    rests: Array
    path: InitialPath
    edges: np.ndarray
    t: Array

    @property
    def lever_arm(self) -> Array:
        """The IMU's position in the vehicle, m, shape (3,)."""
        return np.array(self.recording.description.imu.lever_arm_m)

    @property
    def _still(self) -> np.ndarray:
        """Whether both ends of an interval and its middle are in a standstill, shape (n - 1,)."""
        resting = within(self.t, self.rests)
        still: np.ndarray = resting[:-1] & resting[1:] & within(0.5 * (self.t[1:] + self.t[:-1]), self.rests)
        return still

    @property
    def _distance(self) -> Array:
        """Initial distance between keyframes, m, shape (n - 1,)."""
        return np.asarray(np.diff(self._distance_at(self.t)))

    def _distance_at(self, t: Array) -> Array:
        """Initial distance travelled, m: the wheel's, or the length of the initial path. Shape (m,) to (m,)."""
        if self.wheel is not None:
            return self.wheel.at(t)
        step = np.diff(self.path.p, axis=0)
        length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(step, axis=1))])
        return np.asarray(np.interp(t, self.path.t, length))

    def initial_states(self) -> States:
        n = len(self.t)
        R = self.path.attitude(self.t)
        p = self.path.position(self.t) + R @ self.lever_arm
        bias = np.zeros((n, 6))
        bias[:, 3:] = self.path.bias(self.t)
        distance = np.concatenate([[0.0], np.cumsum(self._distance)])
        count = distance if self.wheel is None else self.wheel.at(self.t)
        start = self._start_distance(distance)
        odo = np.stack([start + distance, np.ones(n), count, np.diff(distance, prepend=0.0)], axis=1)
        nav, shared = Nav(R, p, self.path.velocity(self.t)), (np.zeros((1, kind.dim)) for kind in SHARED)
        return States(nav, bias, odo, *shared)

    def _start_distance(self, distance: Array) -> float:
        """Where the run starts, in the sense of running, so that the first fix agrees; 0 without fixes."""
        fixes = self.recording.fixes
        if fixes is None or fixes.empty:
            return 0.0
        at_first = np.interp(fixes["t_s"].iloc[0], self.t, distance)
        return float(self.recording.description.track.direction * fixes["chainage_m"].iloc[0] - at_first)

    @property
    def noise(self) -> ImuNoise:
        declared, level = self.recording.description.imu.noise, self.config.noise
        return ImuNoise(declared.gyro_white * level.gyro, declared.accel_white * level.accel)

    def native(self, states: States, speedless: bool) -> gtsam.NonlinearFactorGraph:
        """Inertial factors."""
        config = self.config.imu
        measured = replace(self.noise, accel=1e3) if speedless else self.noise
        gyro_bias = states.bias[:, 3:].mean(axis=0)
        bridge = ImuNoise(config.bridge_gyro_white, config.bridge_accel_white)
        gravity, earth = self.world.gravity, self.world.earth_rate
        # The level frame turns with the Earth and, with the vehicle, over its curvature. GTSAM's Coriolis term counts
        # the second twice: v^2 / radius upwards, taken back through gravity.
        velocity = 0.5 * (states.nav.v[1:] + states.nav.v[:-1])
        turning = earth + transport_rate(velocity)
        weight = gravity + np.sum(velocity[:, :2] ** 2, axis=1) / EARTH_RADIUS

        starts, first = increment_starts(self.data, self.edges, _INCREMENT_S)
        increments = compress(self.data, starts, gyro_bias)
        bridged = self.data.bridged[self.edges[:-1]]
        graph = gtsam.NonlinearFactorGraph()
        for factor in imu_factors(
            preintegrate(
                (bridge if bridged[k] else measured).parameters(float(weight[k]), turning[k]),
                states.bias[k],
                increments.duration[a:b],
                increments.rotation[a:b],
                increments.velocity[a:b],
            )
            for k, (a, b) in enumerate(zip(first[:-1].tolist(), first[1:].tolist(), strict=True))
        ):
            graph.push_back(factor)
        return graph

    @property
    def response(self) -> Array:
        """What the calibration of the IMU does to the bias of the interval that starts at each keyframe; at the last,
        where none starts, nothing. Shape (n, 6, 21).
        """
        span = np.diff(self.t)[:, None]

        def mean(samples: Array) -> Array:
            total = np.vstack([np.zeros(3), np.cumsum(samples * self.data.durations[:, None], axis=0)])
            return np.asarray(np.diff(total[self.edges], axis=0) / span)

        terms = response_terms(mean(self.data.accel), mean(self.data.gyro) - self.path.bias(self.t[:-1]))
        return np.concatenate([terms, np.zeros((1, *terms.shape[1:]))])

    def _bias_walk(self) -> Family:
        noise = self.recording.description.imu.noise
        density = np.repeat([noise.accel_bias_walk, noise.gyro_bias_walk], 3)
        sigma = np.sqrt(np.diff(self.t))[:, None] * density
        return bias_walk(np.arange(len(self.t) - 1), np.diff(self.response, axis=0), sigma)

    def families(self, states: States, speedless: bool) -> tuple[Family, ...]:
        families = [*self._priors(states), self._bias_walk(), *self._odometer()]
        if speedless:
            families.append(self._tilt())
        else:
            families += self._motion()
        families += self._positions()
        return tuple(f for f in families if len(f))

    def _priors(self, states: States) -> list[Family]:
        noise, config = self.recording.description.imu.noise, self.config
        first = np.array([0])
        georeferenced = self.recording.gnss is not None
        # Without GNSS the start defines the frame: its position and yaw are known by convention.
        yaw_sd, position_sd = (3.0, 1e4) if georeferenced else (1e-6, 1e-4)
        nav_sd = np.array([[0.2, 0.2, yaw_sd, *[position_sd] * 3, 10.0, 10.0, 10.0]])
        bias_sd = np.array([[noise.accel_bias_sd] * 3 + [noise.gyro_bias_sd] * 3])
        tach = self.recording.description.tach
        scale_sd = 1e-2 if tach is None else tach.scale_sd
        start_sd = 1e5 if self.recording.fixes is not None and len(self.recording.fixes) else 1e-4
        odo_sd = np.array([[start_sd, scale_sd, 1.0, 1e-3]])
        tach_clock = config.tach
        clock_sd = np.array(
            [[tach_clock.clock_offset_sd_s, tach_clock.clock_drift_sd, config.position.gnss_clock_offset_sd_s]]
        )
        imu = config.imu
        imu_sd = response_sigmas(imu.scale_sd, imu.misalignment_sd_rad, imu.g_sensitivity_sd)[None]
        mount_sd = np.full((1, 2), np.radians(config.motion.mount_sd_deg))
        return [
            nav_prior(first, states.nav[:1], nav_sd),
            prior(Kind.BIAS, first, np.zeros((1, 6)), bias_sd),
            prior(Kind.ODO, first, states.odo[:1] * [1.0, 1.0, 1.0, 0.0], odo_sd),
            prior(Kind.MOUNT, first, np.zeros((1, 2)), mount_sd),
            prior(Kind.CLOCK, first, np.zeros((1, 3)), clock_sd),
            prior(Kind.IMU, first, np.zeros((1, Kind.IMU.dim)), imu_sd),
        ]

    def _odometer(self) -> list[Family]:
        config, k = self.config.tach, np.arange(len(self.t) - 1)
        distance = np.abs(self._distance)
        chain_sd = np.stack(
            [np.full(k.size, _DISTANCE_SD_M), config.scale_walk_per_sqrt_m * np.sqrt(distance + 0.01)], 1
        )
        families = [
            distance_chain(k, chain_sd),
            arc_length(k, self.lever_arm, (_ARC_SD_M + _ARC_SD_RELATIVE * distance)[:, None]),
        ]
        if self.wheel is None:
            return [*families, tach_distance(k, np.full((k.size, 1), _MOVED_SD_M), None)]
        variance = config.creep_m_per_sqrt_m**2 * (distance + 0.01)
        if self.wheel.integrates_speed:
            moving = ~within(0.5 * (self.t[1:] + self.t[:-1]), self.rests)
            variance = variance + config.speed_noise_mps**2 * np.diff(self.t) * moving
        silent = ~(self.wheel.covers(self.t[:-1]) & self.wheel.covers(self.t[1:]))
        if self.wheel.integrates_speed:
            variance = np.where(silent, _MOVED_SD_M**2, variance)
        sigma = np.sqrt(variance)[:, None] * self.config.noise.tach
        families.append(tach_distance(k, sigma, Loss("cauchy", config.robust_width, huber_at_start=True)))
        read = self._readable()
        count, rate = self.wheel.at(self.t[read]), self.wheel.rate(self.t[read])
        since = self.t[read] - 0.5 * (self.t[0] + self.t[-1])
        families.append(tach_reading(read, count, rate, since, np.full((read.size, 1), self.wheel.rounding_sd)))
        return families

    def _readable(self) -> np.ndarray:
        """Keyframes with a tach reading of their own: a count that has not moved since the last reading says nothing
        new, its rounding error is the same one."""
        assert self.wheel is not None
        covered = np.flatnonzero(self.wheel.covers(self.t))
        count = self.wheel.at(self.t[covered])
        if covered.size == 0:
            return covered
        grid = np.floor(count / max(self.wheel.quantum, 1e-9))
        fresh = np.concatenate([[True], grid[1:] != grid[:-1]])
        readable: np.ndarray = covered[fresh]
        return readable

    def _motion(self) -> list[Family]:
        config, n = self.config.motion, len(self.t)
        k = np.arange(n)
        resting = within(self.t, self.rests)
        speed = np.abs(np.interp(self.t, self.path.t, self.path.speed))
        sigma = np.array([config.lateral_sd_mps, config.vertical_sd_mps]) + config.sd_per_speed * speed[:, None]
        sigma = sigma * self.config.noise.motion
        huber = Loss("huber", config.robust_width)
        rest = (config.rest_turn_sd_rad, config.rest_shift_sd_m)
        if self.recording.description.imu.rigid:
            rest = (config.rigid_rest_turn_sd_rad, config.rigid_rest_shift_sd_m)
        return [
            self._path(huber),
            non_holonomic(k, self._angular_rate(), self.lever_arm, sigma, huber),
            at_rest(np.flatnonzero(resting), config.rest_speed_sd_mps, huber),
            stays(np.flatnonzero(self._still), *rest, huber),
        ]

    def _path(self, loss: Loss) -> Family:
        """For a sensor that follows the track, wherever it is not at rest and its record has no hole."""
        config, distance = self.config.motion, np.abs(self._distance)
        bridged = np.concatenate([[0], np.cumsum(self.data.bridged)])
        whole = np.diff(bridged[self.edges]) == 0
        k = np.flatnonzero(whole & ~self._still & self.recording.description.imu.rigid)
        turned = turning(self.data, self.edges, self.path.bias(self.t).mean(axis=0), self._distance_at(self.data.edges))
        bridge = self.noise.gyro * distance * np.sqrt(np.diff(self.t) / 12.0)
        model = (config.path_sd_m + config.path_sd_relative * distance) * self.config.noise.path
        sigma = np.hypot(model, bridge)[k, None].repeat(2, axis=1)
        return follows_path(k, turned.turn[k], turned.mean[k], turned.mean_by_time[k], self.lever_arm, sigma, loss)

    def _angular_rate(self) -> Array:
        """Body rate at the keyframes: the gyro's mean around them, less the initial bias."""
        return means_around(self.t, _RATE_WINDOW_S, self.data.edges, self.data.gyro) - self.path.bias(self.t)

    def _tilt(self) -> Family:
        """Mean specific force around each keyframe, each sample in one mean."""
        middle = np.concatenate([[self.edges[0]], (self.edges[1:] + self.edges[:-1]) // 2, [self.edges[-1]]])
        dt = self.data.durations[:, None]
        integral = np.vstack([np.zeros(3), np.cumsum(self.data.accel * dt, axis=0)])
        duration = np.diff(self.data.edges[middle])[:, None]
        force = np.diff(integral[middle], axis=0) / duration
        noise = self.recording.description.imu.noise.accel_white
        sigma = np.sqrt(noise**2 / duration + 2.0 * _UNKNOWN_ACCELERATION**2 * 10.0 / duration)
        return gravity_tilt(np.arange(len(self.t)), force, self.world.gravity, np.repeat(sigma, 3, axis=1))

    def _positions(self) -> list[Family]:
        config, description = self.config.position, self.recording.description
        families = []
        fixes, gnss = self.recording.fixes, self.recording.gnss
        if fixes is not None:
            families.append(self._fixes(Loss("cauchy", config.fix_width) if config.robust else None))
        if gnss is not None and len(gnss) and description.gnss is not None:
            loss = Loss("huber", config.gnss_width) if config.robust else None
            families.append(self._gnss(gnss, description.gnss, loss))
        return families

    def _gnss(self, gnss: pd.DataFrame, description: Gnss, loss: Loss | None) -> Family:
        config = self.config
        t = gnss["t_s"].to_numpy()
        inside = (t >= self.data.edges[0]) & (t <= self.data.edges[-1])
        t, table = t[inside], gnss[inside]
        index = nearest(self.t, t)
        lever = np.array(description.lever_arm_m) - self.lever_arm
        # n readings of an error with correlation time tau tell as much as n dt / (2 tau) independent ones.
        interval = float(np.median(np.diff(t))) if t.size > 1 else np.inf
        inflation = np.sqrt(max(1.0, 2.0 * config.position.gnss_correlation_s / interval))
        sigma = table[["east_sd_m", "north_sd_m", "up_sd_m"]].to_numpy() * (config.noise.gnss * inflation)
        position = table[["east_m", "north_m", "up_m"]].to_numpy()
        return gnss_position(index, position, lever, t - self.t[index], sigma, loss)

    def _fixes(self, loss: Loss | None) -> Family:
        fixes = self.recording.fixes
        assert fixes is not None
        t = fixes["t_s"].to_numpy()
        inside = (t >= self.data.edges[0]) & (t <= self.data.edges[-1])
        t, table = t[inside], fixes[inside]
        index = nearest(self.t, t)
        carried = np.interp(t, self.path.t, self.path.speed) * (t - self.t[index])
        distance = self.recording.description.track.direction * table["chainage_m"].to_numpy() - carried
        return absolute_fix(index, distance, table[["chainage_sd_m"]].to_numpy(), loss)


def increment_starts(
    data: Intervals, edges: np.ndarray, duration: float, times: Array | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Split each keyframe interval into increments of at most ``duration`` s (but at least a sample each), with
    boundaries on both sides of each of ``times``.

    Returns the increments' starts as indices into ``data.edges``, with the last end appended, and for each keyframe the
    position of its first increment in that list.
    """
    group = max(1, int(duration / float(np.median(data.durations)) + 1e-6))
    counts = -(-np.diff(edges) // group)
    offset = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    starts = np.append(np.repeat(edges[:-1], counts) + group * offset, edges[-1])
    if times is not None:
        before = np.clip(np.searchsorted(data.edges, times + 1e-9, side="right") - 1, 0, len(data))
        after = np.minimum(before + 1, len(data))
        starts = np.unique(np.concatenate([starts, before, after[data.edges[before] < times - 1e-9]]))
    return starts, np.searchsorted(starts, edges)
