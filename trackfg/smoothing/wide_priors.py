"""A prior that the data contradict is widened, so that the data decide, and reported in the words of the field.

For each scalar that is known beforehand to a sigma s0, and estimated as r off its prior with the posterior sigma s, the
data alone, without this prior of sigma s1, would have given

    e = r / (1 - h),   c^2 = s^2 / (1 - h),   h = (s / s1)^2

(leave-one-out, as in :mod:`trackfg.solver.leave_one_out`). They contradict what is declared where ``|e|`` is far beyond
``sqrt(s0^2 + c^2)``. The sigma becomes ``|e|`` then, the value at which what is seen is most likely: empirical Bayes
(Efron & Morris, J. Am. Stat. Assoc. 68 (1973)).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import count, product
from typing import NamedTuple

import numpy as np

from trackfg.factors.bias import EARTH
from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family, changed
from trackfg.factors.motion import mount_matrix
from trackfg.factors.odometry import SPEED_OFFSET
from trackfg.factors.states import Kind, Odo
from trackfg.graph.build import Problem
from trackfg.graph.priors import CALIBRATION_FACTOR
from trackfg.numerics.arrays import Array
from trackfg.numerics.geodesy import EARTH_RATE
from trackfg.numerics.rotations import rpy_from_matrix
from trackfg.numerics.units import DEG_PER_H
from trackfg.recording.findings import Finding
from trackfg.results.verdict import Doubt, Quantity
from trackfg.smoothing.doubts.gradient_doubts import is_steeper_than_any_line
from trackfg.smoothing.doubts.mounting_doubts import lasting_pull, moving_point
from trackfg.smoothing.noise_levels import FAR_OFF
from trackfg.smoothing.noisy_response import without_noise
from trackfg.smoothing.reassessment import LEAST_CHANGE, Reassessment, SolvedRun, others_are_worse
from trackfg.solver.leave_one_out import prior_left_out

_FAR_SIGMAS = 4.0
"""Sigmas beyond which the data contradict a prior: of some 40 that are right one does in 400 runs."""

_NEAR_SIGMAS = 3.0
"""Within this a prior is as declared again: noise levels that were wrong at first make priors look contradicted."""

_LEAST_FREE = 1e-9
"""1 - h at least: beyond it rounding decides what the data alone say."""

_SET_SD = 1e-5
"""Sigmas below this do not say what is known but what is so by convention."""

_EARTH_SIGMAS = 3.0
"""Sigmas beyond which the data contradict an Earth that does not turn: only simulated ones do not."""

_UNEXPLAINED_HINT = "check the sensor's mounting, its clock and its noise figures"

_EARTH_HINT = "declare latitude_deg and heading_deg of [track]"

_WORTH_A_LINE = np.array([np.radians(1.0), np.radians(1.0), 2.0, 0.5, 2.0])
"""From here on a mounting is one: rad, as eye and spirit level align to about a degree, and m along the vehicle,
sideways and upwards. On springs the point that follows the track lies where roll and pitch have their poles, 1 m and
more from the reference point, whatever was measured with a tape."""


_FARTHEST = np.array([np.inf, np.inf, 13.2, 1.7, 4.3])
"""No vehicle is larger, m: half the length of a coach (26.4 m, UIC 567), half the width of the widest (3.4 m,
Shinkansen), the height of the loading gauge G1 (UIC 505-1). A point further away follows no track: it is noise."""


class _Scalar(NamedTuple):
    """A scalar of a prior: its ``column``; what to say of its value, and what the user can declare.

    ``text`` has a place for ``origin`` plus ``scale`` times the value; and where it has ``ways``, one for its size and
    one for the way of positive or of negative values. Where what is declared is below ``least_sd``, that is a
    convention; beyond ``limit`` sigmas it is contradicted.
    """

    column: int
    text: str
    hint: str
    scale: float = 1.0
    ways: tuple[str, str] | None = None
    origin: float = 0.0
    least_sd: float = _SET_SD
    limit: float = _FAR_SIGMAS

    def described(self, value: float) -> str:
        """Return the value in words."""
        shown = self.origin + self.scale * value
        if self.ways is None:
            return self.text.format(f"{shown:.4g}")
        return self.text.format(f"{abs(shown):.3g}", self.ways[0 if shown > 0 else 1])

    def off(self, value: float, sigmas: float, sd: float) -> str:
        """Return in words that the value is that many ``sigmas`` from what was known to ``sd``."""
        return f"{self.described(value)}, {sigmas:.1f} sigmas from what was declared or assumed to {sd:.2g}"


def _mounting() -> Iterator[_Scalar]:
    text, hint = "the sensor points {} deg {} the direction of travel", "write the angles into mount_rpy_deg of [imu]"
    for column, ways in enumerate((("above", "below"), ("to the right of", "to the left of"))):
        yield _Scalar(column, text, hint, float(np.degrees(1.0)), ways)
    text = "the point that follows the track is {} m {} the reference point"
    hint = "declare lever_arm_m of [imu] from that point: midway between bogies, or the axle"
    for column, ways in enumerate((("ahead of", "behind"), ("left of", "right of"), ("above", "below")), start=2):
        yield _Scalar(column, text, hint, 1.0, ways)


def _clocks() -> Iterator[_Scalar]:
    for column, name, table in ((0, "tachometer", "tach"), (2, "GNSS receiver", "gnss")):
        hint = f"write it into time_offset_s of [{table}], slow as a positive number"
        yield _Scalar(column, f"the clock of the {name} is {{}} s {{}}", hint, 1.0, ("slow", "fast"))
    yield _Scalar(1, "the clock of the tachometer drifts by {} s/s", "give tach.clock_drift_sd as much")


def _calibration() -> Iterator[_Scalar]:
    column = count()
    hint = "declare {} of [imu.noise] as large"
    triads = (("accelerometer", "accel", "force"), ("gyro", "gyro", "angular rate"))
    for name, key, signal in triads:
        for axis, other in product("xyz", "xyz"):
            text = f"the {name}'s {axis} axis senses {{}} % of the {signal} along {other}"
            declared = "misalignment_sd_rad"
            if axis == other:
                text, declared = f"the scale of the {name}'s {axis} axis is off by {{}} %", f"{key}_scale_sd"
            yield _Scalar(next(column), text, hint.format(declared), 100.0)
    for axis, other in product("xyz", "xy"):
        text = f"the gyro's {axis} axis senses {{}} rad/s per m/s^2 along {other}"
        yield _Scalar(next(column), text, hint.format("g_sensitivity_sd"))
    column, text = count(EARTH.start), "the Earth turns about the axis {} by {{}} deg/h"
    for axis in ("of the heading at the start", "to the left of the heading at the start"):
        sentence = text.format(axis)
        yield _Scalar(next(column), sentence, _EARTH_HINT, 1.0 / DEG_PER_H, least_sd=0.0, limit=_EARTH_SIGMAS)


def _wheel() -> Iterator[_Scalar]:
    text = "in curves the wheel runs {} m {} the centre line"
    hint = "give tach.rail_offset_sd_m as much, or look for what else makes distances in curves wrong"
    for column, ways in enumerate((("left of", "right of"), ("outside", "inside"))):
        yield _Scalar(column, text, hint, 1.0, ways)
    for column, force in ((2, "traction"), (3, "braking")):
        hint = "give tach.creep_per_traction_sd as much"
        yield _Scalar(column, f"the wheel creeps by {{}} % per g in {force}", hint, 100.0)
    yield _Scalar(SPEED_OFFSET, "the speed signal has an offset of {} m/s", "correct it in the table")


_FURTHER = (
    _Scalar(0, "the scale of a further sensor is {}", "correct it, or give it a larger scale_sd", origin=1.0),
    _Scalar(1, "a further sensor is off by {}, s of its clock or rad of its yaw", "correct it in recording.toml"),
)

_RECEIVER = (
    _Scalar(0, "the receiver's speeds are {} m/s too high", "correct them: whole numbers that are cut off are too low"),
    _Scalar(1, "the stamps of the receiver's speeds are off by {} s", "add it to gnss_speed.time_offset_s"),
)

_ANTENNA = tuple(
    _Scalar(
        column,
        "from the sensor the antenna is {} m further {} than declared",
        "declare lever_arm_m of [imu], or that of [gnss] from the sensor",
        ways=ways,
    )
    for column, ways in enumerate((("ahead", "back"), ("left", "right")))
)

_SCALE_HINT = "multiply wheel_diameter_m, or the column of [tach], by it; near 3.6 or 0.28 its unit is wrong"

_SCALARS: dict[Kind, tuple[_Scalar, ...]] = {
    Kind.MOUNT: tuple(_mounting()),
    Kind.CLOCK: tuple(_clocks()),
    Kind.IMU: tuple(_calibration()),
    Kind.WHEEL: tuple(_wheel()),
    Kind.SENSOR: _FURTHER,
    Kind.ODO: (_Scalar(Odo.SCALE, "the wheel's scale is {}", _SCALE_HINT, origin=1.0),),
}


_MOVES: tuple[tuple[Quantity, ...], ...] = (("level", "alignment"), ("level",), ("alignment",))
"""What the point that follows the track errs by where it is known badly along, across and above: pitch and yaw lift and
shift what is ahead, roll lifts what is beside and shifts what is above."""


def far_point(mount: Array, sd: Array) -> tuple[Doubt, ...]:
    """Return the doubt of a geometry for which a ``mount`` (5,) has the point that follows the track far from where it
    was known to be, to ``sd`` (3,), m. A batch widens the prior instead.
    """
    sigmas = np.abs(mount[2:]) / sd
    far = np.flatnonzero(sigmas > _FAR_SIGMAS)
    if not far.size or (np.abs(mount[2:]) > _FARTHEST[2:]).any():
        return ()
    scalars = _SCALARS[Kind.MOUNT][2:]
    reason = "; ".join(scalars[c].off(float(mount[2 + c]), float(sigmas[c]), float(sd[c])) for c in far.tolist())
    quantities = tuple(dict.fromkeys(quantity for c in far.tolist() for quantity in _MOVES[c]))
    return (Doubt(quantities, np.inf, reason, scalars[0].hint),)


def wide_priors(run: SolvedRun) -> Reassessment:
    """Reassess how well what does not change during a run was known beforehand."""
    problem, any_changed = run.problem, False
    if not run.solution.converged:  # no minimum, no covariance
        return Reassessment(problem)
    findings: list[Finding] = []
    doubts: list[Doubt] = []
    for kind, scalars in _SCALARS.items():
        declared = [family for family in run.declared.families if family.type is FactorType[f"PRIOR_{kind.name}"]]
        now = [family for family in problem.families if family.type is FactorType[f"PRIOR_{kind.name}"]]
        for first, current in zip(declared, now, strict=True):
            judged = _judged(run, kind, first, current)
            prior_sd = first.sigma[0]
            of_it = _of_sensor(problem, current) if kind is Kind.SENSOR else scalars
            columns = {scalar.column: scalar for scalar in of_it if prior_sd[scalar.column] >= scalar.least_sd}
            far = [c for c, scalar in columns.items() if abs(judged.sigmas[c]) > scalar.limit]
            if kind is Kind.MOUNT and not _shows_mounting(run, judged.alone[far], _FARTHEST[far]):
                far = []
            pulled: dict[int, float] = {}
            if kind is Kind.MOUNT and far:
                pull = zip(far, lasting_pull(run, far).tolist(), strict=True)
                pulled = {c: factor for c, factor in pull if factor > FAR_OFF}
                far = [c for c in far if c not in pulled]
                doubts += moving_point(pulled)
            if kind is Kind.IMU and (quiet := without_noise(run, problem, contradicted=bool(far))) is not None:
                any_changed, problem = True, quiet
                continue
            widest = _widest_calibration(run.declared, first) if kind is Kind.IMU else np.full(len(prior_sd), np.inf)
            beyond = np.abs(judged.alone[far]) / np.hypot(widest[far], judged.spread[far])
            possible, impossible = ([columns[c] for c in np.array(far)[some]] for some in (beyond <= 1.0, beyond > 1.0))
            findings += (*_contradictions(kind, judged, possible, prior_sd), *_impossible(judged, impossible))
            doubts += [_unexplained(float(beyond.max()))] if impossible else []
            if kind is Kind.MOUNT:
                findings += _mounting_notes(run, far)
            wanted = np.where(np.abs(judged.sigmas) < _NEAR_SIGMAS, first.sigma, current.sigma)
            wanted[0, far], wanted[0, [*pulled]] = np.abs(judged.alone[far]), prior_sd[[*pulled]]
            if kind is Kind.IMU:
                wanted[0, EARTH] = wanted[0, EARTH].max()  # which way is ahead says nothing
                wanted = np.minimum(wanted, widest)
            # Conventions, and what has no text, are left to other reassessors.
            others = np.setdiff1d(np.arange(wanted.shape[1]), list(columns))
            wanted[0, others] = current.sigma[0, others]
            if np.abs(np.log(wanted / current.sigma)).max() > np.log(LEAST_CHANGE):
                any_changed, problem = True, _with_sigma(problem, current, wanted)
    return Reassessment(problem, tuple(findings), tuple(doubts), changed=any_changed)


def _of_sensor(problem: Problem, prior: Family) -> tuple[_Scalar, ...]:
    """Return the scalars of a prior of a ``SENSOR`` variable: of a receiver's speeds, of its antenna, or of another."""
    for kind, scalars in ((FactorType.GNSS_SPEED, _RECEIVER), (FactorType.GNSS_POSITION, _ANTENNA)):
        family = problem.family(kind)
        last = None if family is None else family.slots[-1]
        if last is not None and last.kind is Kind.SENSOR and last.index[0] == prior.slots[0].index[0]:
            return scalars
    return _FURTHER


