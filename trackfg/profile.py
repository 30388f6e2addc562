"""The smoothed run as profiles over the chainage, one per pass over the track, and how sure they are together.

A pass is a stretch of the run between two changes of direction. On it every quantity is a function of the chainage,
here on whole multiples of the grid's step, ascending, facing increasing chainage whichever way the vehicle went:

* ``height`` z and ``lateral`` u of the track below the reference point, m; ``u'' = d(heading of the path)/dx``, so that
  chords and bands of u are those of the alignment, in curves of any length;
* ``heading`` of the vehicle, rad, and ``tilt``, the sine of its roll (positive: left side up).

:func:`profile_samples` draws the errors of a stretch of these profiles from the joint posterior: the keyframes' errors
as they belong together, and between keyframes the white noise of the inertial samples, pinned at both ends. An operator
applied to the samples has its sigma as their spread, whatever its extent.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackfg.dense import DenseMotion
from trackfg.factors.motion import mount_matrix
from trackfg.factors.states import Kind, States, offset_in_keyframe
from trackfg.frames import Array
from trackfg.geometry.resampling import resample
from trackfg.graph import Problem
from trackfg.spans import true_runs

_MOVED_M = 0.05
"""Keyframes closer than this say nothing about the direction of travel."""

_SHORTEST_PASS_M = 10.0

_BEAM_MODES = np.array([4.730040744862704, 7.853204624095838, 10.995607838001671])


@dataclass(frozen=True)
class Profile:
    """One pass. ``cell`` (m,) is chainage over step, whole numbers ascending by one; the others are (m,) or (m, 3).

    ``keyframe`` and ``fraction`` say when each place was passed; ``arm`` is the vector from the reference point to the
    IMU in n, m; ``left`` the horizontal unit vector to the left of the path, facing increasing chainage.
    """

    cell: np.ndarray
    height: Array
    lateral: Array
    heading: Array
    tilt: Array
    speed: Array
    axle: Array
    arm: Array
    left: Array
    keyframe: np.ndarray
    fraction: Array

    def __len__(self) -> int:
        return len(self.cell)


def profiles(problem: Problem, motion: DenseMotion, states: States, direction: int, step_m: float) -> list[Profile]:
    """All passes, longest first; those too short to hold a chord are left out."""
    found = [_profile(problem, motion, states, direction, step_m, *span) for span in _passes(states.odo[:, 0])]
    return sorted((profile for profile in found if profile is not None), key=len, reverse=True)


def _passes(distance: Array) -> list[tuple[int, int, int]]:
    """First and last keyframe of each pass and its sense."""
    steps = np.diff(distance)
    sense = np.where(np.abs(steps) > _MOVED_M, np.sign(steps), 0.0)
    moving = np.flatnonzero(sense)
    if moving.size == 0:
        return []
    filled = sense[moving[np.clip(np.searchsorted(moving, np.arange(len(sense)), side="right") - 1, 0, None)]]
    runs = [(int(a), int(b), s) for s in (1, -1) for a, b in true_runs(filled == s)]
    return sorted(runs)


def _profile(
    problem: Problem, motion: DenseMotion, states: States, direction: int, step_m: float, k0: int, k1: int, sense: int
) -> Profile | None:
    rows = slice(*np.searchsorted(motion.t, [problem.t[k0], problem.t[k1] + 1e-9]))
    nav, R_bt = motion.nav[rows], mount_matrix(states.mount)[0][0]
    R = nav.R @ R_bt
    arm = nav.R @ problem.lever_arm
    position = nav.p - arm
    x = direction * motion.distance[rows]
    forward, axle = R[:, :, 0], R[:, :, 1] * direction
    speed = np.abs(np.sum(nav.v * forward, axis=1))
    heading = np.unwrap(np.arctan2(forward[:, 1], forward[:, 0]))
    when = motion.keyframe[rows] + motion.fraction[rows]
    order = slice(None, None, 1 if sense * direction > 0 else -1)
    x, when = x[order], when[order]
    if x[-1] - x[0] < _SHORTEST_PASS_M:
        return None
    shape = np.column_stack([position, heading, axle[:, 2]])[order]
    grid, (east, north, height, heading, tilt) = resample(x, shape.T, step_m)
    place = np.maximum.accumulate(x)
    rest = np.column_stack([speed, axle, arm])[order]
    at = np.column_stack([np.interp(grid, place, column) for column in rest.T])
    moment = np.interp(grid, place, when)
    k = np.clip(moment.astype(np.int64), k0, k1 - 1)

    path = np.arctan2(np.diff(north), np.diff(east))
    known = np.isfinite(path)
    path[known] = np.unwrap(path[known])
    path[~known] = 0.0 if not known.any() else np.interp(np.flatnonzero(~known), np.flatnonzero(known), path[known])
    here = np.concatenate([path[:1], 0.5 * (path[1:] + path[:-1]), path[-1:]])
    lateral = np.concatenate([[0.0], np.cumsum((path - path.mean()) * step_m)])
    return Profile(
        cell=np.rint(grid / step_m).astype(np.int64),
        height=height,
        lateral=np.where(np.isfinite(east), lateral, np.nan),
        heading=heading,
        tilt=tilt,
        speed=at[:, 0],
        axle=at[:, 1:4],
        arm=at[:, 4:7],
        left=np.column_stack([-np.sin(here), np.cos(here), np.zeros(len(here))]),
        keyframe=k,
        fraction=moment - k,
    )


@dataclass(frozen=True)
class ProfileSamples:
    """Errors drawn from the posterior, each (count, m): ``height``, ``lateral`` m, ``heading`` rad, ``tilt``."""

    height: Array
    lateral: Array
    heading: Array
    tilt: Array


@dataclass(frozen=True)
class PosteriorErrors:
    """Samples of the keyframes' errors in n: position, velocity, attitude (n, 3, count); and for the noise in between,
    normal draws for the beam's modes (n - 1, 2, modes, count) and where the bridges are drawn from.
    """

    position: Array
    velocity: Array
    attitude: Array
    beam: Array
    rng: np.random.Generator

    @classmethod
    def of(cls, states: States, samples: Array, rng: np.random.Generator) -> PosteriorErrors:
        """From samples of the tangents (n, d, count)."""
        at = offset_in_keyframe(Kind.NAV)
        n, _, count = samples.shape
        attitude, position, velocity = (states.nav.R @ samples[:, at + i : at + i + 3] for i in (0, 3, 6))
        beam = rng.standard_normal((n - 1, 2, len(_BEAM_MODES), count))
        return cls(position, velocity, attitude, beam, rng)


def profile_samples(problem: Problem, profile: Profile, rows: slice, errors: PosteriorErrors) -> ProfileSamples:
    """The errors of some rows of a profile.

    Position is carried between keyframes by the cubic of its end values and slopes, attitude linearly. In between, the
    accelerometer's white noise N adds ``N T^1.5 sum phi_i(f) / beta_i^2 xi_i``, phi_i the modes of a clamped beam (the
    doubly integrated noise, pinned in value and slope: three modes hold 98 % of it), and the gyro's a Brownian bridge.
    """
    k, f, count = profile.keyframe[rows], profile.fraction[rows], errors.position.shape[2]
    span = np.diff(problem.t)[k][:, None]
    left, axle, arm = profile.left[rows], profile.axle[rows], profile.arm[rows]
    f1 = f[:, None]
    weights = (
        1.0 - 3.0 * f1**2 + 2.0 * f1**3,
        3.0 * f1**2 - 2.0 * f1**3,
        span * (f1 - 2.0 * f1**2 + f1**3),
        span * (f1**3 - f1**2),
    )

    def along(direction: Array, samples: Array) -> Array:
        return np.einsum("mi,mis->ms", direction, samples)

    def position(direction: Array) -> Array:
        """The error of the IMU's position in a direction (m, 3), carried from the keyframes."""
        p, v = errors.position, errors.velocity
        parts = (p[k], p[k + 1], v[k], v[k + 1])
        return np.asarray(sum(w * along(direction, part) for w, part in zip(weights, parts, strict=True)))

    def attitude(direction: Array) -> Array:
        """The error of the attitude about a direction (m, 3), carried from the keyframes."""
        return (1.0 - f1) * along(direction, errors.attitude[k]) + f1 * along(direction, errors.attitude[k + 1])

    def shaken(axis: int) -> Array:
        modes = problem.noise.accel * span**1.5 * _beam(f)
        return np.asarray(np.einsum("mi,mis->ms", modes, errors.beam[k, axis]))

    def turned() -> Array:
        return problem.noise.gyro * _bridges(problem.t, k, f, count, errors.rng)

    up = np.broadcast_to([0.0, 0.0, 1.0], left.shape)
    forward = np.cross(left, up)
    # The reference point is the IMU's position less the arm, which turns with the attitude.
    height, across, ahead = (
        position(direction) - (attitude(np.cross(arm, direction)) if arm.any() else 0.0)
        for direction in (up, left, forward)
    )
    # The heading of the path errs by d(across)/dx + curvature * ahead: a path that is turned as a whole stays the same.
    turn = np.diff(np.unwrap(np.arctan2(forward[:, 1], forward[:, 0])))[:, None]
    bent = np.vstack([np.zeros((1, count)), np.cumsum(0.5 * turn * (ahead[1:] + ahead[:-1]), axis=0)])
    return ProfileSamples(
        height=(height + shaken(0)).T,
        lateral=(across + bent + shaken(1)).T,
        heading=(attitude(up) + turned()).T,
        tilt=(attitude(np.cross(axle, up)) + turned()).T,  # d(axle) = phi x axle
    )


