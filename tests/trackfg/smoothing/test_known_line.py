"""A run over a crossover between two parallel tracks, with networks made from closed forms in this file."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trackfg.config import SmoothConfig
from trackfg.datasets.line.line_file import read_line_file
from trackfg.datasets.scenarios import scenario, simulate
from trackfg.errors import BadInputError
from trackfg.recording.known_line import KnownLine
from trackfg.recording.model import Recording
from trackfg.results.result import Result
from trackfg.smoothing.smoother import smooth

APART_M = 4.5
RADIUS_M = 500.0
SWITCH_M = 1150.0
"""Runs begin 50 m behind the line's start, at (0, 0), and go east."""
TURN_RAD = np.arccos(1.0 - APART_M / (2.0 * RADIUS_M))

LINE = f"""
format = "trackfg-line/1"
id = "crossover"
heading_deg = 90.0
speed_limit = [{{ chainage_m = 0.0, kmh = 72 }}]
element = [
    {{ type = "straight", length_m = {SWITCH_M + 50.0} }},
    {{ type = "curve", radius_m = {RADIUS_M}, length_m = {RADIUS_M * TURN_RAD} }},
    {{ type = "curve", radius_m = -{RADIUS_M}, length_m = {RADIUS_M * TURN_RAD} }},
    {{ type = "straight", length_m = 3000.0 }},
]
"""


def straight(north_m: float, start_m: float = -100.0, end_m: float = 4000.0) -> np.ndarray:
    return np.array([[start_m, north_m], [end_m, north_m]])


def crossover() -> np.ndarray:
    """Return the vertices of two arcs of the radius, from the southern track to the northern one."""
    angle = np.linspace(0.0, TURN_RAD, 6)
    first = np.stack([SWITCH_M + RADIUS_M * np.sin(angle), RADIUS_M * (1.0 - np.cos(angle))], axis=1)
    middle, end = first[-1], first[0] + 2.0 * (first[-1] - first[0])
    second = end - (first - first[0])[::-1]
    np.testing.assert_allclose(second[0], middle)
    np.testing.assert_allclose(end[1], APART_M)
    return np.concatenate([first, second[1:]])


def network(moved_m: tuple[float, float] = (0.0, 0.0), **tracks: np.ndarray) -> KnownLine:
    tracks = tracks or {"south": straight(0.0), "north": straight(APART_M), "crossover": crossover()}
    return KnownLine("net", tuple(tracks), tuple(line + moved_m for line in tracks.values()), is_local=True)


BESIDE = {"left": straight(0.5 * APART_M, end_m=SWITCH_M), "right": straight(-0.5 * APART_M, end_m=SWITCH_M)}
"""Two tracks with the run midway between them."""


def driven(tmp_path_factory: pytest.TempPathFactory, seed: int, gnss_sd: float = 1.0) -> tuple[Recording, np.ndarray]:
    """Return a recording over the crossover, and the truth: time, east, north."""
    path = tmp_path_factory.mktemp("line") / "crossover.toml"
    path.write_text(LINE)
    plan = scenario("mainline-gnss").on(read_line_file(path))
    assert plan.gnss is not None
    plan = replace(plan, gnss=replace(plan.gnss, sd_m=(gnss_sd, gnss_sd, 2.0 * gnss_sd)))
    run = simulate(plan, seed=seed, duration_s=160.0)
    return run.recording, run.truth[["t_s", "east_m", "north_m"]].to_numpy()


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Recording, np.ndarray]:
    return driven(tmp_path_factory, seed=4)


@pytest.fixture(scope="module")
def alone(run: tuple[Recording, np.ndarray]) -> Result:
    """Of the recording without a line."""
    return smooth(run[0])


def without_gnss(recording: Recording, start_s: float, end_s: float) -> Recording:
    assert recording.gnss is not None
    t = recording.gnss["t_s"]
    return replace(recording, gnss=recording.gnss[(t < start_s) | (t > end_s)].reset_index(drop=True))


def tracks(result: Result) -> list[tuple[str, str | None]]:
    assert result.summary.line is not None
    return [(stretch.status, stretch.track) for stretch in result.summary.line.stretches]


