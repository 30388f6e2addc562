"""Residuals of one solution say by how much the sigmas of each quantity are too small.

The variance of a quantity is the sum of what each group of measurements contributes. Where the residuals of a group
account for more than the model expects (:mod:`trackfg.solver.influence`), its share is multiplied by as much:

    k^2 = 1 + sum over groups of share (ratio - 1)

Levels that are wrong show from keyframe to keyframe, errors that last over longer blocks. Positions that the other
measurements do not predict within their sigmas (:mod:`trackfg.solver.leave_one_out`) concern chainage and position
directly.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from trackfg.factors.factor_type import FactorType
from trackfg.factors.states import KEYFRAME_DIM
from trackfg.numerics.arrays import Array
from trackfg.numerics.chi_square import exceeds_chance
from trackfg.output.trajectory import QUANTITIES, keyframe_jacobian
from trackfg.results.verdict import Doubt, Quantity
from trackfg.smoothing.reassessment import SolvedRun
from trackfg.solver.influence import Columns, GroupRows, Misfit, all_rows, gains, misfits
from trackfg.solver.leave_one_out import left_out
from trackfg.solver.prediction_level import Level, level

_PLACES = 8
"""Keyframes, evenly spread over the run, at which each quantity is judged."""

_DOUBLE = 8
_MOST_BYTES = 64_000_000
"""Of the gains of functions that are judged together: those of all for an hour of a keyframe per second."""

_BLOCKS_S = (0.0, 10.0, 60.0)
"""Blocks over which residuals are summed, s: single keyframes, what lasts some seconds, and what lasts a minute."""

_CHANCE = 1e-4
"""Probability of a misfit by chance below which it is a doubt: there are some hundred tests of one run."""

_LEAST_WIDENING = 1.1
"""Factors below this are none: sigmas of the geometry, which are drawn, are not known better."""

_MODEL_FAILS = 10.0
"""From this factor on no sigma is right: the recording is not what the model describes."""

_LEAST_SHARE = 0.03
"""A group that contributes less to the variance of a quantity does not test it."""


class _Function(NamedTuple):
    """A column of the trajectory that stands for quantities; ``change``: its change from keyframe to keyframe, which is
    what quantities on a few metres of track depend on.
    """

    column: str
    change: bool
    quantities: tuple[Quantity, ...]


_FUNCTIONS = (
    _Function("chainage_m", False, ("chainage",)),
    _Function("east_m", False, ("position",)),
    _Function("north_m", False, ("position",)),
    _Function("up_m", False, ("height",)),
    _Function("speed_mps", False, ("speed",)),
    _Function("roll_rad", False, ("roll", "cross_level")),
    _Function("pitch_rad", False, ("pitch", "gradient")),
    _Function("yaw_rad", False, ("yaw",)),
    _Function("roll_rad", True, ("twist",)),
    _Function("pitch_rad", True, ("level",)),
    _Function("yaw_rad", True, ("alignment", "curvature")),
)

_NAMES = {
    "gyro": "the gyro",
    "accel": "the accelerometer",
    "motion": "motion along the track",
    "path": "the path between keyframes",
    "tach": "the tachometer",
    "speed": "the speed sensor",
    "fixes": "the fixes",
    "map": "the map",
    "gnss": "the GNSS positions",
    "gnss speed": "the receiver's speeds",
    "biases": "the walk of the biases",
    "rests": "the rests",
    "bias prior": "the biases",
    "calibration prior": "the calibration of the IMU",
    "mounting prior": "the mounting",
    "wheel prior": "the wheel's place and creep",
    "sensor prior": "the further sensors",
}

_HINTS = {
    "gyro": "declare the noise that is there ([imu.noise]), or mount the sensor where it shakes less",
    "accel": "declare the noise that is there ([imu.noise]), or mount the sensor where it shakes less",
    "motion": "survey lever arm and mounting angles; declare rigid = false for a body on springs",
    "path": "declare rigid = false for a sensor on springs",
    "tach": "look at slips and gaps of the wheel; add fixes or GNSS",
    "speed": "check scale and mounting of the speed sensor",
    "fixes": "check the chainages of the fixes, or declare the sigma that they have",
    "map": "check that the map is of this track",
    "gnss": "check gnss.lever_arm_m; declare the sigma that the positions have, and position.gnss_correlation_s",
    "gnss speed": "check unit, clock and sigmas of [gnss_speed]",
    "biases": "declare the instability of the biases ([imu.noise]); let the sensor warm up",
    "rests": "look at the standstills among the events",
    "bias prior": "declare the grade of the sensor ([imu.noise]: gyro_bias_sd, accel_bias_sd)",
    "calibration prior": "declare how well the IMU is calibrated ([imu.noise]), and check its axes (trackfg check)",
    "mounting prior": "survey how the sensor is mounted, or raise motion.mount_sd_deg",
    "wheel prior": "check where the wheel is, and what the tachometer counts",
    "sensor prior": "check scale and mounting of the further sensors",
}

_PREDICTED: dict[FactorType, tuple[str, tuple[Quantity, ...]]] = {
    FactorType.ABSOLUTE_FIX: ("fixes", ("chainage",)),
    FactorType.GNSS_POSITION: ("gnss", ("position", "height", "chainage")),
    FactorType.GNSS_SPEED: ("gnss speed", ("speed", "chainage")),
}
"""Positions and speeds that are predicted from all else: their group, and the quantities that they concern."""


@dataclass(frozen=True)
class SelfTest:
    """What a run's residuals say: doubts, and what tests each quantity."""

    doubts: tuple[Doubt, ...]
    checked_by: Mapping[Quantity, tuple[str, ...]]


