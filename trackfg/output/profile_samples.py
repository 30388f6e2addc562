"""Samples of the errors of profiles, drawn from the joint posterior of the run.

The keyframes' errors as they belong together come from :func:`trackfg.solver.covariance.posterior_samples`; between
keyframes the white noise of the inertial samples is added, pinned at both ends. An operator applied to the samples has
its sigma as their spread, whatever its extent.
"""

from __future__ import annotations

from dataclasses import dataclass

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


@dataclass(frozen=True)
class PointErrors:
    """Errors of points, each (count, m): ``height``, ``lateral`` m, ``heading`` rad, ``tilt`` (of the sine of roll)."""

    height: Array
    lateral: Array
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


def point_errors(run: RunContext, points: Points, errors: PosteriorErrors) -> PointErrors:
    """Draw the errors of points in order of chainage.

    Position is carried between keyframes by the cubic of its end values and slopes, attitude linearly. In between, the
    accelerometer's white noise N adds ``N T^1.5 sum phi_i(f) / beta_i^2 xi_i``, phi_i the modes of a clamped beam (the
    doubly integrated noise, pinned in value and slope: three modes hold 98 % of it), and the gyro's a Brownian bridge.
    """
    k, f, count = points.keyframe, points.fraction, errors.position.shape[2]
    span = np.diff(run.t)[k][:, None]
    left, axle, arm = points.left, points.axle, points.arm
    f1 = f[:, None]
    p, v, a = errors.position, errors.velocity, errors.attitude
    w0, w1, u0, u1 = (weight[:, :, None] for weight in hermite_weights(f1, span))
    moved = w0 * p[k] + w1 * p[k + 1] + u0 * v[k] + u1 * v[k + 1]
    tilted = (1.0 - f1)[:, :, None] * a[k] + f1[:, :, None] * a[k + 1]

    def position(direction: Array) -> Array:
        """Return the error of the IMU's position in a direction (m, 3), carried from the keyframes."""
        return np.asarray(np.einsum("mi,mis->ms", direction, moved))

    def attitude(direction: Array) -> Array:
        """Return the error of the attitude about a direction (m, 3), carried from the keyframes."""
        return np.asarray(np.einsum("mi,mis->ms", direction, tilted))

    def shaken(axis: int, direction: int) -> Array:
        modes = run.noise.accel[k, axis, None] * span**1.5 * _beam(f)
        return np.asarray(np.einsum("mi,mis->ms", modes, errors.beam[k, direction]))

    def turned(axis: int) -> Array:
        return np.asarray(run.noise.gyro[k, axis, None] * _bridges(run.t, k, f, count, errors.rng))

    levered = int(np.argmax(run.noise.gyro[k].sum(axis=0)))

    up = np.broadcast_to([0.0, 0.0, 1.0], left.shape)
    forward = np.cross(left, up)

    def at_point(direction: Array) -> Array:
        """Return the error of the point: the IMU's position less the arm, which turns with the attitude."""
        if not arm.any():
            return position(direction)
        lever = np.cross(arm, direction)
        return np.asarray(
            position(direction) - attitude(lever) + np.linalg.norm(lever, axis=1)[:, None] * turned(levered)
        )

    height, across, ahead = (at_point(direction) for direction in (up, left, forward))
    # The heading of the path errs by d(across)/dx + curvature * ahead: a path that is turned as a whole stays the same.
    turn = np.diff(np.unwrap(np.arctan2(forward[:, 1], forward[:, 0])))[:, None]
    bent = np.vstack([np.zeros((1, count)), np.cumsum(0.5 * turn * (ahead[1:] + ahead[:-1]), axis=0)])
    return PointErrors(
        height=(height + shaken(2, 0)).T,
        lateral=(across + bent + shaken(1, 1)).T,
        heading=(attitude(up) + turned(2)).T,
        tilt=(attitude(np.cross(axle, up)) + turned(0)).T,  # d(axle) = phi x axle
    )


def _beam(f: Array) -> Array:
    """Return the modes of a beam clamped at 0 and 1, unit norm, over beta^2. Shape (m,) to (m, modes)."""
    b = _BEAM_MODES
    x = f[:, None] * b
    ratio = (np.cosh(b) - np.cos(b)) / (np.sinh(b) - np.sin(b))
    return np.asarray((np.cosh(x) - np.cos(x) - ratio * (np.sinh(x) - np.sin(x))) / b**2)


def _bridges(t: Array, keyframe: np.ndarray, fraction: Array, count: int, rng: np.random.Generator) -> Array:
    """Draw Brownian motion of unit density at the rows' times, pinned at every keyframe. Shape (m, count)."""
    rows = t[keyframe] + fraction * np.diff(t)[keyframe]
    low, high = keyframe.min(), keyframe.max() + 2
    times = np.concatenate([t[low:high], rows])
    order = np.argsort(times, kind="stable")
    steps = np.sqrt(np.diff(times[order], prepend=times[order[0]]))[:, None] * rng.standard_normal((len(times), count))
    free = np.empty_like(steps)
    free[order] = np.cumsum(steps, axis=0)
    pins, k, f = free[: high - low], keyframe - low, fraction[:, None]
    return np.asarray(free[high - low :] - (1.0 - f) * pins[k] - f * pins[k + 1])
