"""A log at rest shows its sensor's noise: Allan deviations, the kinds of noise, and what to declare.

A random walk K shows where it is more than the white noise N: below the frequency K / (2 pi N). A log of T s has some
T K / (2 pi N) independent values there, so that two hours suffice for 10 % where K / N is 0.01 / s or more.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from scipy.special import chdtri

from trackfg.numerics.arrays import Array
from trackfg.numerics.key_figures import Outlined
from trackfg.recording.model import Recording
from trackfg.sensors.allan import averaging_factors, degrees_of_freedom, overlapping_allan
from trackfg.sensors.noise_fit import FLICKER_FLOOR, KINDS, NoiseFit, fit_noise, pooled
from trackfg.sensors.rest_log import RestLog, longest_rest, steps_of

SHORTEST_S = 60.0
"""A shorter rest is refused, s: it would show white noise alone."""

SENSORS = {"gyro": "rad/s", "accel": "m/s^2"}
"""Sensors and their units."""

_LIMITS = (0.025, 0.975)
"""Probabilities of the limits of an Allan deviation."""


@dataclass(frozen=True, repr=False)
class LogNoise(Outlined):
    """Noise of a sensor as a log at rest shows it, in SI units.

    ``allan`` has a row per sensor, axis and averaging time: ``sensor, axis, tau_s, deviation, deviation_sd, low, high``
    (95 %), ``degrees_of_freedom, noise`` (the kind that dominates), ``model`` (the deviation that the kinds of noise
    make). ``axes`` has a row per sensor and axis, and of both sensors one of all axes (``axis`` = ``"all"``): ``white,
    bias_instability, bias_walk``, each with ``_sd``, ``lowest`` deviation and ``lowest_at_s``, and ``per_kelvin`` with
    ``_sd``. ``declared`` are values of ``[imu.noise]``, ``remarks`` say of some where they are from.
    """

    recording_id: str
    rest: RestLog
    allan: pd.DataFrame
    axes: pd.DataFrame
    declared: Mapping[str, float]
    remarks: Mapping[str, str]
    temperature: str | None = None

    def as_json(self) -> dict[str, Any]:
        """Return everything in JSON values; what is not known is None."""
        records = {
            name: table.astype(object).where(table.notna(), None).to_dict("records")
            for name, table in (("axes", self.axes), ("allan", self.allan))
        }
        rest = self.rest
        return {
            "recording": self.recording_id,
            "rest": {"begin_s": rest.begin_s, "end_s": rest.end_s, "log_s": rest.whole_s, "rate_hz": 1.0 / rest.dt},
            "imu.noise": dict(self.declared),
            "remarks": dict(self.remarks),
            "temperature": self.temperature,
            **records,
        }

    def toml(self) -> str:
        """Return the block ``[imu.noise]`` of recording.toml."""
        lines = [
            f"{key} = {value:.3g}" + (f"  # {self.remarks[key]}" if key in self.remarks else "")
            for key, value in self.declared.items()
        ]
        return "\n".join(["[imu.noise]", *lines]) + "\n"


def log_noise(
    recording: Recording,
    temperature: tuple[str, Array] | None = None,
    *,
    progress: Callable[[str, float], None] | None = None,
) -> LogNoise:
    """Return the noise that the longest rest of a recording shows.

    ``temperature``: the name of a column and its values (n,), degC, a row per sample of the inertial sensor.
    Raises ``ValueError`` where no rest lasts :data:`SHORTEST_S`, and where a channel does not change during it.
    """
    begin = progress or (lambda stage, done: None)
    rest = longest_rest(recording)
    if rest is None or rest.end_s - rest.begin_s < SHORTEST_S:
        length = 0.0 if rest is None else rest.end_s - rest.begin_s
        raise ValueError(
            f"the longest rest lasts {length:.0f} s; expected {SHORTEST_S:.0f} s or more. "
            "Hint: log for two hours with the vehicle parked and its engine off"
        )
    steps = steps_of(rest.samples)
    _refuse_constant(rest.samples, steps)
    heat = None if temperature is None else _filled(temperature[1][rest.rows], temperature[0])
    factors = averaging_factors(len(rest.samples))
    curves, rows = [], []
    for number, (sensor, channels) in enumerate(zip(SENSORS, (slice(0, 3), slice(3, 6)), strict=True)):
        samples = rest.samples[:, channels]
        begin(f"{sensor}: kinds of noise", 0.5 * number)
        fits = fit_noise(samples, rest.dt, heat)
        for axis, (name, fit) in enumerate(zip("xyz", fits, strict=True)):
            begin(f"{sensor} {name}: Allan deviation", 0.5 * number + 0.1 + 0.4 * axis / 3.0)
            curve = _curve(samples[:, axis], rest.dt, factors, fit)
            curves.append(curve.assign(sensor=sensor, axis=name))
            certain = curve[curve["degrees_of_freedom"] >= _TRUSTED]
            lowest = certain.iloc[int(np.argmin(certain["deviation"]))]
            place = {"lowest": float(lowest["deviation"]), "lowest_at_s": float(lowest["tau_s"])}
            rows.append({"sensor": sensor, "axis": name, **_row(fit), **place})
        rows.append({"sensor": sensor, "axis": "all", **_row(pooled(fits))})
    allan, axes = pd.concat(curves, ignore_index=True), pd.DataFrame(rows)
    allan = allan[["sensor", "axis", *allan.columns[:-2]]]
    declared, remarks = _declared(axes, rest, steps)
    column = None if temperature is None else temperature[0]
    return LogNoise(recording.description.id, rest, allan, axes, declared, remarks, column)


_TRUSTED = 5.0
"""Degrees of freedom that a deviation must have to be called the lowest one: its sigma is then below a third."""


def _refuse_constant(samples: Array, steps: Array) -> None:
    """Raise ``ValueError`` for a channel without noise: it is rounded to steps that are coarser, or is no sensor's."""
    names = [f"{sensor} {axis}" for sensor in SENSORS for axis in "xyz"]
    for name, unit, value, step in zip(names, np.repeat([*SENSORS.values()], 3), samples[0], steps, strict=True):
        if step == 0.0:
            raise ValueError(
                f"{name}: holds {value:.6g} {unit} throughout the rest; expected noise. Hint: log with a finer "
                "range or more digits, or take [imu.noise] from the data sheet"
            )