class Cause(NamedTuple):
    """A group whose residuals are too large: by what factor its variance should be multiplied."""

    group: str
    share: float
    ratio: float
    block_s: float


def self_test(run: SolvedRun) -> SelfTest:
    """Return what the residuals of a solved run say of its sigmas."""
    levels = dict(_levels(run))
    rows = all_rows(run.problem, run.solution, np.random.default_rng(0))
    blocks = blocks_of_time(run.problem.t)
    worst: dict[Quantity, Doubt] = {}
    checked: dict[Quantity, tuple[str, ...]] = {}
    for function, group_misfits in _found(run, rows, blocks):
        causes = causes_of(group_misfits, levels)
        factor = widening(causes)
        tested = tuple(_NAMES[one.group] for one in group_misfits if one.share > _LEAST_SHARE)
        for quantity in function.quantities:
            if factor > (worst[quantity].factor if quantity in worst else _LEAST_WIDENING):
                worst[quantity] = _doubt(quantity, factor, max(causes, key=lambda one: one.share * one.ratio))
            checked[quantity] = tuple(dict.fromkeys((*checked.get(quantity, ()), *tested)))
    for group, quantities in _PREDICTED.values():
        score = levels.get(group)
        if score is None:
            continue
        for quantity in quantities:
            checked[quantity] = (*checked[quantity], f"{score.number} predictions of {_NAMES[group]}")
            if score.far and score.ratio > (worst[quantity].factor if quantity in worst else _LEAST_WIDENING):
                worst[quantity] = Doubt((quantity,), _or_lost(score.ratio), _missed(group, score), _HINTS[group])
    return SelfTest(tuple(worst.values()), checked)


