"""The batch smoother: recording in, result out.

recording -> graph and initial values -> Gauss-Newton -> covariances -> reassessment and Gauss-Newton in turns
-> dense motion -> trajectory, geometry, events and summary
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from trackfg.checks.columns import memory_faults
from trackfg.checks.inertial.imu_faults import without_imu_faults
from trackfg.checks.inertial.packet_stamps import with_even_stamps
from trackfg.checks.inertial.repeated_rows import without_repeated_rows
from trackfg.checks.limits import CheckLimits
from trackfg.checks.tach_correction import TachCorrection, corrected_tach
from trackfg.config import SmoothConfig
from trackfg.graph.balise_ties import with_balise_ties
from trackfg.graph.build import Problem, build_problem, too_short
from trackfg.graph.creeping_wheel import with_creeping_wheels
from trackfg.graph.inputs import declared_noise
from trackfg.numerics.arrays import Array
from trackfg.numerics.blas_threads import ThreadBeside, one_thread
from trackfg.output.dense_motion import dense_motion, dense_step
from trackfg.output.event_sources import EventSources
from trackfg.output.events import event_table
from trackfg.output.own_passages import own_passages
from trackfg.output.place_covariance import place_covariance
from trackfg.output.profiles import Profile, profiles
from trackfg.output.rail_profiles import seen_profiles
from trackfg.output.track_geometry import geometry_table
from trackfg.output.trajectory import trajectory_table
from trackfg.recording.antenna import with_antenna_named
from trackfg.recording.findings import Finding, raise_first
from trackfg.recording.model import Recording, refuse_other_than_recording
from trackfg.results.balise_passages import BalisePassages
from trackfg.results.official_places import unplaced
from trackfg.results.place_covariance import PlaceCovariance
from trackfg.results.result import Result
from trackfg.results.widening import widened, widened_passages, widened_places
from trackfg.sensors.displacement import RailView, rail_views
from trackfg.smoothing.clocks.imu_clock_jumps import without_imu_clock_jumps
from trackfg.smoothing.clocks.late_accelerometer import with_accelerometer_in_time
from trackfg.smoothing.clocks.late_clocks import Offsets, gnss_moved_s, solved_in_time, with_gnss_in_time, with_offsets
from trackfg.smoothing.doubts.judgement import judged
from trackfg.smoothing.doubts.late_fix_doubts import late_fix_doubts
from trackfg.smoothing.doubts.recording_doubts import recording_doubts, recording_findings
from trackfg.smoothing.fixes.balise_fixes import balise_findings, with_balise_fixes
from trackfg.smoothing.fixes.wrong_fixes import with_consensus
from trackfg.smoothing.noise_levels import levels, lowered_levels, miscounted
from trackfg.smoothing.rail_ties import with_rail_factors
from trackfg.smoothing.reassessment import RunSolver, SolvedRun, reassessed
from trackfg.smoothing.reassessors import REASSESSORS
from trackfg.smoothing.run_summary import summary_of
from trackfg.smoothing.smoothed_states import SmoothedStates
from trackfg.smoothing.straights import with_roll_of_mounting
from trackfg.smoothing.weightless_sensors import without_contradicted_speeds, without_unmeasured_rows
from trackfg.solver.covariance import Covariance, posterior_covariance
from trackfg.solver.gauss_newton import Solution, solve
from trackfg.solver.variance_components import Residuals, group_residuals

if TYPE_CHECKING:
    from trackfg.maps.feature_map import FeatureMap
    from trackfg.recording.known_line import KnownLine
    from trackfg.smoothing.localisation import Located

Progress = Callable[[str, float], None]


@dataclass
class _Stages:
    """Names, timings and progress of the pipeline's stages."""

    progress: Progress | None
    timings_s: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[Callable[[float], None]]:
        start = time.perf_counter()
        self._report(name, 0.0)
        yield lambda done: self._report(name, done)
        self.timings_s[name] = self.timings_s.get(name, 0.0) + time.perf_counter() - start
        self._report(name, 1.0)

    def _report(self, name: str, done: float) -> None:
        if self.progress is not None:
            self.progress(name, done)


_MOST_SAMPLES_BESIDE = 4_000_000
"""Of a longer record (six hours at 200 Hz) the checks run before the graph is built, and not beside it: arrays of both
would not fit into the default memory, and each would have the other's written to the scratch file."""


