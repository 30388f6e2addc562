"""Samples of the errors of profiles, drawn from the joint posterior of the run.

The keyframes' errors as they belong together come from :func:`trackfg.solver.covariance.posterior_samples`; between
keyframes the white noise of the inertial samples is added, pinned at both ends. An operator applied to the samples has
its sigma as their spread, whatever its extent.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from trackfg.factors.states import Kind, States, offset_in_keyframe
from trackfg.graph.run_context import RunContext
from trackfg.numerics.arrays import Array
from trackfg.numerics.hermite import hermite_weights

_BEAM_MODES = np.array([4.730040744862704, 7.853204624095838, 10.995607838001671])


@dataclass(frozen=True)
class Points:
    """Places along the track, each passed at ``fraction`` (m,) of the interval after ``keyframe`` (m,).

    ``left`` (m, 3): horizontal unit vector to the left of the path, facing increasing chainage; ``axle`` (m, 3): the
    vehicle's left axis, likewise facing; ``arm`` (m, 3): from the point to the IMU, m. All in n.
    """

    keyframe: np.ndarray
    fraction: Array
    left: Array
    axle: Array
    arm: Array

    def __getitem__(self, rows: slice) -> Points:
        return Points(self.keyframe[rows], self.fraction[rows], self.left[rows], self.axle[rows], self.arm[rows])


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
    """Samples of the keyframes' errors in n: position, velocity, attitude (n, 3, count).

    The noise in between has normal draws for the beam's modes (n - 1, 2, modes, count) and where the bridges are drawn
    from.
    """

    position: Array
    velocity: Array
    attitude: Array
    beam: Array
    rng: np.random.Generator

    @classmethod
    def of(cls, states: States, samples: Array, rng: np.random.Generator) -> PosteriorErrors:
        """Turn samples of the keyframes' tangents (n, KEYFRAME_DIM, count) into errors in n."""
        at = offset_in_keyframe(Kind.NAV)
        n, _, count = samples.shape
        attitude, position, velocity = (states.nav.R @ samples[:, at + i : at + i + 3] for i in (0, 3, 6))
        beam = rng.standard_normal((n - 1, 2, len(_BEAM_MODES), count))
        return cls(position, velocity, attitude, beam, rng)


