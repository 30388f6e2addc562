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
from trackfg.solver.covariance import Functions
from trackfg.solver.influence import GroupRows, Misfit, all_rows, gains, misfits
from trackfg.solver.leave_one_out import left_out
from trackfg.solver.prediction_level import Level, level

_PLACES = 8
"""Keyframes, evenly spread over the run, at which each quantity is judged."""

_AT_A_TIME = 512
"""Keyframes whose gains are made at a time: of 88 functions 7 MB, which stay in the processor's cache."""

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
    """A run's test of its own residuals: doubts, and what tests each quantity."""

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
        tested = tuple(_NAMES[misfit.group] for misfit in group_misfits if misfit.share > _LEAST_SHARE)
        for quantity in function.quantities:
            if factor > (worst[quantity].factor if quantity in worst else _LEAST_WIDENING):
                worst[quantity] = _doubt(quantity, factor, max(causes, key=lambda cause: cause.share * cause.ratio))
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
    return [cause for misfit in of_groups if (cause := _cause(misfit, levels.get(misfit.group)))]


def widening(causes: Sequence[Cause]) -> float:
    """Return k, by which these causes make a sigma too small."""
    return math.sqrt(1.0 + sum(cause.share * (cause.ratio - 1.0) for cause in causes))


def _found(run: SolvedRun, rows: list[GroupRows], blocks: list[np.ndarray]) -> Iterator[tuple[_Function, list[Misfit]]]:
    """Yield each function and its misfits."""
    reach = max(group_rows.reach for group_rows in rows)
    gain = gains(run.solution.root, _functions(run), _ends(blocks), reach)
    yield from zip(_FUNCTIONS, misfits(rows, gain, blocks, len(_FUNCTIONS)), strict=True)


def _ends(blocks: list[np.ndarray]) -> list[int]:
    """Return where parts of some :data:`_AT_A_TIME` keyframes end that cut no block of time in two."""
    cuts = np.flatnonzero(np.all(np.diff(blocks, axis=1), axis=0)) + 1
    last = len(blocks[0])
    wanted = np.arange(_AT_A_TIME, last - _AT_A_TIME // 2, _AT_A_TIME)
    at = np.searchsorted(cuts, wanted)
    return [*np.unique(cuts[at[at < len(cuts)]]).tolist(), last]


def _levels(run: SolvedRun) -> Iterator[tuple[str, Level]]:
    for kind, (group, _) in _PREDICTED.items():
        family = run.problem.family(kind)
        if family is not None:
            prediction = left_out(family, run.solution.states, run.covariance)
            yield group, level(prediction.in_sigmas(family.sigma))


def _functions(run: SolvedRun) -> Functions:
    """Return each of the functions at some keyframes, one per place, function by function."""
    states, shared = run.solution.states, run.solution.root.size - KEYFRAME_DIM
    n = len(states)
    at = np.unique(np.linspace(0, n - 1, _PLACES + 2).astype(np.int64)[1:-1])
    ends = (at, np.minimum(at + 1, n - 1))
    at_first, at_second = (keyframe_jacobian(states.take(k), run.problem.run.lever_arm) for k in ends)
    shape = (len(_FUNCTIONS), len(at))
    by_first, by_second = np.zeros((2, *shape, KEYFRAME_DIM))
    by_shared = np.zeros((*shape, shared))
    for i, function in enumerate(_FUNCTIONS):
        column = QUANTITIES.index(function.column)
        for J, by, sign in ((at_first, by_first, 1.0), (at_second, by_second, -1.0))[: 1 + function.change]:
            by[i] = sign * J[:, column, :KEYFRAME_DIM]
            by_shared[i, :, : J.shape[2] - KEYFRAME_DIM] += sign * J[:, column, KEYFRAME_DIM:]
    keyframe = np.tile(at, len(_FUNCTIONS))
    return Functions(keyframe, *(by.reshape(len(keyframe), -1) for by in (by_first, by_second, by_shared)))


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
