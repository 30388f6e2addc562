"""Samples of the errors of profiles, drawn from the joint posterior of the run.

The keyframes' errors as they belong together come from :func:`trackfg.solver.covariance.posterior_samples`; between
keyframes the white noise of the inertial samples is added, pinned at both ends. An operator applied to the samples has
its sigma as their spread, whatever its extent.

The error of a point is linear in what is drawn: a sum of a few rows of samples, those of the keyframes on either side
and of the noise in between, each times a weight.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from trackfg.factors.motion import TRACKING_POINT
from trackfg.factors.states import Kind, States, offset_in_keyframe
from trackfg.graph.run_context import RunContext
from trackfg.numerics.arrays import Array
from trackfg.numerics.hermite import hermite_weights
from trackfg.numerics.rotations import cross
from trackfg.numerics.sums_of_rows import add_up_rows, add_weighted_rows
from trackfg.solver.covariance import Normals

_BEAM_MODES = np.array([4.730040744862704, 7.853204624095838, 10.995607838001671])

_NAV = offset_in_keyframe(Kind.NAV)

_TURNED = 1000
"""Keyframes whose samples are turned into n at a time."""


@dataclass(frozen=True)
class Points:
    """Places along the track, each passed at ``fraction`` (m,) of the interval after ``keyframe`` (m,).

    ``left`` (m, 3): horizontal unit vector to the left of the path, facing increasing chainage; ``axle`` (m, 3): the
    vehicle's left axis, likewise facing; ``arm`` (m, 3): from the point to the IMU, m. All in n. ``body`` (m, 3, 3):
    the body axes in n, of points whose place in the vehicle is that of the point that follows the track; none of those
    that sensors see.
    """

    keyframe: np.ndarray
    fraction: Array
    left: Array
    axle: Array
    arm: Array
    body: Array | None = None

    def __getitem__(self, rows: slice) -> Points:
        body = None if self.body is None else self.body[rows]
        return Points(self.keyframe[rows], self.fraction[rows], self.left[rows], self.axle[rows], self.arm[rows], body)


class PlaceErrors(NamedTuple):
    """Errors of places, each (count, m), m. ``turn``: what of the lateral ones changes from a point to the next because
    the way between is longer or shorter than it seems, which bends a curve less or more.
    """

    height: Array
    lateral: Array
    turn: Array


class AngleErrors(NamedTuple):
    """Errors of angles, each (count, m): ``heading``, rad, and ``tilt``, of the sine of roll."""

    heading: Array
    tilt: Array


@dataclass(frozen=True)
class PosteriorErrors:
    """Samples of the keyframes' tangents (n, KEYFRAME_DIM, count), of which those of attitude, position and velocity
    are turned into n, and of the ``point`` that follows the track, in body axes (3, count).

    The noise in between has normal draws for the beam's modes (n - 1, 2, modes, count) and where the bridges are drawn
    from.
    """

    of_keyframes: Array
    point: Array
    beam: Array
    rng: Normals

    @classmethod
    def of(cls, states: States, drawn: tuple[Array, Array], rng: Normals) -> PosteriorErrors:
        """Turn samples of the tangents of keyframes (n, KEYFRAME_DIM, count) and of shared variables (s, count), as
        ``drawn`` together, into errors in n. The samples are written over: no array of a run is larger.
        """
        samples, shared = drawn
        n, _, count = samples.shape
        for begin in range(0, n, _TURNED):
            some = slice(begin, begin + _TURNED)
            for vector in (slice(k, k + 3) for k in range(_NAV, _NAV + 9, 3)):
                samples[some, vector] = states.nav.R[some] @ samples[some, vector]
        return cls(samples, shared[TRACKING_POINT], rng.standard_normal((n - 1, 2, len(_BEAM_MODES), count)), rng)

    @property
    def count(self) -> int:
        """The number of samples."""
        return int(self.of_keyframes.shape[-1])


class Shifts(NamedTuple):
    """Errors of places in three directions: ``up``, and to the ``left`` and ``ahead`` of the path, each (m, count), m.

    ``shaken`` is what the accelerometer's noise between keyframes adds to the left.
    """

    up: Array
    left: Array
    ahead: Array
    shaken: Array

    @classmethod
    def none(cls, places: int, count: int) -> Shifts:
        """Return no errors of so many places, which others may be added to."""
        return cls(*np.zeros((4, places, count)))

    def along(self, left: Array) -> PlaceErrors:
        """Return the errors as those of a path, of which ``left`` (m, 3) is the horizontal direction to its left.

        The heading of a path errs by ``d(across)/dx + curvature * ahead``: a path that is turned as a whole stays the
        same.
        """
        across, ahead = self.left, self.ahead
        turn = np.diff(np.unwrap(np.arctan2(-left[:, 0], left[:, 1])))[:, None]
        # A curve seems to bend less by as much as its length seems longer.
        longer = np.zeros_like(ahead)
        np.subtract(ahead[1:], ahead[:-1], out=longer[1:])
        longer[1:] -= 0.5 * turn * (across[1:] + across[:-1])
        longer[1:] *= -turn
        turned_less = add_up_rows(longer)
        bent = np.zeros_like(ahead)
        np.add(ahead[1:], ahead[:-1], out=bent[1:])
        bent[1:] *= turn
        bent[1:] += turned_less[1:] + turned_less[:-1]
        bent *= 0.5
        lateral = add_up_rows(bent)
        lateral += across
        lateral += self.shaken
        return PlaceErrors(*(np.ascontiguousarray(errors.T) for errors in (self.up, lateral, turned_less)))


class PointErrors:
    """Errors of points in order of chainage are drawn one after the other, from the keyframes' errors.

    Position is carried between keyframes by the cubic of its end values and slopes, attitude linearly. In between, the
    accelerometer's white noise N adds ``N T^1.5 sum phi_i(f) / beta_i^2 xi_i``, phi_i the modes of a clamped beam (the
    doubly integrated noise, pinned in value and slope: three modes hold 98 % of it), and the gyro's a Brownian bridge.
    """

    def __init__(self, run: RunContext, points: Points, errors: PosteriorErrors) -> None:
        self._run, self._points, self._errors = run, points, errors
        self._bridges = _Bridges(run.t, points.keyframe, points.fraction)
        k, self._fraction = points.keyframe[:, None], points.fraction[:, None]
        self._span = np.diff(run.t)[k]
        # Attitude, position and velocity of the keyframe before, and of the one after.
        width = errors.of_keyframes.shape[1]
        nav = _NAV + np.concatenate([np.arange(9), width + np.arange(9)])
        self._of_keyframes = errors.of_keyframes.reshape(-1, errors.count), width * k + nav
        self._up = np.broadcast_to([0.0, 0.0, 1.0], points.left.shape)

    def places(self) -> PlaceErrors:
        """Draw the errors of the points."""
        shifts = Shifts.none(len(self._points.keyframe), self._errors.count)
        self.add_to(shifts, self._points.arm)
        return shifts.along(self._points.left)

    def add_to(self, shifts: Shifts, arm: Array, share: float = 1.0) -> None:
        """Add a share of the points' errors: of the IMU's position less the ``arm`` (m, 3), which turns with the
        attitude.

        Points that are passed at the same time, such as both rails under one unit, differ in nothing but their arm:
        what is drawn is the same for all.
        """
        left, f = self._points.left, self._fraction
        w0, w1, u0, u1 = hermite_weights(f, self._span)
        directions = (shifts.up, self._up), (shifts.left, left), (shifts.ahead, cross(left, self._up))
        for out, direction in directions:
            lever = cross(arm, direction)
            carried = [-(1.0 - f) * lever, w0 * direction, u0 * direction, -f * lever, w1 * direction, u1 * direction]
            rows, index = self._of_keyframes
            add_weighted_rows(rows, index, share * np.concatenate(carried, axis=1), out)
            if arm.any():
                for walk, weight in zip(self._turned, -share * lever.T, strict=True):
                    self._add_noise(walk, self._noisiest, weight, out)
            if self._points.body is not None:
                out += share * np.einsum("mi,mij->mj", direction, self._points.body) @ self._errors.point
        beam, modes = self._errors.beam.reshape(-1, self._errors.count), np.arange(len(_BEAM_MODES))
        shapes = share * self._span**1.5 * _beam(self._points.fraction)
        for out, axis, plane in ((shifts.up, 2, 0), (shifts.shaken, 1, 1)):
            of_interval = modes + len(modes) * (2 * self._points.keyframe[:, None] + plane)
            density = self._run.noise.accel[self._points.keyframe, axis, None]
            add_weighted_rows(beam, of_interval, density * shapes, out)

    def angles(self) -> AngleErrors:
        """Draw the errors of the points' attitude."""
        heading = self._turned_about(self._up, noise_axis=2)
        tilt = self._turned_about(cross(self._points.axle, self._up), noise_axis=0)  # d(axle) = phi x axle
        return AngleErrors(np.ascontiguousarray(heading.T), np.ascontiguousarray(tilt.T))

    @cached_property
    def _turned(self) -> list[Array]:
        """Return the sigma of what the gyro's white noise turns between keyframes, about each axis of n."""
        return [self._bridges.drawn(self._errors) for _ in range(3)]

    @cached_property
    def _noisiest(self) -> int:
        return int(np.argmax(self._run.noise.gyro[self._points.keyframe].sum(axis=0)))

    def _turned_about(self, direction: Array, noise_axis: int) -> Array:
        """Draw the error of the attitude about a direction (m, 3), carried from the keyframes, with what the gyro's
        white noise about an axis adds. (m, count)
        """
        out = np.zeros((len(direction), self._errors.count))
        rows, index = self._of_keyframes
        weights = np.column_stack([(1.0 - self._fraction) * direction, self._fraction * direction])
        add_weighted_rows(rows, index[:, [0, 1, 2, 9, 10, 11]], weights, out)
        self._add_noise(self._bridges.drawn(self._errors), noise_axis, np.ones(len(direction)), out)
        return out

    def _add_noise(self, walk: Array, axis: int, weight: Array, out: Array) -> None:
        """Add a walk as what the gyro's white noise about an axis adds between keyframes, times a weight (m,)."""
        density = self._run.noise.gyro[self._points.keyframe, axis]
        add_weighted_rows(walk, self._bridges.index, (density * weight)[:, None] * self._bridges.weights, out)


