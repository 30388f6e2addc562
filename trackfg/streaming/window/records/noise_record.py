"""A stream learns from residuals how noisy its inertial sensor, the vehicle's motion and the wheel are.

After each relinearisation pass the batch's rule (:mod:`trackfg.smoothing.noise_levels`) makes levels of the residuals
in the window and of those that were marginalised before. A level says by what the declared sigmas are too small: those
of gyro and accelerometer nearby in time, those of other groups usually. Where levels change, the window is solved
again; factors to come have sigmas of the newest levels. What was marginalised before stays as it was. Residuals of
long ago are forgotten, since speed, track and weather change.

At rest all that the inertial sensor shows is noise: as in the batch, means over half a second show there what is below
the keyframe rate (:mod:`trackfg.sensors.imu_noise.noise_at_rest`). All intervals have at least that noise, from the
pass on that finds the rest. Where it is less than declared, later intervals have that noise.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family, changed
from trackfg.factors.imu import Preintegration
from trackfg.numerics.arrays import Array
from trackfg.results.events import Event, doubt_event
from trackfg.sensors.imu_noise.noise_at_rest import NoiseAtRest, RestNoise
from trackfg.sensors.imu_noise.noise_floor import NoiseFloor
from trackfg.smoothing.doubts.path_doubts import ON_SPRINGS, off_its_heading
from trackfg.smoothing.leaning_body import HINT, OF_TRACK
from trackfg.smoothing.noise_levels import (
    FAMILIES,
    FAR_OFF,
    RAISED,
    levels_over_time,
    levels_seen,
    raised_level,
    settled,
)
from trackfg.smoothing.reassessment import others_are_worse
from trackfg.solver.variance_components import LEAST_REDUNDANCY, Residuals
from trackfg.streaming.rows import SAME_S
from trackfg.streaming.window.sample_buffer import SampleBuffer
from trackfg.streaming.window.window import Interval, Window

_INERTIAL = ("gyro", "accel")
"""Groups with a level for each interval."""

_OTHERS = tuple(FAMILIES.values())
"""Groups with one level."""

_TACH = _OTHERS.index(FAMILIES[FactorType.TACH_DISTANCE])
"""The wheel's place among these."""

_GROUPS = (*_INERTIAL, *_OTHERS)
"""All groups, in the order of their sums."""

_REMEMBERED_S = 600.0
"""Sums of squares fall to 1/e over so long, s: as long as GNSS positions are remembered."""

_MOST = 1000
"""Intervals whose levels are remembered: geometry reaches back over some tens that were marginalised."""

_LEAST_REST_S = 2.0
"""New seconds of a rest below which it is left to the next pass: the median of four means at least."""

_MOST_MEANS = 600
"""Means at rest that are remembered: five minutes of them."""


