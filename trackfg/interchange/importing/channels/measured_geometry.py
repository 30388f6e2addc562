"""A channel table of another system becomes a result: its geometry, without a trajectory.

Channels keep their values. What a table does not have is computed where that needs no assumption: the middle of both
rails, twist from the cross-level, versines of level and alignment (of the waves that the channels hold), and curvature
from a versine, less the offset that it has on straights. The rest is NaN, and so are sigmas, which no channel states.
"""

from __future__ import annotations

import hashlib

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError
from trackfg.geometry.twist import twist
from trackfg.geometry.versines import versine
from trackfg.interchange.importing.channels.places import places_of, refuse_single
from trackfg.interchange.importing.channels.straight_offset import straight_offset
from trackfg.interchange.importing.channels.twist_base import identified_base
from trackfg.interchange.importing.geometry_reading import GeometryReading
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.numerics.arrays import Array
from trackfg.recording.findings import Finding
from trackfg.results.columns import BAND_COLUMNS, GEOMETRY_COLUMNS, RAIL_COLUMNS, TRAJECTORY_COLUMNS
from trackfg.results.events import no_events
from trackfg.results.place_covariance import APART_M, PlaceCovariance
from trackfg.results.result import Result
from trackfg.results.summary import GeometryConventions, RunFacts, Summary

_NOMINAL_GAUGES_M = (1.0, 1.067, 1.435, 1.520, 1.524, 1.600, 1.668, 1.676)
"""Gauges of the world's main lines, m: the one next to a gauge channel is the nominal one."""
_LARGEST_DEVIATION_MM = 100.0
"""Of a gauge from the nominal one, mm: tracks are closed at a third of it (EN 13848-5, gauge of 1470 mm)."""
_GAUGES_MM = (300.0, 4000.0)
"""Smallest and greatest gauge, mm, as `trackfg check` takes them for one (finding `track-size`)."""
_STEADY = 0.05
"""Spread of a gauge, of its median: 95 % of a line's are within 50 mm, on curves of small radius, too."""
_STANDARD_GAUGE_M = 1.435
"""Gauge that is assumed without a gauge channel, m (UIC 510)."""
_RAIL_HEAD_M = 0.065
"""Distance of the rails' middles less the gauge, m: 1.5 m on standard gauge (EN 13848-1)."""
_TWIST_BASE_M = 5.0
"""Base of a twist that is computed, m, as of `geometry.twist_base_m` of `trackfg smooth`."""
_SAME_ERROR_M = 1000.0
"""Distance over which errors of places and of cross-level are alike, m: kilometre posts set them right. Assumed."""
_CROSS_LEVEL_SD_MM = 1.0
"""Sigma of a recorded cross-level's slow error, mm. Assumed; maps of several runs estimate the cross-level."""
_MIRRORED = ("cross_level_mm", "curvature_1pm", "gradient_permille")
"""What changes sign where one looks the other way: with alignment and its versines."""


def measured_result(table: SourceTable, reading: GeometryReading, run_id: str) -> Result:
    """Return the result that a channel table is.

    Raises :class:`BadInputError` with file, column and row for places that neither rise nor fall, and for channels that
    are missing, no numbers, or empty.
    """
    places = places_of(table, reading)
    names = [name for name in reading.channels if name != "chainage_m"]
    raw = np.stack([reading.channels[name].factor * table.numbers(reading.channels[name].name) for name in names])
    if not np.isfinite(raw).any():
        raise BadInputError(f"{table.name}: the channels {', '.join(names)} are empty; expected values")
    chainage, values, step = places.on_grid(raw[:, places.rows], reading.step_m)
    refuse_single(table, chainage)
    columns = dict(zip(names, values, strict=True))
    if reading.facing == "travel" and places.direction == -1:
        columns = _turned(columns)
    elsewhere = f"the geometry was measured by another system ({', '.join(names)}): it has no sigmas and no trajectory"
    findings = [Finding("info", "measured-elsewhere", elsewhere)]
    _refuse_other_than_a_gauge(table.name, columns, reading)
    deviates = _is_deviation(columns, reading)
    gauge_m = reading.gauge_m or _gauge(columns, deviates)
    if deviates:
        columns["gauge_mm"] = columns["gauge_mm"] + 1000.0 * gauge_m
    conventions = _conventions(columns, reading, step, gauge_m, findings)
    _complete(columns, conventions, findings)
    geometry = _geometry(chainage, columns, reading.chainage_sd_m)
    facts = RunFacts(
        content_sha256=hashlib.sha256(geometry.to_numpy().tobytes()).hexdigest(),
        direction=places.direction,
        anchored=True,
        mount_roll_sd_rad=0.0,
    )
    summary = Summary(
        recording_id=run_id,
        run=facts,
        configuration={"geometry": reading.model_dump(mode="json")},
        timings_s={},
        duration_s=0.0,
        distance_m=float(chainage[-1] - chainage[0]),
        keyframes=0,
        geometry=conventions,
        findings=tuple(findings),
    )
    return Result(
        trajectory=pd.DataFrame(columns=list(TRAJECTORY_COLUMNS), dtype=np.float64),
        geometry=geometry,
        events=no_events(),
        summary=summary,
        covariance=_covariance(chainage, reading.chainage_sd_m),
    )


