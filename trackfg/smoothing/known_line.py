"""A known line as a measurement: the vehicle is on one of its tracks.

The run is smoothed by itself first. Which track it is on, from point to point, is a hypothesis with a probability
(:mod:`trackfg.mapping.recognition.track_hmm`). Where one is :data:`SURE` and its line is right, the run's distance
across it becomes a factor; where several tracks are possible, where the run contradicts the line and where there is no
track there is none, so that a line that is wrong pulls nothing.

Errors of a line last for kilometres (``line.correlation_m``): a factor says how far across the run is where a stretch
begins, and the next ones how that changes from point to point (:func:`trackfg.factors.landmark.along_line`), so that a
constant error counts once and the shape of the line is used besides.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, NamedTuple, get_args

import numpy as np

from trackfg.factors.family import Family
from trackfg.factors.landmark import OnLine, across_line, along_line
from trackfg.factors.loss import Cauchy
from trackfg.factors.states import Kind, Odo
from trackfg.mapping.recognition.track_hmm import LineError, Points, TrackPosterior, track_posterior
from trackfg.numerics.arrays import Array
from trackfg.output.trajectory import QUANTITIES, keyframe_jacobian
from trackfg.recording.findings import Finding
from trackfg.results.events import Event
from trackfg.results.summary import LineStretch, LineUse
from trackfg.smoothing.reassessment import RunSolver, SolvedRun

if TYPE_CHECKING:
    from trackfg.config import LineConfig
    from trackfg.recording.known_line import KnownLine
    from trackfg.recording.track_network import Feet, TrackNetwork

SURE = 0.95
"""Probability from which a track is taken for the one that the run is on."""
_STEP_M = 25.0
"""Points of the run that are compared with the line are so far apart, m: less than a switch is long."""
_NEAR_M = 30.0
"""Tracks are looked for within this, m, and within :data:`_NEAR_SIGMAS` of run and line."""
_NEAR_SIGMAS = 5.0
"""Sigmas of the distance between run and line: one of 1.7 million is larger by chance."""
_SETTLED_M = 0.1
"""Feet that move less from solution to solution, m, are where they were: over 0.1 m no track turns by 0.5 deg."""
_ROUNDS = 4
"""Solutions with the line at most: where it bends, feet move along it by less and less."""
_REACH_M = 200.0
"""Points of a track that are further apart begin a new stretch, m: a factor between distant keyframes fills the
solver's matrices, and few stretches are interrupted."""
_NAMED = 0.01
"""Probability from which a track is listed among those that are possible."""
_Status = Literal["on", "disagrees", "absent", "undecided"]
_STATUSES: tuple[_Status, ...] = get_args(_Status)
EVENT_KINDS = {
    "on": "on track",
    "undecided": "track undecided",
    "disagrees": "line disagrees",
    "absent": "no known track",
}
"""The kind of the event of a stretch, by its status."""


@dataclass(frozen=True)
class RunOnLine:
    """A run that was solved with a known line, and what of the line was used."""

    run: SolvedRun
    use: LineUse
    findings: tuple[Finding, ...]

    @property
    def events(self) -> list[Event]:
        """Return one event for each stretch."""
        t, variance = self.run.problem.t, self.run.covariance.of(Kind.ODO)[:, Odo.DISTANCE, Odo.DISTANCE]
        return [
            Event(
                kind=EVENT_KINDS[stretch.status],
                t_s=stretch.start_s,
                until_s=stretch.end_s,
                detail=_detail(stretch),
                chainage_m=stretch.start_chainage_m,
                chainage_m_sd=float(np.sqrt(np.interp(stretch.start_s, t, variance))),
            )
            for stretch in self.use.stretches
        ]


class _Passage(NamedTuple):
    """The run along a network: points at ``keyframes`` (m,), what is near them, and where on it they are."""

    keyframes: np.ndarray
    points: Points
    feet: Feet
    posterior: TrackPosterior


def on_line(run: SolvedRun, line: KnownLine, network: TrackNetwork, solver: RunSolver) -> RunOnLine:
    """Find the tracks of a solved run in the network of a line, and solve it again with their lines."""
    config = run.config.line
    passage = _passage(run, network, _line_error(config))
    stretches = tuple(_stretches(run, passage, network, config))
    use = LineUse(name=line.name, content_sha256=line.content_sha256, stretches=stretches)
    used = np.flatnonzero(passage.posterior.right >= SURE)
    if used.size:
        run = _solved_with(run, passage, used, network, solver)
    return RunOnLine(run, use, tuple(_findings(use)))


