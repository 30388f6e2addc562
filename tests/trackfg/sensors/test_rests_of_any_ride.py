"""Rests are found, and nothing else is one, whatever the grade, the rates, the lengths, the idling, the speed's noise.

The rides are made here, not by the simulator: a body on a line with gradients, shaken by an engine at 20-35 Hz and by
broadband vibration.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trackfg.recording.description import Imu, RecordingDescription, Tach
from trackfg.recording.model import IMU_COLUMNS, Recording
from trackfg.sensors.standstills import find_standstills

G = 9.80665
CRUISE_S = 20.0


@dataclass(frozen=True)
class Ride:
    """Rests of ``rest_s``, s, with movements of 20 s at ``speed`` in between, reached with ``acceleration``."""

    rest_s: tuple[float, ...] = (8.0, 3.0, 4.0)
    speed: float = 8.0
    acceleration: float = 0.7
    gradient: float = 0.0
    rate_hz: float = 120.0
    idle: float = 0.0
    riding: float = 0.3
    gyro_bias: float = 0.01
    tach_hz: float = 50.0
    tach_noise: float = 0.0
    signed: bool = False
    quantum: float = 0.0
    seed: int = 0

    def made(self) -> tuple[Recording, np.ndarray, np.ndarray]:
        """Return the recording, its rests (m, 2), s, and the speed (n,) at its samples."""
        rng = np.random.default_rng(self.seed)
        rise = np.pi * self.speed / (2.0 * self.acceleration)
        edges = [0.0]
        for rest in self.rest_s:
            edges += [edges[-1] + rest, edges[-1] + rest + 2.0 * rise + CRUISE_S]
        rests = np.array(edges[:-1]).reshape(-1, 2)
        t = np.arange(0.5 / self.rate_hz, rests[-1, 1], 1.0 / self.rate_hz)
        speed = self._speed(t, rests, rise)
        turning = 0.1 * np.sin(0.4 * t) * speed / self.speed
        force = np.stack([np.gradient(speed, t) + G * self.gradient, speed * turning, np.full(len(t), G)], axis=1)
        rate = np.stack([np.zeros(len(t)), 0.002 * speed * np.sin(t), turning], axis=1)
        moving = self.riding * (speed / self.speed)[:, None]
        phase = 2.0 * np.pi * np.cumsum(rng.uniform(20.0, 35.0) + rng.normal(0.0, 1.0, len(t))) / self.rate_hz
        engine = np.sin(phase[:, None] + rng.uniform(0.0, 6.0, 6)) * np.sqrt(2.0)
        shaken = 0.8 * engine + 0.6 * rng.normal(size=(len(t), 6))
        shaking = self.idle * shaken + moving * rng.normal(size=(len(t), 6)) + 0.02 * rng.normal(size=(len(t), 6))
        gyro = rate + self.gyro_bias + 0.03 * shaking[:, :3]
        imu = pd.DataFrame(np.column_stack([t, gyro, force + shaking[:, 3:]]), columns=list(IMU_COLUMNS))
        return Recording(self._description(), imu, self._tach(rests, rise, rng)), rests, speed

    @property
    def unseen_mps(self) -> float:
        """A speed that the noise of the tach hides, m/s."""
        return 0.1 + 2.5 * self.tach_noise

    @property
    def unseen_s(self) -> float:
        """How long a movement stays below that speed when it begins and before it ends, s."""
        rise = np.pi * self.speed / (2.0 * self.acceleration)
        return float(np.arccos(1.0 - 2.0 * self.unseen_mps / self.speed)) / np.pi * rise

    def _speed(self, t: np.ndarray, rests: np.ndarray, rise: float) -> np.ndarray:
        up = np.clip((t[:, None] - rests[:-1, 1]) / rise, 0.0, 1.0)
        down = np.clip((rests[1:, 0] - t[:, None]) / rise, 0.0, 1.0)
        ramp = 0.5 * (1.0 - np.cos(np.pi * np.minimum(up, down)))
        return np.asarray(self.speed * ramp.sum(axis=1))

    def _tach(self, rests: np.ndarray, rise: float, rng: np.random.Generator) -> pd.DataFrame:
        t = np.arange(0.0, rests[-1, 1], 1.0 / self.tach_hz)
        speed = self._speed(t, rests, rise)
        if self.quantum == 0.0:
            speed = speed + rng.normal(0.0, self.tach_noise, len(t))
            speed = speed if self.signed else np.abs(speed)
        distance = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1])) / self.tach_hz])
        if self.quantum:
            distance = np.floor(distance / self.quantum + 0.3) * self.quantum
        return pd.DataFrame({"t_s": t, "distance_m": distance})

    def _description(self) -> RecordingDescription:
        imu = Imu(file="imu.csv", gyro=("wx", "wy", "wz"), accel=("fx", "fy", "fz"), rigid=False)
        kind, unit = ("distance", "m") if self.quantum else ("speed", "m/s")
        tach = Tach.model_validate({"file": "t.csv", "column": "x", "kind": kind, "unit": unit, "signed": self.signed})
        return RecordingDescription(id="made", imu=imu, tach=tach)


def overlap(spans: np.ndarray, start: float, end: float) -> float:
    return float(np.clip(np.minimum(spans[:, 1], end) - np.maximum(spans[:, 0], start), 0.0, None).sum())


def found_shares(ride: Ride) -> list[float]:
    """Return the share of each rest that is found, having held that the vehicle hardly moves in what is found."""
    recording, rests, speed = ride.made()
    found = find_standstills(recording)
    t = recording.imu["t_s"].to_numpy()
    for start, end in found:
        assert speed[(t >= start) & (t <= end)].max() < ride.unseen_mps
        assert overlap(rests, start, end) > end - start - 2.0 * ride.unseen_s
    return [overlap(found, start, end) / (end - start) for start, end in rests]


RIDES = st.builds(
    Ride,
    rest_s=st.tuples(*[st.floats(2.0, 12.0)] * 3),
    speed=st.floats(3.0, 15.0),
    acceleration=st.floats(0.4, 1.2),
    gradient=st.floats(-0.04, 0.04),
    rate_hz=st.sampled_from([100.0, 120.0, 200.0]),
    idle=st.sampled_from([0.0, 0.3, 1.0, 2.0]),
    riding=st.floats(0.05, 1.0),
    gyro_bias=st.floats(-0.035, 0.035),
    tach_hz=st.sampled_from([20.0, 50.0, 100.0]),
    tach_noise=st.sampled_from([0.0, 0.02, 0.05]),
    signed=st.booleans(),
    quantum=st.sampled_from([0.0, 0.003, 0.02]),
    seed=st.integers(0, 1000),
)


@settings(max_examples=40, deadline=None)
@given(ride=RIDES)
def test_nothing_but_rests_is_found(ride: Ride) -> None:
    found_shares(ride)


@pytest.mark.parametrize("idle", [0.0, 2.0])
@pytest.mark.parametrize(("tach_noise", "quantum"), [(0.0, 0.0), (0.02, 0.0), (0.05, 0.0), (0.0, 0.003), (0.0, 0.02)])
def test_half_of_nearly_every_rest_is_found(idle: float, tach_noise: float, quantum: float) -> None:
    """Noise can hide a rest, but it hides fewer than 1 in 20 of the shortest."""
    rng = np.random.default_rng(0)
    shares: list[float] = []
    for seed in range(8):
        shares += found_shares(
            Ride(
                rest_s=tuple(rng.uniform(2.0, 4.0, 3)),
                speed=rng.uniform(3.0, 15.0),
                acceleration=rng.uniform(0.4, 1.2),
                gradient=rng.uniform(-0.04, 0.04),
                riding=rng.uniform(0.05, 1.0),
                tach_hz=(20.0, 50.0, 100.0)[seed % 3],
                signed=bool(seed % 2),
                idle=idle,
                tach_noise=tach_noise,
                quantum=quantum,
                seed=seed,
            )
        )
    assert np.mean(np.array(shares) > 0.5) > 0.95


@pytest.mark.parametrize("idle", [0.0, 1.0, 2.0])
@pytest.mark.parametrize("quantum", [0.0, 0.01])
def test_a_rest_of_a_second_and_a_half_is_found(idle: float, quantum: float) -> None:
    ride = Ride(rest_s=(1.5, 1.5, 1.5), idle=idle, quantum=quantum, tach_noise=0.02, tach_hz=100.0)
    assert min(found_shares(ride)) > 0.5


@pytest.mark.parametrize("rest_s", [(0.0, 5.0, 0.0), (0.0, 0.0)])
def test_a_ride_may_begin_and_end_in_motion(rest_s: tuple[float, ...]) -> None:
    recording, rests, speed = Ride(rest_s=rest_s, tach_noise=0.05, idle=1.0).made()
    t = recording.imu["t_s"].to_numpy()
    cut = speed > 4.0
    began, ended = t[cut][0], t[cut][-1]
    tach = recording.tach
    assert tach is not None
    middle = Recording(
        recording.description, recording.imu[cut | ((t > began) & (t < ended))], tach[tach["t_s"].between(began, ended)]
    )
    found = find_standstills(middle)
    assert len(found) == len(rests) - 2


@pytest.mark.parametrize("speed", [3.0, 8.0, 15.0])
@pytest.mark.parametrize("idle", [0.0, 1.0])
def test_a_tach_that_falls_silent_in_motion_is_no_rest(speed: float, idle: float) -> None:
    recording, rests, _ = Ride(speed=speed, idle=idle, quantum=0.01).made()
    tach = recording.tach
    assert tach is not None
    begin = rests[0, 1] + np.pi * speed / 1.4 + 2.0
    distance = tach["distance_m"].to_numpy()
    silent = tach["t_s"].between(begin, begin + 15.0).to_numpy()
    lost = distance[silent][-1] - distance[silent][0]
    held = np.where(silent, distance[silent][0], distance - np.where(tach["t_s"] > begin, lost, 0.0))
    found = find_standstills(Recording(recording.description, recording.imu, tach.assign(distance_m=held)))
    assert overlap(found, begin, begin + 15.0) == 0.0


@pytest.mark.parametrize("creep", [0.1, 0.3, 0.5])
@pytest.mark.parametrize("quantum", [0.0, 0.01, 3.0])
def test_creeping_along_is_no_rest(creep: float, quantum: float) -> None:
    """As quiet as at rest, and with one pulse per turn of the wheel the tach is silent for up to half a minute."""
    recording, rests, speed = Ride(speed=creep, acceleration=0.1, riding=0.0, quantum=quantum, rest_s=(3.0, 3.0)).made()
    t = recording.imu["t_s"].to_numpy()
    for start, end in find_standstills(recording):
        assert speed[(t >= start) & (t <= end)].mean() < 0.3 * creep, (start, end, rests)


def test_a_count_that_flickers_over_an_edge_is_still() -> None:
    recording, rests, _ = Ride(quantum=0.01).made()
    tach = recording.tach
    assert tach is not None
    t = tach["t_s"].to_numpy()
    flicker = 0.01 * ((t > 2.0) & (t < 6.0) & (np.floor(t / 0.3) % 2 == 0))
    shaky = tach.assign(distance_m=tach["distance_m"] + flicker)
    described = recording.description
    assert described.tach is not None
    found = find_standstills(Recording(described, recording.imu, shaky))
    assert overlap(found, *rests[0]) > 0.9 * (rests[0, 1] - rests[0, 0])


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("acceleration", [0.12, 0.2])
def test_a_slow_start_without_a_tach_is_no_rest(seed: int, acceleration: float) -> None:
    """A goods train pulls away so gently, and for so long, that its force hardly changes from one half second on."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.005, 60.0, 0.01)
    pull = acceleration * np.clip((t - 15.0) / 2.0, 0.0, 1.0)
    speed = np.cumsum(pull) * 0.01
    signals = rng.normal(size=(len(t), 6)) * np.repeat([1e-3, 0.02], 3) * (1.0 + 2.0 * speed[:, None])
    signals[:, 3:] += np.stack([pull, np.zeros(len(t)), np.full(len(t), G)], axis=1)
    imu = pd.DataFrame(np.column_stack([t, signals]), columns=list(IMU_COLUMNS))
    description = RecordingDescription(id="made", imu=Imu(file="i.csv", gyro=("a", "b", "c"), accel=("d", "e", "f")))
    ((start, end),) = find_standstills(Recording(description, imu))
    assert start < 1.0
    assert 12.0 < end < 16.0