def _beam(f: Array) -> Array:
    """Return the modes of a beam clamped at 0 and 1, unit norm, over beta^2. Shape (m,) to (m, modes)."""
    b = _BEAM_MODES
    x = f[:, None] * b
    ratio = (np.cosh(b) - np.cos(b)) / (np.sinh(b) - np.sin(b))
    return np.asarray((np.cosh(x) - np.cos(x) - ratio * (np.sinh(x) - np.sin(x))) / b**2)


class _Bridges:
    """Brownian motion of unit density at ``fraction`` (m,) of the intervals after ``keyframe`` (m,), pinned at every
    keyframe; ``t`` (n,): their times, s.

    It is a walk at keyframes and points in order of time, of whose rows those at ``index`` (m, 3), times ``weights``
    (m, 3), are a bridge.
    """

    def __init__(self, t: Array, keyframe: np.ndarray, fraction: Array) -> None:
        low, high = keyframe.min(), keyframe.max() + 2
        times = np.concatenate([t[low:high], t[keyframe] + fraction * np.diff(t)[keyframe]])
        order = np.argsort(times, kind="stable")
        self._step_sd = np.sqrt(np.diff(times[order], prepend=times[order[0]]))
        row = np.empty_like(order)
        row[order] = np.arange(len(order))
        k, pins = keyframe - low, row[: high - low]
        self.index = np.column_stack([row[high - low :], pins[k], pins[k + 1]])
        self.weights = np.column_stack([np.ones(len(k)), fraction - 1.0, -fraction])

    def drawn(self, errors: PosteriorErrors) -> Array:
        """Draw as many walks as there are samples of the errors, (rows, count)."""
        steps = errors.rng.standard_normal((len(self._step_sd), errors.count))
        steps *= self._step_sd[:, None]
        return add_up_rows(steps)