def blocks_of_time(t: Array) -> list[np.ndarray]:
    """Return the divisions of the keyframes' times (n,), s, over whose blocks residuals are summed."""
    return [np.arange(len(t)) if s == 0.0 else ((t - t[0]) // s).astype(np.int64) for s in _BLOCKS_S]


def causes_of(of_groups: Sequence[Misfit], levels: Mapping[str, Level]) -> list[Cause]:
    """Return the groups whose residuals are too large, by their misfits and by the ``levels`` of what is predicted."""
    return [cause for one in of_groups if (cause := _cause(one, levels.get(one.group)))]


def widening(causes: Sequence[Cause]) -> float:
    """Return k, by which these causes make a sigma too small."""
    return math.sqrt(1.0 + sum(cause.share * (cause.ratio - 1.0) for cause in causes))


def _found(run: SolvedRun, rows: list[GroupRows], blocks: list[np.ndarray]) -> Iterator[tuple[_Function, list[Misfit]]]:
    """Yield each function and its misfits, as many functions at a time as keep the memory of a long run small."""
    of_function = _DOUBLE * KEYFRAME_DIM * _PLACES * len(run.problem.t)
    at_a_time = max(1, _MOST_BYTES // of_function)
    for begin in range(0, len(_FUNCTIONS), at_a_time):
        functions = _FUNCTIONS[begin : begin + at_a_time]
        gain = gains(run.solution.root, _columns(run, functions))
        yield from zip(functions, misfits(rows, gain, blocks, len(functions)), strict=True)


def _levels(run: SolvedRun) -> Iterator[tuple[str, Level]]:
    for kind, (group, _) in _PREDICTED.items():
        family = run.problem.family(kind)
        if family is not None:
            prediction = left_out(family, run.solution.states, run.covariance)
            yield group, level(prediction.in_sigmas(family.sigma))


def _columns(run: SolvedRun, functions: Sequence[_Function]) -> Columns:
    """Return each of the functions at some keyframes as columns, one per place, function by function."""
    states, size = run.solution.states, run.solution.root.size
    n = len(states)
    at = np.unique(np.linspace(0, n - 1, _PLACES + 2).astype(np.int64)[1:-1])
    ends = [
        (k, sign * keyframe_jacobian(states.take(k), run.problem.run.lever_arm))
        for k, sign in ((at, 1.0), (np.minimum(at + 1, n - 1), -1.0))
    ]
    count = len(functions) * len(at)
    columns = Columns(np.zeros((n, KEYFRAME_DIM, count)), np.zeros((size - KEYFRAME_DIM, count)))
    for column, function in zip(np.arange(count).reshape(len(functions), -1), functions, strict=True):
        for k, J in ends if function.change else ends[:1]:
            row = J[:, QUANTITIES.index(function.column)]
            columns.keyframes[k, :, column] += row[:, :KEYFRAME_DIM]
            columns.shared[: J.shape[2] - KEYFRAME_DIM, column] += row[:, KEYFRAME_DIM:].T
    return columns


def _cause(misfit: Misfit, predicted: Level | None) -> Cause | None:
    """Return by how much a group's errors are larger than the model has them; None where that may be chance."""
    far = exceeds_chance(misfit.ratio, misfit.degrees, _CHANCE)
    ratios = np.where(far, misfit.ratio, 1.0)
    ratio, block_s = float(ratios.max()), _BLOCKS_S[int(ratios.argmax())]
    if predicted is not None and predicted.far and predicted.ratio**2 > ratio:
        ratio, block_s = predicted.ratio**2, 0.0
    return Cause(misfit.group, misfit.share, ratio, block_s) if ratio > 1.0 else None


def _doubt(quantity: Quantity, factor: float, cause: Cause) -> Doubt:
    over = f", summed over {cause.block_s:g} s," if cause.block_s else ""
    reason = f"residuals of {_NAMES[cause.group]}{over} are {cause.ratio**0.5:.2g} times what is expected of them"
    return Doubt((quantity,), _or_lost(factor), reason, _HINTS[cause.group])


def _missed(group: str, score: Level) -> str:
    return f"{_NAMES[group]} differ from what all else predicts by {score.ratio:.2g} times the sigmas"


def _or_lost(factor: float) -> float:
    return factor if factor < _MODEL_FAILS else math.inf