def _beam(f: Array) -> Array:
    """Modes of a beam clamped at 0 and 1, unit norm, over beta^2. Shape (m,) to (m, modes)."""
    b = _BEAM_MODES
    x = f[:, None] * b
    ratio = (np.cosh(b) - np.cos(b)) / (np.sinh(b) - np.sin(b))
    return np.asarray((np.cosh(x) - np.cos(x) - ratio * (np.sinh(x) - np.sin(x))) / b**2)


def _bridges(t: Array, keyframe: np.ndarray, fraction: Array, count: int, rng: np.random.Generator) -> Array:
    """Brownian motion of unit density at the rows' times, pinned at every keyframe. Shape (m, count)."""
    rows = t[keyframe] + fraction * np.diff(t)[keyframe]
    low, high = keyframe.min(), keyframe.max() + 2
    times = np.concatenate([t[low:high], rows])
    order = np.argsort(times, kind="stable")
    steps = np.sqrt(np.diff(times[order], prepend=times[order[0]]))[:, None] * rng.standard_normal((len(times), count))
    free = np.empty_like(steps)
    free[order] = np.cumsum(steps, axis=0)
    pins, k, f = free[: high - low], keyframe - low, fraction[:, None]
    return np.asarray(free[high - low :] - (1.0 - f) * pins[k] - f * pins[k + 1])