def _passage(run: SolvedRun, network: TrackNetwork, error: LineError) -> _Passage:
    keyframes = _keyframes(run)
    points = _points(run, keyframes)
    largest = np.linalg.eigvalsh(points.variance)[:, 1] + error.sd_m**2
    feet = network.feet(points.place, np.maximum(_NEAR_M, _NEAR_SIGMAS * np.sqrt(largest)))
    return _Passage(keyframes, points, feet, track_posterior(points, feet, network, error))


def _keyframes(run: SolvedRun) -> np.ndarray:
    """Return keyframes :data:`_STEP_M` apart, and those at which the run turns back."""
    distance = run.solution.states.odo.distance
    forth = np.sign(np.diff(distance))
    turns = np.zeros(len(distance), dtype=bool)
    moving = np.flatnonzero(np.abs(np.diff(distance)) > _SETTLED_M)
    turns[moving[1:][forth[moving[1:]] != forth[moving[:-1]]]] = True
    kept = [0]
    for k in range(1, len(distance)):
        apart = abs(float(distance[k] - distance[kept[-1]]))
        if apart >= _STEP_M or (turns[k] and apart > _SETTLED_M):
            kept.append(k)
    return np.array(kept)


def _places(run: SolvedRun, keyframes: np.ndarray) -> Array:
    """Return east and north of the vehicle reference point, (m, 2), m."""
    nav = run.solution.states.nav[keyframes]
    return np.asarray((nav.p - nav.R @ run.problem.run.lever_arm)[:, :2])


def _points(run: SolvedRun, keyframes: np.ndarray) -> Points:
    east = QUANTITIES.index("east_m")
    J = keyframe_jacobian(run.solution.states, run.problem.run.lever_arm)[keyframes, east : east + 2]
    size = J.shape[2]
    variance = J @ run.covariance.at(keyframes)[:, :size, :size] @ np.swapaxes(J, 1, 2)
    between = [run.covariance.between(i, j)[:size, :size] for i, j in itertools.pairwise(keyframes.tolist())]
    covariance = J[:-1] @ np.reshape(between, (-1, size, size)) @ np.swapaxes(J[1:], 1, 2)
    return Points(_places(run, keyframes), variance, covariance)


def _solved_with(
    run: SolvedRun,
    passage: _Passage,
    used: np.ndarray,
    network: TrackNetwork,
    solver: RunSolver,
) -> SolvedRun:
    """Solve with the lines at points ``used``, until their feet stay where they are."""
    problem, keyframes, feet = run.problem, passage.keyframes[used], passage.feet.take(passage.posterior.row[used])
    for _ in range(_ROUNDS):
        solvable = replace(problem, families=(*problem.families, *_families(run, keyframes, feet)))
        again = solver(run.config, run.declared, replace(solvable, initial=run.solution.states), False)
        run = replace(again, findings=run.findings, doubts=run.doubts)
        previous, feet = feet.place, network.feet_on(feet, _places(run, keyframes))
        if np.linalg.norm(feet.place - previous, axis=1).max() < _SETTLED_M:
            break
    return run


def _families(run: SolvedRun, keyframes: np.ndarray, feet: Feet) -> Iterator[Family]:
    """Return the factors of points along the line: across it where a stretch begins, and on from point to point."""
    error, lever_arm = _line_error(run.config.line), run.problem.run.lever_arm
    loss = Cauchy(run.config.line.robust_width) if run.config.position.robust else None
    turned = np.sum(feet.normal[1:] * feet.normal[:-1], axis=1) < 0.0  # a piece that is drawn the other way round
    normal = feet.normal * np.where(np.append(0, np.cumsum(turned)) % 2, -1.0, 1.0)[:, None]
    points = OnLine(keyframes, feet.place, normal)
    apart = np.linalg.norm(np.diff(feet.place, axis=0), axis=1)
    begins = np.append(True, apart > _REACH_M)

    def some(rows: np.ndarray) -> OnLine:
        return OnLine(*(column[rows] for column in points))

    yield across_line(some(begins), lever_arm, np.full((begins.sum(), 1), error.sd_m), loss)
    second = np.flatnonzero(~begins)
    if second.size:
        between = apart[second - 1]
        sigma = error.step_sd_m(between)[:, None]
        yield along_line(some(second - 1), some(second), error.correlation(between), lever_arm, sigma, loss)


