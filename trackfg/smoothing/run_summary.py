"""The summary of a smoothed run says why the solver stopped, what it estimated for the whole run, and with what."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from trackfg.checks.tach_correction import TachCorrection
from trackfg.config import SmoothConfig
from trackfg.factors.factor_type import FactorType
from trackfg.factors.states import Kind
from trackfg.graph.further_sensors import further_sensors
from trackfg.recording.description import GnssSpeed
from trackfg.recording.findings import Finding
from trackfg.recording.model import Recording
from trackfg.results.summary import Estimate, Mounting, RunFacts, Solver, Summary, VectorEstimate
from trackfg.results.verdict import widening
from trackfg.smoothing.noise_levels import noise_findings
from trackfg.smoothing.smoothed_states import SmoothedStates
from trackfg.solver.covariance import Covariance
from trackfg.solver.gauss_newton import Solution

if TYPE_CHECKING:
    from trackfg.smoothing.localisation import Located


def summary_of(
    recording: Recording,
    settings: SmoothConfig,
    smoothed: SmoothedStates,
    correction: TachCorrection,
    *,
    anchored: bool,
    gnss_moved_s: float,
) -> Summary:
    """Return the summary of a smoothed run.

    ``recording``: with all its rows and all findings; ``settings``: as they were given; ``anchored``: whether chainage
    counts from the line's beginning by fixes; ``gnss_moved_s``: by how much GNSS's stamps were moved beforehand, s.
    """
    problem, solution, covariance = smoothed.problem, smoothed.solution, smoothed.covariance
    last = smoothed.final_calibration
    path_m = float(np.abs(np.diff(solution.states.odo.distance)).sum())
    clock_prior = problem.family(FactorType.PRIOR_CLOCK)
    assert clock_prior is not None  # every graph has it
    clocks_s = clock_prior.residual(solution.states)[0] + [correction.clock_s, 0.0, gnss_moved_s]
    clock_sds = np.sqrt(np.diagonal(covariance.of(Kind.CLOCK)[0]))
    positions, has_tach, factor = problem.family(FactorType.GNSS_POSITION), problem.wheel is not None, correction.factor
    speeds_offset, speeds_clock = _receiver_speeds(smoothed, gnss_moved_s)
    scalar = partial(_scalar, solution)
    return Summary(
        recording_id=recording.description.id,
        run=_run_facts(recording, smoothed.located, anchored=anchored),
        map=None if smoothed.located is None else smoothed.located.use,
        line=None if smoothed.on_line is None else smoothed.on_line.use,
        settings=settings.model_dump(mode="json"),
        configuration=smoothed.config.model_dump(mode="json"),
        solver=_solver(solution),
        timings_s=smoothed.timings_s,
        duration_s=float(problem.t[-1] - problem.t[0]),
        distance_m=path_m if np.isfinite(widening(smoothed.verdicts, "chainage")) else None,
        keyframes=len(problem.t),
        noise_ratios=smoothed.noise_ratios,
        wheel_scale=scalar(factor * last["wheel_scale"], abs(factor) * last["wheel_scale_sd"]) if has_tach else None,
        further_scales=_further_scales(recording, solution, covariance),
        clock_offset_s=scalar(float(clocks_s[0]), float(clock_sds[0])) if has_tach else None,
        gnss_clock_offset_s=scalar(float(clocks_s[2]), float(clock_sds[2])) if positions else None,
        gnss_speed_offset_mps=speeds_offset,
        gnss_speed_clock_offset_s=speeds_clock,
        mounting=_mounting(solution, covariance),
        gyro_bias_radps=_bias(smoothed, "gyro_bias_{axis}_radps"),
        accel_bias_mps2=_bias(smoothed, "accel_bias_{axis}_mps2"),
        geometry=problem.run.conventions,
        findings=_findings(recording, smoothed),
        verdicts=smoothed.verdicts,
    )


def _solver(solution: Solution) -> Solver:
    return Solver(
        converged=solution.converged,
        reason=solution.reason,
        iterations=solution.iterations,
        cost=solution.cost,
        degrees_of_freedom=solution.degrees_of_freedom,
    )


def _findings(recording: Recording, smoothed: SmoothedStates) -> tuple[Finding, ...]:
    """Return the findings of reading and checking, of the solution, and of a map and a known line."""
    return (
        *recording.findings,
        *_solver_findings(smoothed.solution),
        *noise_findings(smoothed.noise_ratios),
        *smoothed.findings,
        *(() if smoothed.located is None else smoothed.located.findings),
        *(() if smoothed.on_line is None else smoothed.on_line.findings),
    )


def _solver_findings(solution: Solution) -> tuple[Finding, ...]:
    if solution.converged:
        return ()
    hint = "look at the events and check the recording for gross errors and wrong units"
    return (Finding("warning", "not-converged", f"the solution is not a minimum: {solution.reason}", hint=hint),)


def _run_facts(recording: Recording, at: Located | None, *, anchored: bool) -> RunFacts:
    description, origin = recording.description, recording.gnss_origin
    return RunFacts(
        start=None if description.start is None else description.start.isoformat(),
        content_sha256=recording.content_sha256(),
        files_sha256=recording.files_sha256,
        direction=description.track.direction,
        anchored=anchored,
        imu_id=description.imu.id,
        mount_roll_sd_rad=float(np.radians(description.imu.mount_roll_sd_deg)),
        origin=None if origin is None else (float(origin[0]), float(origin[1]), float(origin[2])),
        kilometrage=description.kilometrage if at is None else at.kilometrage(description.kilometrage),
    )


def _scalar(solution: Solution, value: float, sd: float) -> Estimate:
    return Estimate(value=value, sd=sd if solution.converged else None)


def _vector(solution: Solution, values: Sequence[float], sd: Sequence[float]) -> VectorEstimate:
    x, y, z = values
    return VectorEstimate(value=(x, y, z), sd=(sd[0], sd[1], sd[2]) if solution.converged else None)


def _bias(smoothed: SmoothedStates, columns: str) -> VectorEstimate:
    """Return the bias at the end of the run; ``columns`` are those of the calibration, with ``{axis}`` in the name."""
    names = [columns.format(axis=axis) for axis in "xyz"]
    last = smoothed.final_calibration
    return _vector(smoothed.solution, last[names].tolist(), last[[f"{name}_sd" for name in names]].tolist())


def _mounting(solution: Solution, covariance: Covariance) -> Mounting:
    mount = solution.states.mount[0].tolist()
    sd = np.sqrt(np.diagonal(covariance.of(Kind.MOUNT)[0])).tolist()
    return Mounting(
        pitch_rad=_scalar(solution, mount[0], sd[0]),
        yaw_rad=_scalar(solution, mount[1], sd[1]),
        tracking_point_m=_vector(solution, mount[2:], sd[2:]),
    )


def _further_scales(recording: Recording, solution: Solution, covariance: Covariance) -> dict[str, Estimate]:
    """Return the scale of each further tach or speed sensor that has rows, by the name of its table."""
    value = solution.states.sensor
    sd = np.sqrt(np.diagonal(covariance.of(Kind.SENSOR)[0])).reshape(value.shape)
    return {
        sensor.name: _scalar(solution, 1.0 + float(value[sensor.variable, 0]), float(sd[sensor.variable, 0]))
        for sensor in further_sensors(recording.description)
        if not isinstance(sensor.part, GnssSpeed) and len(recording.others.get(sensor.name, ())) > 1
    }


def _receiver_speeds(smoothed: SmoothedStates, moved_s: float) -> tuple[Estimate, Estimate] | tuple[None, None]:
    """Return by what a receiver's speeds are too high and what to add to their stamps, ``moved_s`` included.

    None without any in the graph.
    """
    speeds = smoothed.problem.family(FactorType.GNSS_SPEED)
    if speeds is None or len(speeds) == 0:
        return None, None
    variable = int(speeds.slots[1].index[0])
    offset, clock_s = next(
        prior.residual(smoothed.solution.states)[0]
        for prior in smoothed.problem.families
        if prior.type is FactorType.PRIOR_SENSOR and prior.slots[0].index[0] == variable
    )
    sd = np.sqrt(np.diagonal(smoothed.covariance.of(Kind.SENSOR)[0])).reshape(-1, Kind.SENSOR.dim)[variable]
    scalar = partial(_scalar, smoothed.solution)
    return scalar(float(offset), float(sd[0])), scalar(moved_s + float(clock_s), float(sd[1]))
