"""Straights show whether the sensor is tilted sideways in the vehicle: track has no cant there, on average.

Roll of the mounting leaves the direction of travel as it is, so no motion shows it, and gravity cannot separate it from
cant. Cant is built in curves only. So the mean roll on straights is that of the mounting, or that of a track which is
canted all the same (or the crossfall of a road): it is not taken off, but what of it the sigma of roll does not explain
becomes the sigma of the mounting's roll, a constant in roll and cross-level. Twist and all that is short does not
contain it.

Where the way does not show it, pitch and yaw of the mounting do: a sensor that motion shows to be tilted by b was not
levelled, and its roll is as uncertain. With the prior variance ``B`` of the tilt, the mean roll ``m``, the variance
``A`` of roll and ``C`` of what else is in the mean, the roll that is reported errs by ``x``, whose posterior is

    E[x^2] = (g m)^2 + (A + B) (1 - g),   g = (A + B) / (A + B + C),   B = max(m^2 - A - C, b^2),

of which ``A`` is in the sigma of roll already. The first of the two is the most likely ``B`` by the mean roll alone
(empirical Bayes).
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from trackfg.factors.states import Kind
from trackfg.numerics.arrays import Array
from trackfg.recording.findings import Finding
from trackfg.smoothing.passage import STEP_M, Passage, chord_curvature, passage
from trackfg.smoothing.reassessment import SolvedRun

_BASE_M = 50.0
"""Curvature is that of a chord this long, m, and a straight begins and ends so far from any curve: along a clothoid
cant begins before the curvature shows."""

_STRAIGHT_1PM = 2e-4
"""Curvature below which track is straight, 1/m."""

_UNCANTED_MPS2 = 1600.0 * _STRAIGHT_1PM
"""Lateral acceleration v^2 / R, m/s^2, up to which a curve has no cant: at R 5000 and 40 m/s the whole cant would be 33
mrad, and none is usual. Lines for 80 m/s have 100 mm and more at R 9000 (EN 13803)."""

_REACH = round(_BASE_M / STEP_M)
MARGIN = _REACH + _REACH // 2
"""Cells to both sides of one that decide whether it is on a straight: half the chord, and the base beyond it."""

SHORTEST_M = 200.0
"""Length of straight, all together, or else of the run, below which its mean says nothing: twists and irregularities
are not averaged."""

_CURVED = 0.2
"""Share of the way in curves below which a line of roll over curvature is not determined."""

NOTICED_RAD = np.radians(0.2)
"""From here on a tilt is a finding: 5 mm between the rails, what track is relaid to."""


class MeanRoll(NamedTuple):
    """The mean roll of track without cant, rad: ``own`` is the variance of roll, rad^2, and ``besides`` that of what
    else is in the mean, infinite where the way shows nothing.
    """

    roll: float
    own: float
    besides: float


UNSEEN = MeanRoll(0.0, 0.0, np.inf)
"""The way does not show the roll of the mounting."""


def with_roll_of_mounting(run: SolvedRun) -> SolvedRun:
    """Return the run with the sigma of the mounting's roll that its way shows, and a finding where it is large."""
    mean, context = _mean_roll(run), run.problem.run
    # A roll that is known to a sigma was measured: what else the mounting is says nothing about it.
    tilt = 0.0 if context.mount_roll_sd else _tilt(run)
    sd = roll_of_mounting_sd(mean, tilt)
    if sd <= context.mount_roll_sd:
        return run
    problem = replace(run.problem, run=replace(context, mount_roll_sd=sd))
    return replace(run, problem=problem, findings=(*run.findings, *_findings(mean, tilt, sd)))


def roll_of_mounting_sd(mean: MeanRoll, tilt: float) -> float:
    """Return by how much the reported roll is off, besides its own sigma, of a mounting that is tilted so much, rad."""
    prior = mean.own + max(mean.roll**2 - mean.own - mean.besides, tilt**2)
    if prior == 0.0:
        return 0.0
    gain = prior / (prior + mean.besides)
    return float(np.sqrt(max((gain * mean.roll) ** 2 + prior * (1.0 - gain) - mean.own, 0.0)))


def _tilt(run: SolvedRun) -> float:
    """Return the tilt of the mounting about one axis, rad, by its pitch and yaw, less what their sigmas explain."""
    angles = run.solution.states.mount[0, :2]
    variance = np.diagonal(run.covariance.of(Kind.MOUNT)[0])[:2]
    return float(np.sqrt(max(np.mean(angles**2 - variance), 0.0)))