def _shows_mounting(run: SolvedRun, far: Array, farthest: Array) -> bool:
    """Return whether the solution may contradict what is known of the mounting, by values ``far`` from it.

    Noise of which there is more than assumed looks like a direction of travel. And a mounting with which the line is
    steeper than any, or that is outside of every vehicle, is wrong itself.
    """
    return not (
        others_are_worse(run.noise_ratios, 1.0) or is_steeper_than_any_line(run) or (np.abs(far) > farthest).any()
    )


def _widest_calibration(declared: Problem, prior: Family) -> Array:
    """Return the largest sigmas (dim,) that the prior of an inertial sensor's calibration may have."""
    widest = CALIBRATION_FACTOR / declared.imu_grade * prior.sigma[0]
    widest[EARTH] = EARTH_RATE
    return np.asarray(widest)


def _unexplained(factor: float) -> Doubt:
    """Return the doubt of attitudes where the calibration would have to be ``factor`` times as far off as it can be.

    What the data hardly determine is counted in the sigma with which they do: that of a few metres of track is wide.
    """
    reason = "no calibration of the inertial sensor explains what it measures: something is not modelled"
    return Doubt(("roll", "pitch", "yaw", "cross_level"), factor, reason, _UNEXPLAINED_HINT)


class _Judged(NamedTuple):
    """The data alone say how far each scalar of a prior is off it, with which sigma, in its unit and in sigmas of what
    was declared.
    """

    alone: Array
    spread: Array
    sigmas: Array


