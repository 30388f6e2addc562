"""The joint covariance of chainage and cross-level errors (:mod:`trackfg.results.place_covariance`) of a solved
graph.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackfg.factors.states import KEYFRAME_DIM, States
from trackfg.graph.run_context import RunContext
from trackfg.numerics.arrays import Array
from trackfg.output.profiles import Profile
from trackfg.output.trajectory import QUANTITIES, keyframe_jacobian
from trackfg.results.place_covariance import APART_M, PlaceCovariance
from trackfg.solver.covariance import Covariance, Functions, joint_covariance
from trackfg.solver.square_root import SquareRoot

_ROWS = [QUANTITIES.index(name) for name in ("chainage_m", "roll_rad")]


def place_covariance(
    run: RunContext,
    passes: Sequence[Profile],
    states: States,
    root: SquareRoot,
    covariance: Covariance,
) -> PlaceCovariance:
    """Return the covariance at whole multiples of :data:`APART_M` and at the ends of the passes.

    Where a place was passed more than once, the longest pass counts, as in the geometry table.
    """
    step_m = run.conventions.step_m
    cell, keyframe, fraction = _places(passes, round(APART_M / step_m))
    if not len(cell):
        return PlaceCovariance.none()
    order = np.argsort(keyframe, kind="stable")
    facing = run.direction * np.array([1.0, 1e3 * run.conventions.cross_level_base_m])
    rows = keyframe_jacobian(states, run.lever_arm)[:, _ROWS] * facing[:, None]
    errors = joint_covariance(root, place_functions(rows, keyframe[order], fraction[order]), covariance)
    return PlaceCovariance.in_order_of_time(cell[order] * step_m, errors)


def place_functions(rows: Array, keyframe: np.ndarray, fraction: Array) -> Functions:
    """Return quantities between keyframes (m,) and their next, linear in time, from rows (n, q, d) at the keyframes.

    They are in order of the places: all of the first place, then of the next.
    """
    quantities, f = rows.shape[1], fraction[:, None, None]
    first, second = (1.0 - f) * rows[keyframe], f * rows[keyframe + 1]
    return Functions(
        keyframe=np.repeat(keyframe, quantities),
        by_first=first[:, :, :KEYFRAME_DIM].reshape(-1, KEYFRAME_DIM),
        by_second=second[:, :, :KEYFRAME_DIM].reshape(-1, KEYFRAME_DIM),
        by_shared=(first + second)[:, :, KEYFRAME_DIM:].reshape(quantities * len(keyframe), -1),
    )


def _places(passes: Sequence[Profile], apart: int) -> tuple[Array, np.ndarray, Array]:
    """Return the cells of the places, the keyframe before each and the share of the time to the next. Each (p,)."""
    cell, when = np.zeros(0), np.zeros(0)
    keyframe = np.zeros(0, dtype=np.int64)
    for profile in sorted(passes, key=len, reverse=True):
        chosen = np.flatnonzero((profile.cell % apart == 0) | np.isin(profile.cell, profile.cell[[0, -1]]))
        chosen = chosen[~np.isin(profile.cell[chosen], cell)]
        cell = np.concatenate([cell, profile.cell[chosen]])
        keyframe = np.concatenate([keyframe, profile.keyframe[chosen]])
        when = np.concatenate([when, profile.fraction[chosen]])
    return cell, keyframe, when
