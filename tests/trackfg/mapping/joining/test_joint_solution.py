"""Runs condensed to what they say of the anchors, against the joint graph of all their states."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.linalg import block_diag, solve_triangular

from trackfg.datasets.scenarios import Simulation
from trackfg.factors.states import KEYFRAME_DIM, SHARED_DIM
from trackfg.mapping.joining.anchors import (
    _LEAST_SD_M,
    _LEAST_SD_MM,
    Sensor,
    Sightings,
    chainage_variable,
    cross_level_variable,
    information_on_anchors,
    roll_variable,
    sighted_values,
    with_roll_prior,
)
from trackfg.mapping.joining.joint_solution import joint_solution
from trackfg.numerics.arrays import Array
from trackfg.output.place_covariance import place_functions
from trackfg.output.trajectory import keyframe_jacobian
from trackfg.results.place_covariance import PlaceCovariance
from trackfg.smoothing.smoother import SmoothedStates
from trackfg.solver.square_root import SIZE, SquareRoot

BASE_M = 1.067
ANCHORS = ("75", "100", "150", "200")


def dense(root: SquareRoot) -> Array:
    """All conditionals of a chain as one square matrix."""
    n = len(root.R)
    R = np.zeros((n * KEYFRAME_DIM + SHARED_DIM,) * 2)
    shared = slice(n * KEYFRAME_DIM, None)
    for k in range(n):
        rows = slice(k * KEYFRAME_DIM, (k + 1) * KEYFRAME_DIM)
        R[rows, rows] = root.R[k]
        if k + 1 < n:
            R[rows, rows.stop : rows.stop + KEYFRAME_DIM] = root.S[k, :, :KEYFRAME_DIM]
        R[rows, shared] = root.S[k, :, KEYFRAME_DIM:SIZE]
    R[shared, shared] = root.R_shared
    return R


def rows_at(run: SmoothedStates, direction: int, places: Array) -> Array:
    """Derivatives of chainage (m) and cross-level (mm) at places by all states: (2 p, states)."""
    states = run.solution.states
    D = direction * states.odo.distance
    moving = np.flatnonzero(np.diff(D) != 0.0)
    k = moving[np.searchsorted(np.sort(D[moving + 1]), places)]
    f = (places - D[k]) / (D[k + 1] - D[k])
    jacobian = keyframe_jacobian(states, run.problem.run.lever_arm)[:, [0, 5]]
    functions = place_functions(jacobian * np.array([direction, direction * 1e3 * BASE_M])[:, None], k, f)
    n = len(states)
    rows = np.zeros((2 * len(places), n * KEYFRAME_DIM + SHARED_DIM))
    for row, at, one, two, shared in zip(
        rows, functions.keyframe, functions.by_first, functions.by_second, functions.by_shared, strict=True
    ):
        row[at * KEYFRAME_DIM : (at + 2) * KEYFRAME_DIM] = np.concatenate([one, two])
        row[-SHARED_DIM:] = shared
    return np.concatenate([rows[0::2], rows[1::2]])


@pytest.mark.parametrize("anchored", [True, False])
def test_condensed_runs_give_what_the_full_joint_graph_gives(
    simulated: Callable[..., Simulation], smoothed: Callable[..., SmoothedStates], anchored: bool
) -> None:
    rng = np.random.default_rng(3)
    places = np.array([float(anchor) for anchor in ANCHORS])
    m = len(places)
    match_sd, mount_sd = np.full(m, 0.03), 1e-3
    said, systems, right = [], [], []
    size_of_map = 2 * m + 1 + (0 if anchored else 2)
    for number in range(2):
        run = smoothed("mainline", seed=4 + number, duration_s=55.0)
        direction = 1 if number == 0 else -1
        rows = rows_at(run, 1, places)
        rows[m:] *= direction
        root = dense(run.solution.root)
        scaled = solve_triangular(root, rows.T, trans=1)
        covariance = scaled.T @ scaled
        seen = Sightings(ANCHORS, places + rng.normal(0.0, 0.2, m), match_sd, rng.normal(0.0, 1.0, m))
        sensor, errors = Sensor("one", direction * BASE_M), PlaceCovariance.of(seen.chainage_m, covariance)
        information = information_on_anchors(f"run{number}", seen, errors, sensor, anchored=anchored)
        said.append(with_roll_prior(information, "one", mount_sd) if number == 0 else information)
        # The joint graph: this run's states about their estimates, as u = R x lest rows of all sizes lose digits, then
        # M, C, roll and the runs' offsets.
        noise = np.r_[np.hypot(match_sd, _LEAST_SD_M), np.full(m, _LEAST_SD_MM)]
        of_map = np.zeros((2 * m, size_of_map))
        of_map[:, : 2 * m] = np.eye(2 * m)
        of_map[m:, 2 * m] = direction * BASE_M
        if not anchored:
            of_map[:m, 2 * m + 1 + number] = -1.0
        systems.append((np.eye(len(root)), -scaled.T / noise[:, None], of_map / noise[:, None]))
        right.append(np.r_[seen.chainage_m, seen.cross_level_mm] / noise)
    states = block_diag(*(np.vstack([root, own]) for root, own, _ in systems))
    of_map = np.vstack([np.vstack([np.zeros((len(root), size_of_map)), part]) for root, _, part in systems])
    rhs = np.concatenate([np.r_[np.zeros(len(s[0])), r] for s, r in zip(systems, right, strict=True)])
    extra = np.zeros((1 if anchored else 2, states.shape[1] + size_of_map))
    extra[0, states.shape[1] + 2 * m] = 1e-3 / mount_sd
    if not anchored:
        extra[1, states.shape[1] + 2 * m + 1] = 1e3
    A = np.vstack([np.hstack([states, of_map]), extra])
    b = np.r_[rhs, np.zeros(len(extra))]
    R = np.linalg.qr(np.column_stack([A, b]), mode="r")
    tail = slice(states.shape[1], A.shape[1])
    inverse = np.linalg.inv(R[tail, tail])
    expected, spread = inverse @ R[tail, -1], inverse @ inverse.T

    joint = joint_solution(said)
    names = [chainage_variable(anchor) for anchor in ANCHORS] + [cross_level_variable(anchor) for anchor in ANCHORS]
    rows_of = joint.rows([*names, roll_variable("one")])
    sd = np.sqrt(np.diag(spread))[: 2 * m + 1]
    assert np.abs((joint.x[rows_of] - expected[: 2 * m + 1]) / sd).max() < 1e-4
    ours = joint.covariance[np.ix_(rows_of, rows_of)]
    assert np.abs((ours - spread[: 2 * m + 1, : 2 * m + 1]) / np.outer(sd, sd)).max() < 1e-4


def test_both_directions_separate_the_sensors_roll_from_the_tracks_cross_level() -> None:
    places, roll_mrad = np.arange(0.0, 1001.0, 250.0), 1.3
    true = np.array([0.0, 2.0, -1.0, 50.0, 3.0])
    errors = PlaceCovariance.of(places, np.diag(np.r_[np.full(5, 0.1**2), np.full(5, 0.05**2)]))
    said = []
    for number, direction in enumerate((1, -1, 1, -1)):
        seen = Sightings(tuple("abcde"), places, np.full(5, 0.01), true + direction * BASE_M * roll_mrad)
        sensor = Sensor("one", direction * BASE_M)
        said.append(information_on_anchors(f"run{number}", seen, errors, sensor, anchored=True))
    said[0] = with_roll_prior(said[0], "one", 2e-3)
    joint = joint_solution(said)
    row = joint.index[roll_variable("one")]
    assert abs(joint.x[row] - roll_mrad) < 0.01
    assert np.sqrt(joint.covariance[row, row]) < 0.02
    assert np.abs(joint.x[joint.rows([cross_level_variable(anchor) for anchor in "abcde"])] - true).max() < 0.01
    one_way = joint_solution([said[0]])
    row = one_way.index[roll_variable("one")]
    assert np.sqrt(one_way.covariance[row, row]) > 1.9


def test_a_run_without_any_fix_is_placed_by_the_others() -> None:
    places = np.array([0.0, 250.0, 500.0])
    errors = PlaceCovariance.of(places, np.diag(np.r_[np.full(3, 0.1**2), np.full(3, 0.05**2)]))
    sensor = Sensor("one", BASE_M)
    level = np.full(3, np.nan)
    anchored = information_on_anchors(
        "a", Sightings(("0", "1", "2"), places, np.zeros(3), level), errors, sensor, anchored=True
    )
    lost = information_on_anchors(
        "b", Sightings(("0", "1", "2"), places - 777.0, np.full(3, 0.01), level), errors, sensor, anchored=False
    )
    joint = joint_solution([anchored, lost])
    assert abs(joint.x[joint.index["run/b/offset_m"]] - 777.0) < 1e-9
    alone = joint_solution([lost])
    assert abs(alone.x[alone.index["run/b/offset_m"]]) < 1e-9
    assert abs(alone.x[alone.index[chainage_variable("0")]] + 777.0) < 1e-6


def test_what_a_run_said_is_read_back() -> None:
    places = np.array([0.0, 250.0, 500.0])
    level = np.array([1.0, np.nan, 3.0])
    errors = PlaceCovariance.of(places, np.diag(np.r_[np.full(3, 0.1**2), np.full(3, 0.05**2)]))
    sensor = Sensor("s", BASE_M)
    said = information_on_anchors(
        "a", Sightings(("0", "1", "2"), places, np.zeros(3), level), errors, sensor, anchored=False
    )
    own = sighted_values(with_roll_prior(said, "s", 1e-3))
    assert list(own.index) == [
        "mark/0/chainage_m", "mark/1/chainage_m", "mark/2/chainage_m", "mark/0/cross_level_mm", "mark/2/cross_level_mm",
    ]  # fmt: skip
    np.testing.assert_allclose(own.to_numpy(), [0.0, 250.0, 500.0, 1.0, 3.0], atol=1e-9)
