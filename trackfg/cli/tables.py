"""The command line shows rich tables: one function per table."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from trackfg.cli.terminal import columns, complain, titled
from trackfg.errors import counted
from trackfg.results.result import Result
from trackfg.results.summary import Estimate, Mounting, Solver, Summary, VectorEstimate
from trackfg.results.verdict import causes, opinions

if TYPE_CHECKING:
    from trackfg.comparison.estimators import Estimator
    from trackfg.io.check import CheckReport
    from trackfg.recording.findings import Finding

_DEG_PER_H = math.degrees(1.0) * 3600.0

_VAGUE = 10.0
"""A slope whose interval reaches over more than this factor is not shown. Chosen for the look."""

_COLOUR = {"error": "bold red", "warning": "yellow", "info": "cyan"}


def estimators(known: Mapping[str, Estimator]) -> RenderableType:
    """Name, title and source of each estimator."""
    table = titled("Estimators", *columns("name", no_wrap=True), "what it is", "source", "judged by")
    for name, estimator in known.items():
        table.add_row(Text(name), Text(estimator.title), Text(estimator.source), Text(", ".join(estimator.tasks)))
    return table


def findings(found: Sequence[Finding], none: str = "Nothing to report: the recording is sound.") -> RenderableType:
    """Return the findings, worst first, each with its place and hint; the line ``none`` where there is none."""
    if not found:
        return Text(none)
    table = titled("Findings", *columns("", "where", "what", "hint", overflow="fold"), show_lines=True)
    for finding in sorted(found, key=lambda shown: list(_COLOUR).index(shown.level)):
        expected = f"; expected {finding.expected}" if finding.expected else ""
        table.add_row(
            Text(finding.level, style=_COLOUR[finding.level]),
            Text(finding.place),
            Text(finding.message + expected),
            Text(finding.hint or ""),
        )
    return table


def estimates(values: Mapping[str, Any]) -> RenderableType:
    """Return what the data say by themselves: each quantity with its unit and 1-sigma, where it could be estimated."""
    rows = {
        "record": f"{values['duration_s']:.1f} s, IMU at {values['imu_rate_hz']:.4g} Hz",
        **_tach(values),
        "rests": f"{values['standstills']}, {values['standstill_s']:.1f} s in all",
        **_axes(values["axes"]),
        **_force(values.get("force", {})),
        **_clocks(values.get("clock_offset"), values.get("positions", {})),
        **{f"wheel scale by {name}": _scale(values.get(f"wheel_scale_{name}")) for name in ("fixes", "gnss")},
        **_rest(values.get("static_bias"), values.get("noise_density")),
        **_filters(values.get("accelerometer_clock"), values.get("bandwidths", {})),
    }
    return named_values("Estimated from the data", rows)


def _tach(values: Mapping[str, Any]) -> dict[str, str]:
    if "tach_rate_hz" not in values:
        return {"tach": "none"}
    quantum = values.get("tach_quantum_m")
    steps = f", steps of {quantum:.4g} m" if quantum else ""
    silent = values["silent_spans"]
    return {
        "tach": f"{values['tach_rate_hz']:.4g} Hz, {values['nominal_distance_m']:.1f} m in all{steps}",
        "tach silent in motion": ", ".join(f"{span['start_s']:.1f} to {span['end_s']:.1f} s" for span in silent),
    }


def _axes(axes: Mapping[str, Any]) -> dict[str, str]:
    forward = axes.get("best_forward")
    shown = "gravity shows" if axes["shown_by"] == "gravity" else "the data show"
    agree = f"as {shown}" if axes["proposed"] == axes["declared"] else f"{shown} {axes['proposed']}"
    return {
        "axes": f"{axes['declared']} declared, {agree}",
        "tilt of the sensor": f"{axes['tilt_deg']:.2f} deg at {axes['magnitude_mps2']:.3f} m/s^2",
        "forward axis": f"{forward} (correlation {axes['best_forward_correlation']:.3f})" if forward else "",
    }


def _force(force: Mapping[str, Any]) -> dict[str, str]:
    """Return the slopes of the force balance, which are 1 where the description is right, and how the sensor points."""
    slopes = {"forward force over the tach's": "forward", "lateral force over speed times yaw rate": "lateral"}
    angles = {"sensor below the direction of travel": "pitch", "sensor to the left of it": "yaw"}
    return {
        **{title: _slope(force.get(name)) for title, name in slopes.items()},
        **{title: _angle(force.get(name)) for title, name in angles.items()},
    }


def _angle(angle: Mapping[str, float] | None) -> str:
    return f"{angle['value_deg']:+.2f} ± {angle['sd_deg']:.2f} deg" if angle else ""


def _clocks(tach: Mapping[str, Any] | None, positions: Mapping[str, Any]) -> dict[str, str]:
    gnss, fix = positions.get("gnss_delay"), positions.get("fix_delay")
    return {
        "clock offset of the tach": f"{tach['offset_s']:+.3f} ± {tach['sd_s']:.3f} s" if tach else "",
        "delay of GNSS": f"{gnss['lag_s']:+.3f} ± {gnss['sd_s']:.3f} s" if gnss else "",
        "turns of GNSS over the gyro's": _slope(positions.get("course")),
        "delay of fixes": f"{fix['delay_s']:+.3f} ± {fix['sd_s']:.3f} s" if fix else "",
    }


def _filters(clock: Mapping[str, float] | None, bandwidths: Mapping[str, float]) -> dict[str, str]:
    """Return by how much forces are later than rates, and where a filter leaves half of their power."""
    halves = {"gyro": bandwidths.get("gyro_hz"), "accelerometer": bandwidths.get("accel_hz")}
    offset = f"{-1e3 * clock['offset_s']:+.1f} ± {1e3 * clock['sd_s']:.1f} ms" if clock else ""
    return {
        "delay of forces against rates": offset,
        **{f"bandwidth of the {name}": f"{hz:.2g} Hz" if hz else "" for name, hz in halves.items()},
    }


def _rest(bias: Mapping[str, Any] | None, noise: Mapping[str, Any] | None) -> dict[str, str]:
    rows = {}
    if bias:
        gyro = VectorEstimate(value=bias["gyro_radps"], sd=bias["gyro_sd_radps"])
        up = Estimate(value=bias["accel_excess_mps2"], sd=bias["accel_excess_sd_mps2"])
        rows["gyro bias at rest"] = _vector(gyro, _DEG_PER_H, "deg/h")
        rows["accelerometer bias upwards"] = f"{_with_sd(up, 1000.0, 1)} mm/s^2"
    if noise:
        for name, sensor, unit in (("gyro", "gyro", "rad/s/√Hz"), ("accelerometer", "accel", "m/s^2/√Hz")):
            density, ratio = noise[f"{sensor}_white"], noise[f"{sensor}_ratio"]
            rows[f"white noise of the {name}"] = f"{density:.3g} {unit}, {ratio:.2f} times the declared or assumed one"
    return rows


def _slope(slope: Mapping[str, float] | None) -> str:
    """Return a slope with its interval; nothing where that is so wide that it says nothing."""
    if not slope or slope["high"] > _VAGUE * slope["low"]:
        return ""
    return f"{slope['value']:.3f}, between {slope['low']:.3f} and {slope['high']:.3f}"


def _scale(scale: Mapping[str, Any] | None) -> str:
    return f"{scale['scale']:.5f} ± {scale['sd']:.5f} from {scale['samples']} differences" if scale else ""


def check_json(report: CheckReport) -> str:
    """Return findings and estimates as JSON."""
    content = {"findings": [asdict(finding) for finding in report.findings], "estimates": report.estimates}
    return json.dumps(content, indent=2)


def summary(result: Result) -> RenderableType:
    """Return the run in a dozen lines."""
    page = result.summary
    rows = {
        "recording": page.recording_id,
        "length": f"{page.duration_s:.1f} s, {_distance(page.distance_m)}",
        "track geometry": _geometry(result),
        **_solver(page),
        "wheel scale": _estimate(page.wheel_scale),
        **{f"scale of {name}": _estimate(scale) for name, scale in page.further_scales.items()},
        "clock offset": _estimate(page.clock_offset_s, "s"),
        "clock offset of GNSS": _estimate(page.gnss_clock_offset_s, "s"),
        "GNSS speeds too high by": _estimate(page.gnss_speed_offset_mps, "m/s"),
        "clock offset of GNSS speeds": _estimate(page.gnss_speed_clock_offset_s, "s"),
        **_mounting(page.mounting),
        "gyro bias": _vector(page.gyro_bias_radps, _DEG_PER_H, "deg/h"),
        "accelerometer bias": _vector(page.accel_bias_mps2, 1000.0, "mm/s^2"),
        "events": _counts(result.events["kind"]),
        "findings": _counts(finding.level for finding in page.findings),
        "time": ", ".join(f"{stage} {seconds:.1f} s" for stage, seconds in page.timings_s.items()),
    }
    return named_values("Summary", rows)


def _geometry(result: Result) -> str:
    if result.geometry.empty:
        return "none: the sensor does not follow the track (rigid in [imu]), or did not move"
    low, high = result.geometry["chainage_m"].iloc[[0, -1]]
    return f"{low:.0f} to {high:.0f} m, every {result.summary.geometry.step_m:g} m"


def _solver(page: Summary) -> dict[str, str]:
    """Return what the solver did, nothing where there was none."""
    solver = page.solver
    if solver is None:
        return {}
    return {
        "solver": f"{_converged(solver)}; {solver.reason}; {page.keyframes} keyframes",
        "cost": f"{solver.cost:.1f} at {solver.degrees_of_freedom} degrees of freedom",
    }


def _converged(solver: Solver) -> str:
    """Return whether the solver came to its end, and in how many iterations."""
    return f"{'converged in' if solver.converged else 'did not converge in'} {counted(solver.iterations, 'iteration')}"


def verdicts(result: Result) -> tuple[Table, Table]:
    """Return what can be trusted, the worst first, and why, and what to do."""
    by_quantity = result.summary.verdicts
    verdict = titled("Verdict", *columns("", no_wrap=True), "", show_header=False)
    for opinion in opinions(by_quantity):
        style = "" if opinion.verdict == "trusted" else _COLOUR["warning"]
        verdict.add_row(Text(opinion.verdict, style=style), Text(", ".join(opinion.quantities)))
    why = titled("Why", *columns("what is seen", "concerns", "what to do", overflow="fold"), show_lines=True)
    for cause in causes(by_quantity, result.summary.findings):
        why.add_row(Text(cause.reason), Text(", ".join(cause.quantities)), Text(cause.hint))
    return verdict, why


def named_values(title: str, rows: Mapping[str, str]) -> Table:
    """Return a line for each name and its text; none where there is no text."""
    table = titled(title, *columns("", no_wrap=True), "", show_header=False)
    for name, text in rows.items():
        if text:
            table.add_row(name, Text(text))
    return table


def warn_of_doubt(result: Result, folder: Path) -> None:
    """Warn of quantities of track geometry that are not to be trusted, whose values a command shows or passes on."""
    from trackfg.report.track_limits import doubt_about

    if doubt := doubt_about(result):
        complain(f"trackfg: warning: {folder}: {doubt}. Hint: trackfg report {folder} says why")


def records(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the rows as JSON has them: what is not known, and what is infinite, is null."""
    plain = table.astype(object).where(table.notna(), None).replace([np.inf, -np.inf], None)
    return [{str(name): value for name, value in row.items()} for row in plain.to_dict("records")]


