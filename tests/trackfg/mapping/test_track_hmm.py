"""Which track a run is on, with drawn errors: no smoother, networks and runs from closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from trackfg.mapping.recognition.track_hmm import LineError, Points, TrackPosterior, track_posterior
from trackfg.recording.track_joints import joined
from trackfg.recording.track_network import Feet, TrackNetwork

APART_M = 4.5
ERROR = LineError(1.5, 5000.0)
TWO = joined(("A", "B"), tuple(np.array([[-100.0, y], [5000.0, y]]) for y in (0.0, APART_M)), None)


def posterior(network: TrackNetwork, place: np.ndarray, sd: float, correlation: float) -> tuple[Feet, TrackPosterior]:
    n = len(place)
    feet = network.feet(place, np.full(n, 30.0))
    covariance = np.tile(sd**2 * np.eye(2), (n, 1, 1))
    return feet, track_posterior(Points(place, covariance, correlation * covariance[1:]), feet, network, ERROR)


def driven(rng: np.random.Generator, sd: float, correlation: float, n: int = 40) -> np.ndarray:
    """Return points 25 m apart on track A, with errors that last."""
    error = rng.normal(scale=sd, size=(n, 2))
    for k in range(1, n):
        error[k] = correlation * error[k - 1] + np.sqrt(1.0 - correlation**2) * error[k]
    return np.column_stack([25.0 * np.arange(n), np.zeros(n)]) + error


def named(network: TrackNetwork, feet: Feet, found: TrackPosterior, j: int = -1) -> str:
    return network.track[feet.piece[found.row[j]]] if found.right[j] >= 0.95 else ""


@pytest.mark.parametrize(("sd", "correlation"), [(0.3, 0.9), (1.0, 0.97), (2.0, 0.99), (5.0, 0.995)])
def test_a_track_that_is_named_is_the_right_one(sd: float, correlation: float) -> None:
    """Errors of the run and of the line are drawn as the model has them: of those named 95 % are right."""
    rng = np.random.default_rng(0)
    names = []
    for _ in range(24):
        of_line = np.array([0.0, ERROR.sd_m * rng.normal()])
        place = driven(rng, sd, correlation) + of_line
        feet, found = posterior(TWO, place, sd, correlation)
        names.append(named(TWO, feet, found))
    assert names.count("B") <= 2
    if sd == 5.0:
        assert names.count("") > 20
    if sd == 0.3:
        assert names.count("A") > 8


def test_an_exact_line_and_good_positions_name_the_track() -> None:
    rng = np.random.default_rng(1)
    names = []
    for _ in range(10):
        feet, found = posterior(TWO, driven(rng, 0.2, 0.9), 0.2, 0.9)
        names.append(named(TWO, feet, found))
    assert set(names) == {"A"}


def test_the_leg_of_a_switch_is_found_by_shape_where_the_place_is_not() -> None:
    """A run of a wrong constant offset of 3 m, where the sigma is 4 m, over a turnout to the left."""
    x = np.array([1000.0, 1050.0, 1100.0])
    branch = np.column_stack([np.append(x, 3000.0), [0.0, 1.0, 5.0, 100.0]])
    network = joined(("main", "branch"), (np.array([[-100.0, 0.0], [3000.0, 0.0]]), branch), None)
    along = 25.0 * np.arange(80)
    left = np.column_stack([along, np.interp(along, *branch.T) - 3.0])
    feet, found = posterior(network, left, 4.0, 0.9999)
    assert network.track[feet.piece[found.row[20]]] == "main"
    assert network.track[feet.piece[found.row[-1]]] == "branch"
    assert found.right[-1] > 0.9
    feet, found = posterior(network, np.column_stack([along, np.full(80, 3.0)]), 4.0, 0.9999)
    assert network.track[feet.piece[found.row[-1]]] == "main"
    assert found.of_track[-1].get("branch", 0.0) < 0.05


def test_a_run_that_turns_back_over_a_switch_is_on_its_other_leg() -> None:
    branch = np.array([[1000.0, 0.0], [900.0, 6.0], [0.0, 40.0]])
    network = joined(("main", "back"), (np.array([[-100.0, 0.0], [3000.0, 0.0]]), branch), None)
    forth = np.column_stack([np.arange(500.0, 1076.0, 25.0), np.zeros(24)])
    x = np.arange(1050.0, 499.0, -25.0)
    back = np.column_stack([x, np.interp(x, branch[::-1, 0], branch[::-1, 1])])
    feet, found = posterior(network, np.concatenate([forth, back]), 0.3, 0.9)
    names = [network.track[feet.piece[row]] for row in found.row]
    assert names[10] == "main"
    assert names[-1] == "back"
    assert found.right[-1] > 0.95


def test_a_constant_error_counts_once() -> None:
    """A run 1.5 m to the side of B is as undecided after 3 km as after 100 m, if its errors last."""
    place = np.column_stack([25.0 * np.arange(120), np.full(120, 1.5)])
    short = posterior(TWO, place[:5], 2.0, 1.0 - 1e-6)[1].of_track[-1]["A"]
    long = posterior(TWO, place, 2.0, 1.0 - 1e-6)[1].of_track[-1]["A"]
    assert abs(short - long) < 0.1
    assert 0.5 < long < 0.95


def test_no_track_is_near() -> None:
    place = np.column_stack([25.0 * np.arange(10), np.full(10, 500.0)])
    found = posterior(TWO, place, 1.0, 0.9)[1]
    np.testing.assert_array_equal(found.row, -1)
    np.testing.assert_allclose(found.absent, 1.0)