def _filled(values: Array, name: str) -> Array:
    """Return a temperature without holes: it is slow, and often sampled less often than the rates."""
    finite = np.flatnonzero(np.isfinite(values))
    if not finite.size:
        raise ValueError(f"column {name!r}: has no values during the rest; expected temperatures in degC")
    return np.interp(np.arange(len(values)), finite, values[finite])


def _curve(y: Array, dt: float, factors: np.ndarray, fit: NoiseFit) -> pd.DataFrame:
    """Return tau, deviation, sigma, limits and degrees of freedom of one channel."""
    tau = dt * factors
    parts = fit.allan(tau)
    kinds = np.array(KINDS)[np.argmax(parts, axis=0)]
    deviation, freedom = overlapping_allan(y, dt, factors), degrees_of_freedom(len(y), factors, kinds)
    low, high = (deviation * np.sqrt(freedom / chdtri(freedom, share)) for share in _LIMITS)
    return pd.DataFrame(
        {
            "tau_s": tau,
            "deviation": deviation,
            "deviation_sd": deviation / np.sqrt(2.0 * freedom),
            "low": low,
            "high": high,
            "degrees_of_freedom": freedom,
            "noise": kinds,
            "model": np.sqrt(parts.sum(axis=0)),
        }
    )


def _row(fit: NoiseFit) -> dict[str, float]:
    names = ("white", "bias_instability", "bias_walk")
    row: dict[str, float] = {}
    for name, value, sd in zip(names, fit.coefficients, fit.sds, strict=True):
        row |= {name: float(value), f"{name}_sd": float(sd) if value > 0.0 else np.nan}
    return row | {"per_kelvin": fit.per_kelvin, "per_kelvin_sd": fit.per_kelvin_sd}


def _declared(axes: pd.DataFrame, rest: RestLog, steps: Array) -> tuple[dict[str, float], dict[str, str]]:
    """Return values of ``[imu.noise]`` and remarks: of a sensor whose bias shows no walk, one that is as large; of one
    whose noise is lost in its ``steps``, the noise of rounding, which it has as soon as it moves.
    """
    declared, remarks, duration_s = {}, {}, rest.end_s - rest.begin_s
    for sensor, step in zip(SENSORS, np.sqrt((steps.reshape(2, 3) ** 2).mean(axis=1)), strict=True):
        fit = axes[(axes["sensor"] == sensor) & (axes["axis"] == "all")].iloc[0]
        white, flicker, walk = fit["white"], fit["bias_instability"], fit["bias_walk"]
        rounding = float(step * np.sqrt(rest.dt / 12.0))
        if white < rounding:
            steps_are = f"steps of {step:.3g} {SENSORS[sensor]}"
            remarks[f"{sensor}_white"] = f"of rounding to {steps_are}: the log shows {white:.2g}"
        declared[f"{sensor}_white"] = white = max(float(white), rounding)
        key = f"{sensor}_bias_walk"
        if walk > 0.0:
            declared[key] = float(walk)
            remarks[key] = f"1-sigma {fit['bias_walk_sd'] / walk:.0%}"
        elif flicker > 0.0:
            # The walk that has the floor's Allan deviation where that crosses the white noise.
            declared[key] = float(np.sqrt(3.0) * (FLICKER_FLOOR * flicker) ** 2 / white)
            remarks[key] = f"stands for a bias instability of {flicker:.3g} {SENSORS[sensor]}: no walk was seen"
        else:
            declared[key] = float(2.0 * np.pi * white / duration_s)
            remarks[key] = f"no walk was seen: at most about this in {duration_s / 3600.0:.1f} h"
    return declared, remarks