@one_thread()
def smooth(
    recording: Recording,
    config: SmoothConfig | None = None,
    *,
    feature_map: FeatureMap | None = None,
    known_line: KnownLine | None = None,
    limits: CheckLimits | None = None,
    progress: Progress | None = None,
) -> Result:
    """Estimate the whole run from all its measurements.

    Linear algebra runs on one thread, so that the result is the same to the last bit wherever and beside whatever else
    it is computed.

    Parameters
    ----------
    recording
        Of one run, with an IMU and whatever else was measured.
    config
        Settings other than the defaults.
    feature_map
        A map to be recognised on: where the run is on it becomes a measurement.
    known_line
        Tracks that the run was on: its distance from them becomes a measurement. The recording's own unless given.
    limits
        Those of the checks of the recording, as of :func:`~trackfg.io.check.check_recording`.
    progress
        Called as ``progress(stage, fraction)`` while the stages "graph", "solve", "covariance", "check", "output",
        "geometry" and "map" go on.

    Returns
    -------
    Result
        Trajectory, geometry and events with sigmas, and a summary; chainages in m, times in s.

    Raises
    ------
    UnsolvableError
        Where the recording does not determine the run; the message says what is missing.
    BadInputError
        For a known line that cannot be used, and for tables made in memory that a reader would refuse.
    TypeError
        For anything but a recording, a path, say; and for settings that are no :class:`~trackfg.config.SmoothConfig`.

    Examples
    --------
    >>> import trackfg
    >>> result = trackfg.smooth(trackfg.read_recording("run1"))
    >>> result.summary.converged
    True
    >>> int(result.trajectory["chainage_m"].max().round(-1))  # m, from where the run starts
    300
    """
    refuse_other_than_recording(recording, "smooth")
    if config is not None and not isinstance(config, SmoothConfig):
        given = type(config).__name__
        raise TypeError(f"smooth takes settings as trackfg.SmoothConfig.model_validate(settings) gives, not {given}")
    config, limits = config or SmoothConfig(), limits or CheckLimits()
    recording = with_even_stamps(recording)
    raise_first(memory_faults(recording, limits))
    sound, measured, correction = _prepared(recording, config, limits)
    anchored = with_balise_fixes(measured)
    smoothed = smooth_states(
        anchored, config, feature_map=feature_map, known_line=known_line, limits=limits, progress=progress
    )
    sources = EventSources.of(smoothed.problem)
    of_line = () if smoothed.on_line is None else smoothed.on_line.events
    events = event_table(sources, smoothed.solution.states, smoothed.covariance, smoothed.trajectory, of_line)
    findings: tuple[Finding, ...] = (*measured.findings, *correction.findings)
    if (km := recording.description.kilometrage) is not None and not _is_placed(anchored, smoothed.located):
        findings = (*findings, *unplaced(smoothed.trajectory["chainage_m"], km))
    passages = _balise_passages(measured, smoothed)
    balises = None
    if len(passages):
        from trackfg.mapping.runs.balise_survey import surveyed

        balises = surveyed([passages], [recording.description.id])
        findings = (*findings, *balise_findings(balises))
    summary = summary_of(
        replace(recording, findings=findings),
        config,
        smoothed,
        correction,
        anchored=_is_placed(anchored, None),
        gnss_moved_s=gnss_moved_s(sound, measured),
    )
    return Result(
        widened(smoothed.trajectory, smoothed.verdicts),
        widened(smoothed.geometry, smoothed.verdicts),
        widened(events, smoothed.verdicts),
        summary,
        widened_places(smoothed.places, smoothed.verdicts),
        *(() if balises is None else (balises.table, passages)),
    )


def _prepared(
    recording: Recording, config: SmoothConfig, limits: CheckLimits
) -> tuple[Recording, Recording, TachCorrection]:
    """Return the sound rows of a recording, the same as the graph takes them for measurements, and what was done to the
    tach: rows that measure nothing are left out, and clocks corrected.
    """
    sound = without_imu_faults(without_repeated_rows(recording), limits)
    if sound.imu.empty:
        raise too_short(sound, 0.0)
    measured, correction = corrected_tach(without_imu_clock_jumps(sound, config))
    measured = with_accelerometer_in_time(measured)
    measured = without_contradicted_speeds(without_unmeasured_rows(measured), limits)
    return sound, with_gnss_in_time(measured, config.tach.clock_offset_sd_s), correction