def _judged(run: SolvedRun, kind: Kind, declared: Family, current: Family) -> _Judged:
    off = current.residual(run.solution.states)[0]
    index = int(current.slots[0].index[0])
    whole = run.covariance.of(kind)
    variance = np.diagonal(whole[0])
    if kind is Kind.SENSOR:
        variance = variance[kind.dim * index : kind.dim * (index + 1)]
    alone, variance_alone = prior_left_out(off, variance, current.sigma[0], _LEAST_FREE)
    # Data that scatter by more than assumed say less by as much.
    level = max(1.0, *run.noise_ratios.values()) if run.noise_ratios else 1.0
    spread = level * np.sqrt(variance_alone)
    return _Judged(alone, spread, alone / np.hypot(declared.sigma[0], spread))


def _with_sigma(problem: Problem, prior: Family, sigma: Array) -> Problem:
    def widened(family: Family) -> Family:
        return family.with_sigma(sigma) if family is prior else family

    return replace(problem, families=changed(problem.families, prior.type, widened))


def _contradictions(kind: Kind, judged: _Judged, far: list[_Scalar], sigma: Array) -> list[Finding]:
    """Return one finding for what is far from one prior."""
    if not far:
        return []
    sentence = "; ".join(
        scalar.off(float(judged.alone[scalar.column]), abs(judged.sigmas[scalar.column]), sigma[scalar.column])
        for scalar in far
    )
    hint = "; ".join(dict.fromkeys(scalar.hint for scalar in far))
    return [Finding("warning", f"far-from-prior-{kind.attribute}", f"{sentence}. The data decided", hint=hint)]