def _mounting(mounting: Mounting | None) -> dict[str, str]:
    """Return the rows of the mounting, in deg and m."""
    if mounting is None:
        return {}
    yaw, pitch = (_with_sd(angle, math.degrees(1.0), 3) for angle in (mounting.yaw_rad, mounting.pitch_rad))
    return {
        "direction of travel": f"{yaw} deg left, {pitch} deg below the sensor's axis",
        "point on the track": _vector(mounting.tracking_point_m, 1.0, "m from the reference point"),
    }


def _estimate(estimate: Estimate | None, unit: str = "") -> str:
    return "" if estimate is None else f"{_with_sd(estimate, 1.0, 6)} {unit}".rstrip()


def _with_sd(estimate: Estimate, scale: float, places: int) -> str:
    """Format value and, where there is one, 1-sigma, both times ``scale``."""
    sd = "" if estimate.sd is None else f" ± {scale * estimate.sd:.{places}f}"
    return f"{scale * estimate.value:.{places}f}{sd}"


def _vector(estimate: VectorEstimate | None, scale: float, unit: str) -> str:
    if estimate is None:
        return "-"
    sds = [""] * 3 if estimate.sd is None else [f" ± {scale * sd:.2f}" for sd in estimate.sd]
    pairs = zip(estimate.value, sds, strict=True)
    return ", ".join(f"{scale * value:.2f}{sd}" for value, sd in pairs) + f" {unit}"


def _distance(distance_m: float | None) -> str:
    return "distance not determined" if distance_m is None else f"{distance_m:.1f} m"


def _counts(values: Iterable[str]) -> str:
    counted = pd.Series(list(values), dtype="str").value_counts()
    return ", ".join(f"{number} {value}" for value, number in counted.items()) or "none"
