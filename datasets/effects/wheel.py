"""Errors of wheels and their tachometers: resolution, noise, delay, miscounts, creep, a wrong or changing scale."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from trackfg.datasets import tables
from trackfg.datasets.scenario import Effect, Scenario
from trackfg.datasets.vehicle.ride import Ride
from trackfg.numerics.arrays import Array
from trackfg.numerics.units import KMH
from trackfg.recording.canonical import pulse_m
from trackfg.recording.description import Tach
from trackfg.recording.model import Recording


@dataclass(frozen=True)
class CoarsePulses(Effect):
    """A tachometer of ``magnitude`` pulses per revolution."""

    def planned(self, plan: Scenario) -> Scenario:
        """See :class:`~trackfg.datasets.scenario.Effect`."""
        return replace(plan, tach=replace(plan.tach, pulses_per_rev=self.magnitude))


_FINE = 100.0
"""Factor on the pulses of a tachometer that shows a speed."""
_METER_S = 0.2
"""Over what time a speedometer averages, s. Assumed."""


class _ShownSpeed(Effect):
    """A speed on a display, whose steps are the only ones: the count behind it has :data:`_FINE` times the pulses."""

    def planned(self, plan: Scenario) -> Scenario:
        return replace(plan, tach=replace(plan.tach, pulses_per_rev=_FINE * plan.tach.pulses_per_rev))


@dataclass(frozen=True)
class WholeKmh(_ShownSpeed):
    """A speed in whole km/h, ``magnitude`` times a second, as on a vehicle's bus; rounded, or cut off below.

    For the oracle: half a km/h is added to what was cut off.
    """

    cut_off: bool = False

    def recorded(self, recording: Recording, ride: Ride, rng: np.random.Generator) -> Recording:
        """See :class:`~trackfg.datasets.scenario.Effect`."""
        t, speed = _shown_speed(recording, self.magnitude)
        shown = (np.floor if self.cut_off else np.rint)(speed / KMH + 1e-9)
        if self.cut_off and self.for_oracle:
            shown = np.where(shown > 0.0, shown + 0.5, 0.0)
        return _as_speed(recording, t, KMH * shown)


@dataclass(frozen=True)
class NoisySpeed(_ShownSpeed):
    """A speed at 10 Hz with white noise of ``magnitude`` m/s, at rest too."""

    def recorded(self, recording: Recording, ride: Ride, rng: np.random.Generator) -> Recording:
        """See :class:`~trackfg.datasets.scenario.Effect`."""
        t, speed = _shown_speed(recording, 10.0)
        return _as_speed(recording, t, speed + self.magnitude * rng.standard_normal(len(t)))


@dataclass(frozen=True)
class LateTach(Effect):
    """A tachometer whose rows come ``magnitude`` seconds late and are stamped on arrival. For the oracle: no delay."""

    def planned(self, plan: Scenario) -> Scenario:
        """See :class:`~trackfg.datasets.scenario.Effect`."""
        return plan if self.for_oracle else replace(plan, tach=replace(plan.tach, clock_offset_s=-self.magnitude))


@dataclass(frozen=True)
class MiscountedPulses(Effect):
    """A tachometer that misses a share ``magnitude`` of all pulses and counts as many twice. For the oracle: none."""

    def recorded(self, recording: Recording, ride: Ride, rng: np.random.Generator) -> Recording:
        """See :class:`~trackfg.datasets.scenario.Effect`."""
        table, part = _tach(recording)
        quantum = pulse_m(part)
        count = np.rint(table["distance_m"].to_numpy() / quantum).astype(np.int64)
        steps = np.diff(count, prepend=count[:1])
        missed, doubled = (rng.binomial(np.abs(steps), self.magnitude) for _ in range(2))
        counted = count[:1] + np.cumsum(steps + np.sign(steps) * (doubled - missed))
        return recording if self.for_oracle else _rolled(recording, counted * quantum)


CREEP_S = 60.0
"""How long a weak creep lasts, s."""
_AT_SPEED = 0.5
"""At speed means: at this share of the run's highest speed on the average."""
_CREEP_RAMP_S = 5.0
"""Within what time a weak creep comes and goes, s. Assumed."""