def _balise_passages(measured: Recording, smoothed: SmoothedStates) -> BalisePassages:
    """Return the run's own passages of balises, with the sigmas that the verdicts leave; none without balises."""
    if measured.balises is None:
        return BalisePassages.none()
    passages = own_passages(measured, smoothed.problem, smoothed.solution.states)
    return widened_passages(passages, smoothed.verdicts)


def smooth_states(
    recording: Recording,
    config: SmoothConfig,
    *,
    feature_map: FeatureMap | None = None,
    known_line: KnownLine | None = None,
    limits: CheckLimits | None = None,
    progress: Progress | None = None,
) -> SmoothedStates:
    """Smooth as :func:`smooth` does, but return states and covariances as well as tables."""
    stages, views = _Stages(progress), rail_views(recording)
    known_line = known_line or recording.known_line
    network = None if known_line is None else known_line.network(recording)  # a line that cannot be used is refused now
    with ThreadBeside() as thread:  # checks need no solution: they run while kernels solve
        checked = thread.begin(partial(recording_findings, recording, limits or CheckLimits()))
        if len(recording.imu) > _MOST_SAMPLES_BESIDE:
            checked.result()
        solved = solved_in_time(recording, partial(_solved, config=config, views=views, stages=stages))
        of_line = None
        if known_line is not None and network is not None:
            from trackfg.smoothing.known_line import on_line

            of_line = on_line(solved, known_line, network, _solver(stages))
            solved = of_line.run
        with stages.stage("check"):
            findings = checked.result()
            doubts = (*recording_doubts(recording, findings), *solved.doubts, *late_fix_doubts(solved, recording.fixes))
    better = lowered_levels(solved.declared.run.noise, declared_noise(recording.description, config))
    miscount = miscounted(solved.problem.wheel, config.tach.creep_m_per_sqrt_m)
    of_solution = with_antenna_named(solved.findings, recording.description.gnss)
    solved = replace(solved, findings=(*findings, *better, *miscount, *of_solution), doubts=doubts)
    smoothed = replace(_with_tables(recording, views, stages, solved, feature_map), on_line=of_line)
    with stages.stage("covariance"):
        return replace(smoothed, verdicts=judged(smoothed, smoothed.geometry))


def _solved(
    recording: Recording, offsets: Offsets, config: SmoothConfig, views: list[RailView], stages: _Stages
) -> SolvedRun:
    # A local would keep the first solution's arrays in memory while the graph is solved again.
    run = reassessed(_solved_first(recording, offsets, config, views, stages), _solver(stages), REASSESSORS)
    run = with_roll_of_mounting(run)
    return replace(run, config=_with_noise_levels(config, levels(run.declared, run.problem)))


def _solved_first(
    recording: Recording, offsets: Offsets, config: SmoothConfig, views: list[RailView], stages: _Stages
) -> SolvedRun:
    with stages.stage("graph"):
        problem = with_offsets(build_problem(recording, config), offsets)
        problem = with_balise_ties(with_consensus(problem), recording, config.position)
        if views:
            problem = with_rail_factors(problem, problem.initial, views, config.laser)
    with stages.stage("solve") as report:
        solution = solve(problem, config.solver, report)
    # Which wheel creeps, and which readings saw one place, is known better now.
    refined, states = with_creeping_wheels(problem, solution.states, config), solution.states
    if views:
        refined = with_rail_factors(refined, states, views, config.laser)
    if refined is problem:
        return SolvedRun(config, problem, problem, solution, *_covariance(problem, solution, stages))
    del solution  # its square root is as large as the next one
    problem = replace(refined, initial=states)
    return _solver(stages)(config, problem, problem, True)


def _solver(stages: _Stages) -> RunSolver:
    """Return what solves a problem, with covariances, and reports on it."""

    def solved(config: SmoothConfig, declared: Problem, problem: Problem, far: bool) -> SolvedRun:
        with stages.stage("solve") as report:
            solution = solve(problem, config.solver, report, near=not far)
        return SolvedRun(config, declared, problem, solution, *_covariance(problem, solution, stages))

    return solved


