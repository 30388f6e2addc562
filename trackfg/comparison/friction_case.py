"""The cases of tyre friction: a car on a road, no recording of a railway, with estimators of their own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import pandas as pd

from trackfg.comparison.case import Case, CaseRun, Progress, joined, run_all, score_table, with_first_column
from trackfg.comparison.estimators import MIYATA, SMOOTHER
from trackfg.datasets.j_turn import JTurn, j_turn
from trackfg.evaluation.scores import score_run
from trackfg.friction import imm_ekf
from trackfg.friction.smoother import smooth_friction

FRICTION_DRIVES: dict[str, tuple[Callable[[int], JTurn], str]] = {
    "j-turn": (j_turn, "a car's J-turn on a road that becomes slippery"),
}
"""By name: the drive of a seed, and a line on it."""


@dataclass(frozen=True)
class FrictionEstimator:
    """``run``: a drive (:data:`trackfg.friction.bicycle.DRIVE_COLUMNS`) in, a table with
    :data:`trackfg.friction.bicycle.FRICTION_COLUMNS` out.
    """

    title: str
    source: str
    run: Callable[[pd.DataFrame], pd.DataFrame]


def friction_estimators() -> dict[str, FrictionEstimator]:
    """Return the estimators of a car's slip angle and tyre friction, the smoother first."""

    def filtered(drive: pd.DataFrame, modes: int) -> pd.DataFrame:
        return imm_ekf.run(drive, modes=modes).table

    filters = {
        f"imm-{modes}": FrictionEstimator(f"IMM-EKF of {modes} modes", MIYATA, partial(filtered, modes=modes))
        for modes in (3, 7, 10)
    }
    return {SMOOTHER: FrictionEstimator("factor-graph smoother", "trackfg", smooth_friction), **filters}


def run_friction_case(case: Case, *, show: Progress) -> CaseRun:
    """Run every friction estimator on a drive and score it."""
    simulate, summary = FRICTION_DRIVES[case.name]
    drive = simulate(case.seed)
    runs = {name: one.run for name, one in friction_estimators().items()}
    estimates, seconds, left_out = run_all(runs, drive.measured, show)
    true, t = drive.truth, drive.truth["t_s"].to_numpy()
    distance = 1e-3 * drive.distance_m
    scores, positions = [], []
    for name, estimate in estimates.items():
        errors = pd.DataFrame(
            {
                "t_s": t,
                "slip_angle_mrad": 1e3 * (estimate["slip_angle_rad"] - true["slip_angle_rad"]),
                "slip_angle_mrad_sd": 1e3 * estimate["slip_angle_rad_sd"],
                "friction": estimate["friction"] - true["friction"],
                "friction_sd": estimate["friction_sd"],
            }
        )
        scores.append(with_first_column("estimator", name, score_run(errors, band_kmh=None)))
        positions.append(with_first_column("estimator", name, errors))
    return CaseRun(
        case,
        summary,
        float(t[-1] - t[0]),
        distance,
        "truth",
        seconds,
        left_out,
        score_table(case, joined(scores), seconds, distance),
        positions=with_first_column("case", case.name, joined(positions)),
    )