def _mean_roll(run: SolvedRun) -> MeanRoll:
    """Return the mean roll on straights; without any, that at curvature 0 by the curves."""
    at = passage(run)
    on_straight = straight(at.heading, straightest(_fastest(at)))
    if len(at.roll) * STEP_M < SHORTEST_M:
        return UNSEEN
    if np.sum(on_straight) * STEP_M < SHORTEST_M:
        return roll_at_no_curvature(at)
    return MeanRoll(float(np.mean(at.roll[on_straight])), float(np.mean(at.roll_variance[on_straight])), 0.0)


def roll_at_no_curvature(at: Passage) -> MeanRoll:
    """Return roll at curvature 0 by the line of roll over curvature, since cant has its sign.

    Cant need not be proportional to curvature: what the line takes for cant at the mean curvature is as uncertain as it
    is large. In curves of both ways it is hardly anything. Nothing is seen where hardly anything is curved, or all is.
    """
    half = round(0.5 * _BASE_M / STEP_M)
    curvature = chord_curvature(at.heading, half)
    roll = at.roll[half : len(at.roll) - half]
    curved = np.abs(curvature) > straightest(_fastest(at))
    if np.mean(curved) < _CURVED or curved.all():
        return UNSEEN
    mean = float(curvature.mean())
    away = curvature - mean
    spread = float(away @ away)
    slope = float(away @ roll) / spread
    residual = roll - roll.mean() - slope * away
    lever = 1.0 / len(roll) + mean**2 / spread
    besides = float(np.mean(residual**2)) * lever * 2 * half + (slope * mean) ** 2
    return MeanRoll(float(roll.mean() - slope * mean), float(np.mean(at.roll_variance)), besides)


def straight(heading: Array, limit: Array) -> np.ndarray:
    """Return which cells, :data:`STEP_M` apart, are on a straight, and as far from its ends as the base is long.

    What is beyond the ends of ``heading`` (n,), rad, counts as curved, and so does a curvature above ``limit`` (n,) or
    (), 1/m. Returns (n,).
    """
    curved, half = np.ones(len(heading), dtype=np.int64), _REACH // 2
    within = slice(half, len(heading) - half)
    curved[within] = np.abs(chord_curvature(heading, half)) > np.broadcast_to(limit, len(heading))[within]
    total = np.concatenate([[0], np.cumsum(np.pad(curved, _REACH, constant_values=1))])
    return np.asarray(total[2 * _REACH + 1 :] == total[: -2 * _REACH - 1])


def straightest(fastest: Array) -> Array:
    """Return the curvature, 1/m, up to which a line has no cant where vehicles are as fast as this, m/s."""
    return np.asarray(np.minimum(_STRAIGHT_1PM, _UNCANTED_MPS2 / np.maximum(fastest, 1.0) ** 2))


def _fastest(at: Passage) -> Array:
    return np.asarray(np.abs(at.speed).max(initial=0.0, keepdims=True))


def unexplained_roll(roll: float, variance: float) -> float:
    """Return what of a mean roll its variance, rad^2, does not explain, rad."""
    return float(np.sqrt(max(roll**2 - variance, 0.0)))


def in_words(roll: float) -> str:
    """Say what a mean roll on straights, rad, is."""
    degrees, way = np.degrees(roll), "left" if roll > 0 else "right"
    tilt = f"on straights the {way} side is {abs(degrees):.2f} deg up on average"
    return f"{tilt}: the sensor is mounted so, or the track is canted"


def _findings(mean: MeanRoll, tilt: float, sd: float) -> tuple[Finding, ...]:
    if sd < NOTICED_RAD:
        return ()
    if 2.0 * unexplained_roll(mean.roll, mean.own + mean.besides) ** 2 >= sd**2:
        message = f"{in_words(mean.roll)}; the sigmas of roll and cross-level hold it as a constant error"
        added = f"add {np.degrees(mean.roll):.2f} to the roll in mount_rpy_deg of [imu]"
        hint = f"if it is the sensor, {added}; else declare mount_roll_sd_deg"
        return (Finding("warning", "roll-on-straights", message, hint=hint),)
    message = (
        f"pitch and yaw of the sensor's mounting are off by {np.degrees(tilt):.2f} deg, and too little of the track is "
        f"straight to show its roll; the sigmas of roll and cross-level hold {np.degrees(sd):.2f} deg as a constant "
        "error"
    )
    hint = "measure how the sensor is mounted, and declare mount_rpy_deg and mount_roll_sd_deg of [imu]"
    return (Finding("warning", "mount-roll-unknown", message, hint=hint),)