def _with_noise_levels(config: SmoothConfig, levels: dict[str, float]) -> SmoothConfig:
    """Return the settings that were used in the end: each factor times what was found."""
    factors = {name: factor * levels.get(name, 1.0) for name, factor in config.noise.factors().items()}
    return config.model_copy(update={"noise": config.noise.model_copy(update=factors)})


def _covariance(problem: Problem, solution: Solution, stages: _Stages) -> tuple[Covariance, dict[str, Residuals]]:
    with stages.stage("covariance"):
        covariance = posterior_covariance(solution.root)
        return covariance, group_residuals(problem, solution.states, covariance, problem.run.bridged)


def _with_tables(
    recording: Recording, views: list[RailView], stages: _Stages, solved: SolvedRun, feature_map: FeatureMap | None
) -> SmoothedStates:
    """Return a run with its tables; where it is recognised on a map, solved again with what that says."""
    run, states, covariance = solved.problem.run, solved.solution.states, solved.covariance
    with stages.stage("output"):
        clock = _clock(run.t, solved.config.output.rate_hz)
        motion = dense_motion(run, states, dense_step(states, run.conventions.step_m), clock)
        trajectory = trajectory_table(run, motion.at(clock), states, covariance)
        motion = motion.without_rates()
    with stages.stage("geometry"):
        passes = []
        if _speed_is_measured(recording):
            passes = seen_profiles(recording.description, views, run, motion, states)
        del motion  # the tables need its memory
        geometry = geometry_table(run, passes, states, covariance, solved.solution.root)
        places = place_covariance(run, passes, states, solved.solution.root, covariance)
    alone = SmoothedStates(
        **{part.name: getattr(solved, part.name) for part in fields(SolvedRun)},
        trajectory=trajectory,
        geometry=geometry,
        places=places,
        timings_s=stages.timings_s,
    )
    if feature_map is None:
        return alone
    at = _located(recording, stages, alone, passes, feature_map)
    if not at.use.sections:
        return replace(alone, located=at)
    with stages.stage("solve") as report:
        solution = solve(at.problem, solved.config.solver, report)
    covariance, residuals = _covariance(at.problem, solution, stages)
    covariance = at.chainage.with_uncertainty(covariance, solution.states, run.direction)
    again = replace(solved, problem=at.problem, solution=solution, covariance=covariance, residuals=residuals)
    return replace(_with_tables(recording, views, stages, again, None), located=at, places=PlaceCovariance.none())


def _located(
    recording: Recording, stages: _Stages, alone: SmoothedStates, passes: list[Profile], feature_map: FeatureMap
) -> Located:
    """Recognise the run on the map."""
    from trackfg.smoothing.localisation import UnlocatedRun, located

    config, run, solution = alone.config, alone.problem.run, alone.solution
    with stages.stage("map"):
        geometry, on_springs = alone.geometry, not passes
        if on_springs and _speed_is_measured(recording):
            # On springs alone the motion is not the track's, but curves are seen in it all the same.
            states = solution.states
            passes = profiles(run, dense_motion(run, states, dense_step(states, run.conventions.step_m)), states)
            geometry = geometry_table(run, passes, solution.states, alone.covariance, solution.root)
        unlocated = UnlocatedRun(
            id=recording.description.id,
            problem=alone.problem,
            states=solution.states,
            geometry=geometry,
            passes=passes,
            anchored=_is_placed(recording, None),
            wheel_scale_sd=float(alone.final_calibration["wheel_scale_sd"]),
            on_springs=on_springs,
        )
        return located(unlocated, feature_map, config.position)


def _is_placed(recording: Recording, at: Located | None) -> bool:
    """Return whether chainage counts from the line's beginning: by fixes, or by a map."""
    fixed = recording.fixes is not None and len(recording.fixes) > 0
    return fixed or (at is not None and at.use.sections > 0)


def _speed_is_measured(recording: Recording) -> bool:
    return recording.tach is not None or recording.gnss is not None


def _clock(t: Array, rate_hz: float) -> Array:
    """Return a uniform clock over the run: whole multiples of the output interval."""
    first, last = np.ceil(t[0] * rate_hz), np.floor(t[-1] * rate_hz)
    return np.arange(first, last + 1) / rate_hz