def _turned(columns: dict[str, Array]) -> dict[str, Array]:
    """Return the columns facing the other way: the rails change places, and what is to the left its sign."""
    other = {"left": "right", "right": "left"}
    out = {}
    for name, values in columns.items():
        side = next((side for side in other if f"_{side}_" in name), None)
        turned = name if side is None else name.replace(f"_{side}_", f"_{other[side]}_")
        mirrored = name in _MIRRORED or name.startswith("alignment") or name == "versine_alignment_mm"
        out[turned] = -values if mirrored else values
    return out


def _refuse_other_than_a_gauge(file: str, columns: dict[str, Array], reading: GeometryReading) -> None:
    """Raise :class:`BadInputError` for a gauge channel that is neither a gauge, mm, nor a deviation from one."""
    values = columns.get("gauge_mm")
    if values is None or not np.isfinite(values).any() or reading.channels["gauge_mm"].deviation:
        return
    least, middle, greatest = np.nanquantile(values, (0.025, 0.5, 0.975)).tolist()
    smallest, largest = _GAUGES_MM
    in_metres = smallest < 1000.0 * middle < largest and greatest - least < _STEADY * middle
    if in_metres or not (abs(middle) < _LARGEST_DEVIATION_MM or smallest < middle < largest):
        name = reading.channels["gauge_mm"].name
        raise BadInputError(
            f"{file}: column {name!r} has the median {middle:g}; expected a gauge, {smallest:g} to {largest:g} mm, or "
            f"a deviation from it below {_LARGEST_DEVIATION_MM:g} mm. Hint: state its unit in its name ('{name} [m]'), "
            f"or gauge_mm = {{ name = {name!r}, factor = ... }} under [geometry.channels] of a mapping"
        )


def _is_deviation(columns: dict[str, Array], reading: GeometryReading) -> bool:
    """Return whether the gauge channel counts from the nominal gauge, by its name or since no gauge is so small."""
    values = columns.get("gauge_mm")
    if values is None or not np.isfinite(values).any():
        return False
    return reading.channels["gauge_mm"].deviation or bool(abs(np.nanmedian(values)) < _LARGEST_DEVIATION_MM)


def _gauge(columns: dict[str, Array], deviates: bool) -> float:
    """Return the nominal gauge, m: the one next to the gauge channel, else the standard gauge."""
    values = columns.get("gauge_mm")
    if values is None or deviates or not np.isfinite(values).any():
        return _STANDARD_GAUGE_M
    middle = 1e-3 * float(np.nanmedian(values))
    return min(_NOMINAL_GAUGES_M, key=lambda gauge: abs(gauge - middle))


