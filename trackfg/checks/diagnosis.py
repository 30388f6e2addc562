"""A recording's own estimates are compared with what its description declares.

Each estimate is a function over tables in a module of its own (:mod:`trackfg.checks.diagnosis_axes`, ``_clock``,
``_force``, ``_positions``, ``_rest``, ``_silence``, ``_wheel``), with its method there; :func:`estimates_of` runs them
all, and :mod:`trackfg.checks.contradictions` turns disagreement into findings.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from trackfg.checks.diagnosis_axes import AxesEstimate, estimate_axes
from trackfg.checks.diagnosis_clock import ClockOffset, estimate_clock_offset, on_imu_clock
from trackfg.checks.diagnosis_force import ForceFit, fit_force
from trackfg.checks.diagnosis_positions import PositionFit, fit_positions
from trackfg.checks.diagnosis_rest import NoiseDensity, StaticBias, noise_density, static_bias
from trackfg.checks.diagnosis_silence import SilentSpan, silent_spans, without_silence
from trackfg.checks.diagnosis_wheel import WheelScale, receiver_speed_scale, scale_from_fixes, scale_from_gnss
from trackfg.recording.model import GNSS_SPEED_TABLE, Recording
from trackfg.sensors.imu_filters.accelerometer_clock import AccelerometerClock, accelerometer_clock
from trackfg.sensors.imu_filters.bandwidth import Bandwidths, RestSpectra
from trackfg.sensors.imu_intervals import intervals
from trackfg.sensors.standstills import find_standstills
from trackfg.sensors.tach import with_sense
from trackfg.sensors.tach_rows import tach_quantum_m


@dataclass(frozen=True)
class Estimates:
    """Everything that can be estimated; None where the recording does not show it.

    ``force`` and ``positions`` are compared with the tach after ``clock_offset`` has been taken out.
    """

    duration_s: float
    imu_rate_hz: float
    tach_rate_hz: float | None
    tach_quantum_m: float | None
    nominal_distance_m: float | None
    standstills: int
    standstill_s: float
    axes: AxesEstimate
    clock_offset: ClockOffset | None
    static_bias: StaticBias | None
    noise_density: NoiseDensity | None
    wheel_scale_fixes: WheelScale | None
    wheel_scale_gnss: WheelScale | None
    force: ForceFit | None
    positions: PositionFit
    silent_spans: tuple[SilentSpan, ...]
    receiver_speed_scale: WheelScale | None = None
    accelerometer_clock: AccelerometerClock | None = None
    bandwidths: Bandwidths | None = None

    def as_dict(self) -> dict[str, Any]:
        """Return the estimates nested, ready for JSON, without what could not be estimated."""
        content: dict[str, Any] = _without_none(asdict(self))
        return content


def _without_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    return [_without_none(item) for item in value] if isinstance(value, list | tuple) else value


def estimates_of(recording: Recording) -> Estimates:
    """Estimate everything.

    Spans in which the tach is silent while the vehicle moves count as holes of the tach. Where the vehicle turns back
    an unsigned tach gets the sense of each movement; where all seem to be backwards, an axis may point the wrong way.
    """
    t, tach = recording.imu["t_s"].to_numpy(), recording.tach
    silent = () if tach is None else silent_spans(recording.imu, tach)
    usable = recording
    if tach is not None:
        sensed = with_sense(recording)
        usable = replace(recording, tach=without_silence(sensed, silent) if silent else sensed)
    speeds = recording.others.get(GNSS_SPEED_TABLE)
    axes = estimate_axes(usable.imu, usable.tach, recording.description.imu.axes, recording.gnss, speeds)
    standstills = find_standstills(usable, min_duration_s=3.0)
    offset = estimate_clock_offset(usable)
    fixes, gnss = recording.fixes, recording.gnss
    return Estimates(
        duration_s=float(t[-1] - t[0]),
        imu_rate_hz=float(1.0 / np.median(np.diff(t))),
        tach_rate_hz=None if tach is None else float(1.0 / np.median(np.diff(tach["t_s"]))),
        tach_quantum_m=None if tach is None else tach_quantum_m(tach),
        nominal_distance_m=None if tach is None else float(np.abs(np.diff(tach["distance_m"])).sum()),
        standstills=int(standstills.shape[0]),
        standstill_s=float(np.sum(standstills[:, 1] - standstills[:, 0])),
        axes=axes,
        clock_offset=offset,
        static_bias=static_bias(recording, standstills),
        noise_density=noise_density(recording, standstills),
        wheel_scale_fixes=None if usable.tach is None or fixes is None else scale_from_fixes(usable.tach, fixes),
        wheel_scale_gnss=None if usable.tach is None or gnss is None else scale_from_gnss(usable.tach, gnss),
        force=fit_force(usable, axes, offset),
        positions=fit_positions(usable, None if usable.tach is None else on_imu_clock(usable.tach, offset)),
        silent_spans=silent,
        accelerometer_clock=accelerometer_clock(usable),
        bandwidths=RestSpectra.of(intervals(recording), standstills).bandwidths,
        receiver_speed_scale=receiver_speed_scale(speeds, usable.gnss, usable.tach),
    )