@dataclass(frozen=True)
class WeakCreep(Effect):
    """An axle that turns too fast by ``magnitude`` (a share) for :data:`CREEP_S` at speed. For the oracle: none."""

    def recorded(self, recording: Recording, ride: Ride, rng: np.random.Generator) -> Recording:
        """See :class:`~trackfg.datasets.scenario.Effect`."""
        table, _ = _tach(recording)
        t = table["t_s"].to_numpy()
        speed = np.abs(ride.motion.speed(t))
        way = tables.integrated_speed(t, speed)
        starts = np.arange(t[0], max(t[-1] - CREEP_S, t[0] + 1.0), 1.0)
        mean = (np.interp(starts + CREEP_S, t, way) - np.interp(starts, t, way)) / CREEP_S
        start = rng.choice(starts[mean >= min(_AT_SPEED * speed.max(), mean.max())])
        if self.for_oracle:
            return recording
        corners = start + np.array([0.0, _CREEP_RAMP_S, CREEP_S - _CREEP_RAMP_S, CREEP_S])
        creep = self.magnitude * np.interp(t, corners, [0.0, 1.0, 1.0, 0.0])
        added = tables.integrated_speed(t, creep * speed)
        return _rolled(recording, table["distance_m"].to_numpy() + added)


@dataclass(frozen=True)
class ScaleJump(Effect):
    """A wheel whose scale changes by ``magnitude`` (a share) half-way: another wheelset, a new calibration.

    For the oracle: no change.
    """

    def recorded(self, recording: Recording, ride: Ride, rng: np.random.Generator) -> Recording:
        """See :class:`~trackfg.datasets.scenario.Effect`."""
        distance = _tach(recording)[0]["distance_m"].to_numpy()
        half = 0.5 * (distance[0] + distance[-1])
        if self.for_oracle:
            return recording
        return _rolled(recording, distance - self.magnitude * np.maximum(distance - half, 0))


@dataclass(frozen=True)
class WrongWheel(Effect):
    """Distances of ``magnitude`` times the true ones: 3.6 for km/h taken as m/s, a wrong wheel, -1 a wrong sign.

    For the oracle: the true ones.
    """

    def recorded(self, recording: Recording, ride: Ride, rng: np.random.Generator) -> Recording:
        """See :class:`~trackfg.datasets.scenario.Effect`."""
        table, part = _tach(recording)
        if self.for_oracle:
            return recording
        wrong = part.model_copy(update={"kind": "distance", "unit": "m", "signed": part.signed or self.magnitude < 0})
        description = recording.description.model_copy(update={"tach": wrong})
        table = table.assign(distance_m=self.magnitude * table["distance_m"])
        return replace(recording, description=description, tach=table)


@dataclass(frozen=True)
class CurveRolling(Effect):
    """A wheelset that rolls ``magnitude`` metres to the outside of the centre line in curves: conical wheels that the
    flange keeps from the place of pure rolling.
    """

    def planned(self, plan: Scenario) -> Scenario:
        """See :class:`~trackfg.datasets.scenario.Effect`."""
        outward_m = 0.0 if self.for_oracle else self.magnitude
        return replace(plan, tach=replace(plan.tach, outward_offset_m=outward_m))


def _tach(recording: Recording) -> tuple[pd.DataFrame, Tach]:
    """Return the table and its description. Raises ``ValueError`` where there is no tachometer."""
    if recording.tach is None or recording.description.tach is None:
        raise ValueError("the scenario has no tachometer: expected one for an effect on it")
    return recording.tach, recording.description.tach


def _rolled(recording: Recording, distance_m: Array) -> Recording:
    """Return the recording whose tachometer has these distances, in whole pulses where it counts."""
    table, part = _tach(recording)
    if part.kind == "pulses":
        quantum = pulse_m(part)
        # Where between two pulses the wheel was is not known; on the average it was in the middle.
        distance_m = np.floor(distance_m / quantum + 0.5) * quantum
    return replace(recording, tach=table.assign(distance_m=distance_m))


def _shown_speed(recording: Recording, rate_hz: float) -> tuple[Array, Array]:
    """Return times (n,) and the speed over the last :data:`_METER_S`, m/s, with the sign of the distance."""
    table, _ = _tach(recording)
    clock, distance = table["t_s"].to_numpy(), table["distance_m"].to_numpy()
    t = np.arange(clock[0], clock[-1], 1.0 / rate_hz)
    way = np.interp(t, clock, distance) - np.interp(t - _METER_S, clock, distance)
    return t, way / _METER_S


def _as_speed(recording: Recording, t: Array, speed_mps: Array) -> Recording:
    """Return the recording whose tachometer measures this speed, m/s, at these times, s."""
    _, part = _tach(recording)
    shown = Tach(
        file=part.file, column="speed_mps", kind="speed", unit="m/s", scale_sd=part.scale_sd, signed=part.signed
    )
    table = tables.tach_table(t, tables.integrated_speed(t, speed_mps))
    return replace(recording, description=recording.description.model_copy(update={"tach": shown}), tach=table)