def _line_error(config: LineConfig) -> LineError:
    return LineError(config.sd_m, config.correlation_m)


def _status(passage: _Passage) -> np.ndarray:
    """Return the status of each point, as the index of :data:`_STATUSES`, shape (m,)."""
    posterior = passage.posterior
    likely = [posterior.right >= SURE, posterior.wrong > 0.5, posterior.absent > 0.5]
    return np.select(likely, [0, 1, 2], 3)


def _stretches(run: SolvedRun, passage: _Passage, network: TrackNetwork, config: LineConfig) -> Iterator[LineStretch]:
    """Return the stretches in order; each ends where the next one begins."""
    posterior, feet, status = passage.posterior, passage.feet, _status(passage)
    named = status < _STATUSES.index("absent")
    track = [network.track[feet.piece[row]] if name else "" for row, name in zip(posterior.row, named, strict=True)]
    begins = np.append(True, (status[1:] != status[:-1]) | (np.array(track[1:]) != np.array(track[:-1])))
    of_status = (posterior.right, posterior.wrong, posterior.absent, posterior.right)
    first = np.flatnonzero(begins)
    ends = np.append(first[1:], len(status) - 1)
    chainage = run.problem.run.direction * run.solution.states.odo.distance[passage.keyframes]
    t = run.problem.t[passage.keyframes]
    for i, j, stop in zip(first.tolist(), ends.tolist(), [*first[1:].tolist(), len(status)], strict=True):
        rows = posterior.row[i:stop]
        across = across_sd = None
        if named[i]:
            normal, variance = feet.normal[rows], passage.points.variance[i:stop]
            of_run = float(np.mean(np.einsum("ki,kij,kj->k", normal, variance, normal)))
            across, across_sd = float(np.mean(feet.across[rows])), float(np.sqrt(of_run + config.sd_m**2))
        tracks: dict[str, float] = {}
        for at in posterior.of_track[i:stop]:
            for its_id, p in at.items():
                tracks[its_id] = tracks.get(its_id, 0.0) + p / (stop - i)
        yield LineStretch(
            status=_STATUSES[int(status[i])],
            track=track[i] or None,
            probability=float(np.mean(of_status[int(status[i])][i:stop])),
            tracks={its_id: p for its_id, p in sorted(tracks.items(), key=lambda item: -item[1]) if p >= _NAMED},
            start_s=float(t[i]),
            end_s=float(t[j]),
            start_chainage_m=float(chainage[i]),
            end_chainage_m=float(chainage[j]),
            across_m=across,
            across_m_sd=across_sd,
        )


def _detail(stretch: LineStretch) -> str:
    if stretch.status == "absent":
        return ""
    if stretch.status == "undecided":
        return ", ".join(f"{track} {100.0 * p:.0f} %" for track, p in stretch.tracks.items())
    return f"{stretch.track}, {stretch.across_m:+.2f} m across (sigma {stretch.across_m_sd:.2f} m)"


def _findings(use: LineUse) -> Iterator[Finding]:
    disagreeing = [s for s in use.stretches if s.status == "disagrees"]
    if disagreeing:
        worst = max(disagreeing, key=lambda s: abs(s.end_chainage_m - s.start_chainage_m))
        yield Finding(
            "warning",
            "line-disagrees",
            f"{use.name}: over {use.length_m('disagrees'):.0f} m the line disagrees with the run and is not used: "
            f"from {worst.start_chainage_m:.0f} to {worst.end_chainage_m:.0f} m the run is {worst.across_m:+.1f} m "
            f"from track {worst.track!r} (sigma {worst.across_m_sd:.1f} m)",
            hint="check the line's reference system, the antenna's place, and that the file has the track of the run",
        )
    undecided = use.length_m("undecided")
    if undecided:
        yield Finding(
            "info",
            "track-undecided",
            f"{use.name}: over {undecided:.0f} m it is undecided which track the run is on: no line was used there",
            hint="name the tracks of the run (--path), or give more accurate positions",
        )
    absent = use.length_m("absent")
    if absent:
        elsewhere = all(stretch.status == "absent" for stretch in use.stretches)
        yield Finding(
            "warning" if elsewhere else "info",
            "no-known-track",
            f"{use.name}: over {absent:.0f} m no track is near the run",
            hint="check the line's reference system, and that the file is of this place" if elsewhere else None,
        )