def errors(result: Result, truth: np.ndarray, start_s: float, end_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the errors east and north between two times: along and across here, but for the crossover."""
    trajectory = result.trajectory[result.trajectory["t_s"].between(start_s, end_s)]
    at = [np.interp(trajectory["t_s"], truth[:, 0], truth[:, k]) for k in (1, 2)]
    return trajectory["east_m"].to_numpy() - at[0], trajectory["north_m"].to_numpy() - at[1]


@pytest.mark.slow
def test_the_way_over_a_crossover_is_found(run: tuple[Recording, np.ndarray]) -> None:
    recording, _ = run
    result = smooth(recording, known_line=network())
    assert tracks(result) == [("on", "south"), ("on", "crossover"), ("on", "north")]
    assert result.summary.line is not None
    middle = result.summary.line.stretches[1]
    assert abs(middle.start_chainage_m - SWITCH_M) < 30.0
    assert abs(middle.end_chainage_m - SWITCH_M - 95.0) < 30.0
    assert list(result.events["kind"]).count("on track") == 3


def test_the_crossover_is_found_in_an_outage(run: tuple[Recording, np.ndarray]) -> None:
    recording, truth = run
    over = float(np.interp(SWITCH_M + 50.0, truth[:, 1], truth[:, 0]))
    span = (over - 30.0, over + 30.0)
    outage = without_gnss(recording, *span)
    result = smooth(outage, known_line=network())
    assert tracks(result) == [("on", "south"), ("on", "crossover"), ("on", "north")]
    along, across = errors(result, truth, *span)
    travelled = np.ptp(np.interp(span, truth[:, 0], truth[:, 1]))
    assert np.abs(across).max() < 2.0
    assert np.abs(along).max() < 0.005 * travelled
    alone_across = errors(smooth(outage), truth, *span)[1]
    assert np.sqrt(np.mean(across**2)) < np.sqrt(np.mean(alone_across**2)) + 0.05


@pytest.mark.parametrize("outage", [pytest.param(False, marks=pytest.mark.slow), True])
def test_a_line_that_is_wrong_by_10_m_pulls_nothing(
    run: tuple[Recording, np.ndarray], alone: Result, outage: bool
) -> None:
    recording = without_gnss(run[0], 50.0, 110.0) if outage else run[0]
    unaided = smooth(recording) if outage else alone
    result = smooth(recording, known_line=network((0.0, 10.0)))
    assert {status for status, _ in tracks(result)} == {"disagrees"}
    finding = next(f for f in result.summary.findings if f.code == "line-disagrees")
    assert "-10." in finding.message or "-9." in finding.message or "-5." in finding.message
    for name in ("east_m", "north_m"):
        moved = (result.trajectory[name] - unaided.trajectory[name]).abs()
        assert (moved < unaided.trajectory[f"{name}_sd"]).all()


@pytest.mark.slow
def test_a_line_that_is_wrong_over_a_part_is_used_over_the_rest(
    run: tuple[Recording, np.ndarray], alone: Result
) -> None:
    bent = np.array([[-100.0, 0.0], [300.0, 0.0], [350.0, 10.0], [700.0, 10.0], [750.0, 0.0], [SWITCH_M, 0.0]])
    result = smooth(run[0], known_line=network(south=bent, crossover=crossover(), north=straight(APART_M, SWITCH_M)))
    assert result.summary.line is not None
    wrong = [s for s in result.summary.line.stretches if s.status == "disagrees"]
    assert wrong
    assert wrong[0].start_chainage_m > 200.0
    assert wrong[-1].end_chainage_m < 850.0
    assert tracks(result)[0] == ("on", "south")
    assert tracks(result)[-1] == ("on", "north")
    moved = (result.trajectory["north_m"] - alone.trajectory["north_m"]).abs()
    assert (moved < alone.trajectory["north_m_sd"]).all()


def test_between_two_tracks_it_is_undecided(run: tuple[Recording, np.ndarray]) -> None:
    result = smooth(run[0], known_line=network(**BESIDE))
    assert tracks(result)[0] == ("undecided", None)
    assert result.summary.line is not None
    probabilities = result.summary.line.stretches[0].tracks
    assert set(probabilities) == {"left", "right"}
    assert abs(sum(probabilities.values()) - 1.0) < 0.05
    assert any(finding.code == "track-undecided" for finding in result.summary.findings)


@pytest.mark.slow
def test_a_path_that_is_given_is_taken(run: tuple[Recording, np.ndarray]) -> None:
    config = SmoothConfig.model_validate({"line": {"sd_m": 3.0}})
    assert tracks(smooth(run[0], config, known_line=network(**BESIDE)))[0] == ("undecided", None)
    result = smooth(run[0], config, known_line=network(**BESIDE).only(["right"]))
    assert tracks(result)[0] == ("on", "right")


@pytest.mark.slow
def test_a_run_that_leaves_the_file_is_on_no_track(run: tuple[Recording, np.ndarray]) -> None:
    result = smooth(run[0], known_line=network(south=straight(0.0, end_m=800.0)))
    assert [status for status, _ in tracks(result)] == ["on", "absent"]
    assert any(finding.code == "no-known-track" for finding in result.summary.findings)


def test_without_gnss_nothing_says_where_the_run_is() -> None:
    recording = simulate("mainline", seed=1, duration_s=20.0).recording
    stages: list[str] = []
    with pytest.raises(BadInputError, match="no GNSS"):
        smooth(recording, known_line=network(), progress=lambda stage, _: stages.append(stage))
    assert not stages  # it is refused before anything is solved


def test_a_track_without_length_is_refused() -> None:
    recording = simulate("mainline-gnss", seed=1, duration_s=5.0).recording
    line = network(south=straight(0.0), stub=np.array([[500.0, 3.0], [500.0004, 3.0]]))
    with pytest.raises(BadInputError, match="track 'stub' has no length: expected"):
        line.network(recording)


@pytest.mark.slow
def test_the_right_track_of_two_is_named(tmp_path_factory: pytest.TempPathFactory) -> None:
    named = []
    for seed in range(2):
        recording, _ = driven(tmp_path_factory, seed, gnss_sd=1.9)
        result = smooth(recording, known_line=network())
        assert result.summary.line is not None
        named += [
            (s.track == "south") == (s.end_chainage_m < SWITCH_M + 30.0) for s in result.summary.line.stretches
            if s.status == "on" and s.track != "crossover"
        ]  # fmt: skip
    assert len(named) == 4
    assert all(named)