def _conventions(
    columns: dict[str, Array], reading: GeometryReading, step: float, gauge_m: float, findings: list[Finding]
) -> GeometryConventions:
    base, anchor = reading.twist_base_m, reading.twist_anchor
    if "twist_mm" in columns and "cross_level_mm" in columns and (base is None or anchor is None):
        fit = identified_base(columns["cross_level_mm"], columns["twist_mm"], step)
        if fit is None:
            message = "the recorded twist is not that of the recorded cross-level over any base up to 20 m"
            hint = "state geometry.twist_base_m and twist_anchor in the mapping, or leave the channel out"
            findings.append(Finding("warning", "twist-of-no-base", message, hint=hint))
        else:
            base, anchor = base or fit.base_m, anchor or fit.anchor
            columns["twist_mm"] = fit.sign * columns["twist_mm"]
            where = {"behind": "behind", "centre": "around", "ahead": "ahead of"}[fit.anchor]
            message = (
                f"the recorded twist is {'' if fit.sign == 1 else 'minus '}that of the recorded cross-level over "
                f"{fit.base_m:g} m {where} its place, to {fit.left_mm:.3f} mm rms"
            )
            findings.append(Finding("info", "twist-base", message))
    return GeometryConventions(
        gauge_m=gauge_m,
        cross_level_base_m=reading.cross_level_base_m or round(gauge_m + _RAIL_HEAD_M, 3),
        step_m=step,
        twist_base_m=base or _TWIST_BASE_M,
        twist_anchor=anchor or "behind",
        chord_m=reading.chord_m,
        band_m=reading.band_m,
        curvature_base_m=reading.curvature_base_m,
        gradient_base_m=reading.gradient_base_m,
    )


def _complete(columns: dict[str, Array], conventions: GeometryConventions, findings: list[Finding]) -> None:
    """Add what follows from the channels, with a finding for what is less than its name says."""
    step, half = conventions.step_m, 0.5 * conventions.chord_m
    for quantity in ("level", "alignment"):
        for band in ("", "_d0", "_d1", "_d2", "_d3"):
            rails = [columns.get(f"{quantity}_{side}{band}_mm") for side in ("left", "right")]
            if f"{quantity}{band}_mm" not in columns and rails[0] is not None and rails[1] is not None:
                columns[f"{quantity}{band}_mm"] = 0.5 * (rails[0] + rails[1])
    if "twist_mm" not in columns and "cross_level_mm" in columns:
        columns["twist_mm"] = twist(columns["cross_level_mm"], step, conventions.twist_base_m, conventions.twist_anchor)
    if "curvature_1pm" not in columns and "versine_alignment_mm" in columns:
        curvature = -8e-3 * columns["versine_alignment_mm"] / conventions.chord_m**2
        offset = straight_offset(curvature, step)
        columns["curvature_1pm"] = curvature - offset
        columns["versine_alignment_mm"] = columns["versine_alignment_mm"] + offset * conventions.chord_m**2 / 8e-3
        message = (
            f"the curvature is that of the versine over {conventions.chord_m:g} m; on straights the channel had "
            f"{-offset * conventions.chord_m**2 / 8e-3:.3f} mm, which is taken off"
        )
        findings.append(Finding("info", "versine-offset", message))
    for quantity in ("level", "alignment"):
        name = f"versine_{quantity}_mm"
        if name not in columns and f"{quantity}_mm" in columns:
            columns[name] = versine(columns[f"{quantity}_mm"], step, half, half)
            low, high = conventions.band_m
            message = f"{name} is computed from {quantity}_mm: it holds the waves of {low:g}-{high:g} m alone"
            findings.append(Finding("info", "versine-of-a-band", message))


def _geometry(chainage: Array, columns: dict[str, Array], chainage_sd_m: float) -> pd.DataFrame:
    """Return the geometry table in the contract's order; NaN for what is not known."""
    rails = any(name in columns for name in RAIL_COLUMNS)
    names = GEOMETRY_COLUMNS + (RAIL_COLUMNS if rails else ()) + tuple(n for n in BAND_COLUMNS if n in columns)
    nothing = np.full(len(chainage), np.nan)
    table = {name: columns.get(name, nothing) for name in names}
    table["chainage_m"], table["chainage_m_sd"] = chainage, np.full(len(chainage), chainage_sd_m)
    return pd.DataFrame(table, columns=list(names))


def _covariance(chainage: Array, chainage_sd_m: float) -> PlaceCovariance:
    """Return the covariance of errors that are alike over a kilometre, at places 250 m apart."""
    count = max(2, round((chainage[-1] - chainage[0]) / APART_M) + 1)
    places = np.linspace(chainage[0], chainage[-1], count)
    alike = np.exp(-np.abs(places[:, None] - places) / _SAME_ERROR_M)
    return PlaceCovariance.of(places, np.kron(np.diag([chainage_sd_m**2, _CROSS_LEVEL_SD_MM**2]), alike))