def _impossible(judged: _Judged, far: list[_Scalar]) -> Iterator[Finding]:
    """Yield what of a calibration would have to be further off than it can be: its sigma does not follow."""
    for scalar in far:
        message = f"by the data alone {scalar.described(float(judged.alone[scalar.column]))}, more than it can be"
        yield Finding(
            "warning", "calibration-impossible", f"{message}: something is not modelled", hint=_UNEXPLAINED_HINT
        )


def _mounting_notes(run: SolvedRun, far: list[int]) -> Iterator[Finding]:
    """Yield how the sensor is mounted, where that is well determined, worth a line and not ``far``."""
    mount, sd = run.solution.states.mount[0], np.sqrt(np.diagonal(run.covariance.of(Kind.MOUNT)[0]))
    notable = (np.abs(mount) > _FAR_SIGMAS * sd) & (np.abs(mount) > _WORTH_A_LINE)
    notable[far] = False
    sentences = [
        scalar.described(float(mount[scalar.column])) for scalar in _SCALARS[Kind.MOUNT] if notable[scalar.column]
    ]
    if sentences:
        to_vehicle = mount_matrix(mount[None])[0].T
        turn, place = np.degrees(rpy_from_matrix(to_vehicle[None])[0]), -to_vehicle @ mount[2:]
        declared = {"mount_rpy_deg": (turn, 2, notable[:2]), "lever_arm_m": (place, 1, notable[2:])}
        keys = (
            f"{key} = [{', '.join(f'{x:.{digits}f}' for x in values)}]"
            for key, (values, digits, noted) in declared.items()
            if noted.any()
        )
        hint = f"where [imu] declares nothing: {', '.join(keys)}; else change what it declares by as much"
        yield Finding("info", "mounting", "; ".join(sentences) + " (estimated)", hint=hint)