class PointErrors:
    """Errors of points in order of chainage are drawn one after the other, from the keyframes' errors.

    Position is carried between keyframes by the cubic of its end values and slopes, attitude linearly. In between, the
    accelerometer's white noise N adds ``N T^1.5 sum phi_i(f) / beta_i^2 xi_i``, phi_i the modes of a clamped beam (the
    doubly integrated noise, pinned in value and slope: three modes hold 98 % of it), and the gyro's a Brownian bridge.
    """

    def __init__(self, run: RunContext, points: Points, errors: PosteriorErrors) -> None:
        self._run, self._points, self._errors = run, points, errors
        self._bridges = _Bridges(run.t, points.keyframe, points.fraction)
        f, a = points.fraction[:, None, None], errors.attitude
        self._tilted = (1.0 - f) * a[points.keyframe] + f * a[points.keyframe + 1]

    def places(self, *arms: Array) -> list[PlaceErrors]:
        """Draw the errors of the points: the IMU's position less the arm, which turns with the attitude.

        Points that are passed at the same time, such as both rails under one unit, differ in nothing but their arm:
        there is one list entry for each of the ``arms`` (m, 3), the points' own by default, and what is drawn is the
        same for all.
        """
        run, errors, k, left = self._run, self._errors, self._points.keyframe, self._points.left
        arms = arms or (self._points.arm,)
        turned = self._turned() if any(arm.any() for arm in arms) else None
        span, f = np.diff(run.t)[k][:, None], self._points.fraction[:, None]
        w0, w1, u0, u1 = (weight[:, :, None] for weight in hermite_weights(f, span))
        p, v = errors.position, errors.velocity
        moved = w0 * p[k] + w1 * p[k + 1] + u0 * v[k] + u1 * v[k + 1]
        up = np.broadcast_to([0.0, 0.0, 1.0], left.shape)
        directions = up, left, np.cross(left, up)
        positions = [np.einsum("mi,mis->ms", direction, moved) for direction in directions]
        beam = span**1.5 * _beam(self._points.fraction)

        def shaken(axis: int, direction: int) -> Array:
            modes = run.noise.accel[k, axis, None] * beam
            return np.asarray(np.einsum("mi,mis->ms", modes, errors.beam[k, direction]))

        up_shaken, left_shaken = shaken(2, 0), shaken(1, 1)
        # The heading of the path errs by d(across)/dx + curvature * ahead: a path that is turned as a whole stays the
        # same.
        turn = np.diff(np.unwrap(np.arctan2(directions[2][:, 1], directions[2][:, 0])))[:, None]

        def at_arm(arm: Array) -> PlaceErrors:
            def at_point(position: Array, direction: Array) -> Array:
                if turned is None:
                    return position
                lever = np.cross(arm, direction)
                return np.asarray(position - self._turned_about(lever) - np.einsum("mi,ims->ms", lever, turned))

            height, across, ahead = (at_point(*both) for both in zip(positions, directions, strict=True))
            bent = _summed(0.5 * turn * (ahead[1:] + ahead[:-1]))
            # A curve seems to bend less by as much as its length seems longer.
            stretched = np.diff(ahead, axis=0) - 0.5 * turn * (across[1:] + across[:-1])
            turned_less = -_summed(turn * stretched)
            bent += _summed(0.5 * (turned_less[1:] + turned_less[:-1]))
            return PlaceErrors((height + up_shaken).T, (across + bent + left_shaken).T, turned_less.T)

        return [at_arm(arm) for arm in arms]

    def _turned(self) -> Array:
        """Draw what the gyro's white noise turns between keyframes, about each axis of n: (3, m, count)."""
        noisiest = int(np.argmax(self._run.noise.gyro[self._points.keyframe].sum(axis=0)))
        return np.stack([self._noise(noisiest) for _ in range(3)])

    def angles(self) -> AngleErrors:
        """Draw the errors of the points' attitude."""
        up = np.broadcast_to([0.0, 0.0, 1.0], self._points.axle.shape)
        heading = self._turned_about(up) + self._noise(2)
        tilt = self._turned_about(np.cross(self._points.axle, up)) + self._noise(0)  # d(axle) = phi x axle
        return AngleErrors(heading.T, tilt.T)

    def _turned_about(self, direction: Array) -> Array:
        """Return the error of the attitude about a direction (m, 3), carried from the keyframes. (m, count)"""
        return np.asarray(np.einsum("mi,mis->ms", direction, self._tilted))

    def _noise(self, axis: int) -> Array:
        """Draw what the gyro's white noise adds between keyframes about an axis. (m, count)"""
        density = self._run.noise.gyro[self._points.keyframe, axis, None]
        return np.asarray(density * self._bridges.drawn(self._errors.attitude.shape[2], self._errors.rng))


def _summed(steps: Array) -> Array:
    """Return running sums of steps (m - 1, count) from zero on. Shape (m, count)."""
    return np.vstack([np.zeros((1, steps.shape[1])), np.cumsum(steps, axis=0)])


def _beam(f: Array) -> Array:
    """Return the modes of a beam clamped at 0 and 1, unit norm, over beta^2. Shape (m,) to (m, modes)."""
    b = _BEAM_MODES
    x = f[:, None] * b
    ratio = (np.cosh(b) - np.cos(b)) / (np.sinh(b) - np.sin(b))
    return np.asarray((np.cosh(x) - np.cos(x) - ratio * (np.sinh(x) - np.sin(x))) / b**2)


class _Bridges:
    """Brownian motion of unit density at ``fraction`` (m,) of the intervals after ``keyframe`` (m,), pinned at every
    keyframe; ``t`` (n,): their times, s.
    """

    def __init__(self, t: Array, keyframe: np.ndarray, fraction: Array) -> None:
        low, high = keyframe.min(), keyframe.max() + 2
        times = np.concatenate([t[low:high], t[keyframe] + fraction * np.diff(t)[keyframe]])
        self._order = np.argsort(times, kind="stable")
        self._step_sd = np.sqrt(np.diff(times[self._order], prepend=times[self._order[0]]))
        self._pins, self._interval, self._fraction = high - low, keyframe - low, fraction[:, None]

    def drawn(self, count: int, rng: np.random.Generator) -> Array:
        """Draw some of them, (m, count)."""
        steps = self._step_sd[:, None] * rng.standard_normal((len(self._order), count))
        free = np.empty_like(steps)
        free[self._order] = np.cumsum(steps, axis=0, out=steps)
        pins, k, f = free[: self._pins], self._interval, self._fraction
        return np.asarray(free[self._pins :] - (1.0 - f) * pins[k] - f * pins[k + 1])