@dataclass
class NoiseRecord:
    """The record holds levels, all in declared sigmas.

    ``t`` (m,): when the newest intervals began, s; ``inertial`` (m, 2): their levels of gyro and accelerometer,
    ``newest`` (2,) those of intervals to come; ``others`` (groups,): those of motion, path and wheel.

    Of the intervals that were marginalised, ``sums`` (2 + groups, 2) holds the squares of the residuals and their
    redundancy, without those of inertial sensors that have a level of their own, and ``all_sums`` (2, 2) of inertial
    sensors with these; ``squared_levels`` (2 + groups,) the sum of the squares of their levels, ``count`` how many they
    are.

    ``at_rest``: the means at rest up to ``rests_s``, and ``shown`` what they show of the noise.
    """

    t: Array = field(default_factory=lambda: np.zeros(0))
    inertial: Array = field(default_factory=lambda: np.ones((0, 2)))
    newest: Array = field(default_factory=lambda: np.ones(2))
    others: Array = field(default_factory=lambda: np.ones(len(_OTHERS)))
    sums: Array = field(default_factory=lambda: np.zeros((len(_GROUPS), 2)))
    all_sums: Array = field(default_factory=lambda: np.zeros((len(_INERTIAL), 2)))
    squared_levels: Array = field(default_factory=lambda: np.zeros(len(_GROUPS)))
    count: int = 0
    at_rest: RestNoise = field(default_factory=RestNoise)
    rests_s: float = -np.inf
    shown: NoiseAtRest = field(default_factory=NoiseAtRest)

    def at(self, t: Array) -> Array:
        """Return the levels of gyro and accelerometer of intervals that began at ``t`` (m,), s; shape (m, 2)."""
        levels = np.concatenate([self.inertial, self.newest[None]])
        return np.asarray(levels[np.searchsorted(self.t, t - SAME_S)])

    def look_at_rests(self, buffer: SampleBuffer, rests: Array) -> Array:
        """Learn from what is new of ``rests`` (r, 2), s, and return by what the excess grew, (6,)."""
        new = np.maximum(rests, self.rests_s)
        new = new[new[:, 1] - new[:, 0] >= _LEAST_REST_S]
        if not len(new):
            return np.zeros(6)
        data = buffer.intervals(float(new[0, 0]), float(new[-1, 1]))
        floor = NoiseFloor.of(data)
        self.at_rest = self.at_rest.joined(RestNoise.of(data, floor.knots, floor.seen, new), _MOST_MEANS)
        self.rests_s, previous, self.shown = float(new[-1, 1]), self.shown, self.at_rest.shown()
        return self.shown.excess - previous.excess

    def with_rests(self, window: Window, buffer: SampleBuffer, rests: Array) -> Window:
        """Return the window with the noise that its ``rests`` (r, 2), s, show in all intervals."""
        more = self.look_at_rests(buffer, rests)
        if not more.any():
            return window
        levels = self.at(window.t[:-1])
        measured = (_with_more(interval, more, level) for interval, level in zip(window.measured, levels, strict=True))
        return replace(window, measured=tuple(measured))

    def weigh(self, window: Window, groups: Mapping[str, Residuals], leaving: int) -> Window:
        """Compute the levels anew, and return the window with sigmas of them; itself where they are as they were.

        ``groups``: the residuals of its intervals, of which the first ``leaving`` ones are marginalised next.
        """
        previous = self.at(window.t[:-1])
        inertial, others, marginalised = previous.copy(), self.others.copy(), np.zeros_like(self.sums)
        all_marginalised = np.zeros_like(self.all_sums)
        for i, name in enumerate(_GROUPS):
            if name not in groups:
                continue
            group, k = groups[name], i - len(_INERTIAL)
            first = group.keyframe < leaving
            if name in _INERTIAL:
                level = previous[group.keyframe, i]
                estimate, usual = levels_over_time(group, level, self.sums[i], self.all_sums[i])
                inertial[group.keyframe, i] = settled(level, estimate)
                each = _per_factor(group, level)
                marginalised[i] = each[:, usual & first].sum(axis=1)
                all_marginalised[i] = each[:, first].sum(axis=1)
            else:
                each = _per_factor(group, self.others[k])
                squares, redundancy = self.sums[i] + each.sum(axis=1)
                estimate = levels_seen(squares, redundancy) if redundancy > LEAST_REDUNDANCY else np.ones(())
                others[k] = settled(self.others[k], estimate)
                marginalised[i] = each[:, first].sum(axis=1)
        factors = inertial / previous, others / self.others
        self._take(window.t, inertial, others, leaving)
        kept = np.exp((window.t[0] - window.t[leaving]) / _REMEMBERED_S)
        self.sums, self.all_sums = self.sums * kept + marginalised, self.all_sums * kept + all_marginalised
        return _scaled_window(window, *factors)

    def is_worse_than_gnss(self, ratios: Mapping[str, float], group: str, gnss_level: float) -> bool:
        """Return whether another group is further beyond its sigmas than GNSS, beyond the assumed or the declared ones.

        ``ratios``: actual over assumed noise by group, ``group`` that of the positions or of the receiver's speeds;
        ``gnss_level``: assumed over declared sigmas of these.
        """
        gnss = ratios.get(group, 1.0)
        declared = max(level * ratios.get(name, 1.0) for name, level in self._rms_levels().items())
        return others_are_worse(ratios, gnss) or declared > max(FAR_OFF, gnss * gnss_level)

    @property
    def has_risen(self) -> bool:
        """Return whether residuals have shown a group to be noisier than declared, rms over the stream."""
        return any(level > RAISED for level in self._rms_levels().values())

    @property
    def far_off(self) -> np.ndarray:
        """Return whether residuals of accelerometer and gyro are far above the noise of their samples, (2,)."""
        levels = self._rms_levels()
        return np.array([levels["accel"] > FAR_OFF, levels["gyro"] > FAR_OFF])

    def weigh_next(self, interval: Interval, *, bridged: bool) -> Interval:
        """Return the next interval, by the inertial sensor alone, with sigmas of the newest levels."""
        measured = interval.measured if bridged else _scaled(interval.measured, self.newest)
        return interval._replace(measured=measured, families=_scaled_families(interval.families, self.others))

    def weigh_wheel(self, families: Iterable[Family]) -> tuple[Family, ...]:
        """Return the families of the next interval with the sigma of the wheel's rolling at its level."""
        level = self.others[_TACH]
        if level == 1.0:
            return tuple(families)
        return changed(families, FactorType.TACH_DISTANCE, lambda tach: tach.with_sigma(tach.sigma * level))

    def events(self, until_s: float) -> tuple[Event, ...]:
        """Return an event for each group far above its declared level, rms over the stream, known at its end."""
        return tuple(
            Event("noise-raised", t_s=until_s, detail=raised_level(name, level))
            for name, level in self._rms_levels().items()
            if level > FAR_OFF
        )

    def track_doubts(self, until_s: float) -> tuple[Event, ...]:
        """Return an event where a sensor that is declared rigid does not move as the track does, known at ``until_s``.

        Its samples show the noise of an inertial sensor. What residuals show beyond it is motion.
        """
        levels, reasons = self._rms_levels(), []
        if self.far_off[0]:
            reasons.append(
                f"residuals of the accelerometer are {levels['accel']:.1f} times its noise: the sensor does not move "
                "as the track does, or its axes or stamps are wrong"
            )
        if levels["path"] >= ON_SPRINGS:
            reasons.append(off_its_heading(levels["path"]))
        return tuple(doubt_event(OF_TRACK, reason, HINT, t_s=until_s) for reason in reasons)

    def _rms_levels(self) -> dict[str, float]:
        """Return the level of each group, rms over the intervals that were marginalised."""
        return dict(zip(_GROUPS, np.sqrt(self.squared_levels / max(self.count, 1)).tolist(), strict=True))

    def _take(self, t: Array, inertial: Array, others: Array, leaving: int) -> None:
        """Take the levels of a window whose keyframes are at ``t`` (n,), s."""
        first = int(np.searchsorted(self.t, t[0] - SAME_S))
        self.t = np.concatenate([self.t[:first], t[:-1]])[-_MOST:]
        self.inertial = np.concatenate([self.inertial[:first], inertial])[-_MOST:]
        self.newest, self.others = inertial[-1], others
        squares = np.concatenate([np.sum(inertial[:leaving] ** 2, axis=0), leaving * others**2])
        self.squared_levels, self.count = self.squared_levels + squares, self.count + leaving


def _per_factor(group: Residuals, level: Array | float) -> Array:
    """Return squares in declared sigmas and redundancy of each factor, (2, m), at their ``level`` (m,)."""
    return np.stack([np.vecdot(group.values, group.values) * level**2, group.redundancy.sum(axis=1)])


def _scaled_window(window: Window, inertial: Array, others: Array) -> Window:
    """Return the window with sigmas so many times as large: of its intervals (n - 1, 2), and of families (groups,)."""
    if (inertial == 1.0).all() and (others == 1.0).all():
        return window
    measured = tuple(_scaled(interval, factor) for interval, factor in zip(window.measured, inertial, strict=True))
    return replace(window, measured=measured, families=_scaled_families(window.families, others))


def _scaled(measured: Preintegration, factor: Array) -> Preintegration:
    gyro, accel = factor.tolist()
    return measured if gyro == accel == 1.0 else replace(measured, noise=measured.noise.scaled(gyro, accel))


def _with_more(measured: Preintegration, more: Array, level: Array) -> Preintegration:
    """Return the measurement with densities squared higher by ``more`` (6,), at its ``level`` (2,).

    Later rests may show less noise: a density that never had as much as is to be taken off stays as it is.
    """
    noise, densities = measured.noise, []
    for density, factor, part in zip((noise.gyro, noise.accel), level, np.split(more, 2), strict=True):
        squared = density**2 + factor**2 * part
        densities.append(np.sqrt(np.where(squared > 0.0, squared, density**2)))
    gyro, accel = densities
    return replace(measured, noise=replace(noise, gyro=gyro, accel=accel))


def _scaled_families(families: Iterable[Family], factor: Array) -> tuple[Family, ...]:
    level = {name: ratio for name, ratio in zip(_OTHERS, factor.tolist(), strict=True) if ratio != 1.0}
    return tuple(
        family.with_sigma(family.sigma * level[group]) if (group := FAMILIES.get(family.type)) in level else family
        for family in families
    )
