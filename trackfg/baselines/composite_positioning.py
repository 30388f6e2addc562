"""Train positioning by tachometer and inertial sensor.

Iwata, Yamamichi, Sugiyama and Kitano, "A train position detection system using inertial sensors together with
tachometer generators".

The tachometer counts the distance. While it cannot be trusted, from the start point before a detected slip or slide
(:mod:`trackfg.baselines.slip_detection`) to re-adhesion, gravity-compensated integration of the inertial sensor
replaces it (:mod:`trackfg.baselines.gravity_compensated`). The position is set anew at balises and at curves of a table
(:mod:`trackfg.baselines.curve_points`). The safety margin, by which the train is taken to be longer than it is, is a
part of the distance since the position was last set, and the correction of one slip:

    margin = 0.02 distance + 20 m.

The inertial sensor's zero is taken at stops; docs/baselines/composite-positioning.md has what else was settled here.

Distances are the nominal wheel's, as in the paper, where the error of a corrected distance is against the tachometer's
own distance on runs without slip.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd

from trackfg.baselines.curve_points import CurvePoints, find_curve
from trackfg.baselines.gravity_compensated import Coasting, VehicleState, coast, readhesion, start_state
from trackfg.baselines.result import BaselineResult, filled, recorded
from trackfg.baselines.slip_detection import Cycles, JerkRule, detections, read_cycles, start_point
from trackfg.numerics.arrays import Array
from trackfg.recording.model import Recording
from trackfg.results.columns import EVENT_COLUMNS, TRAJECTORY_COLUMNS
from trackfg.results.events import no_events

_SEARCH_S = 10.0
"""How far back a start point may lie, s; where there is none, it is the setback itself. Assumed: the paper says no
limit, and 10 s is as long as its bound of the error is for."""


@dataclass(frozen=True)
class CompositeParameters:
    """The parameters of composite positioning; the defaults are the paper's.

    ``setback_s = 0`` searches the start point from the detection backwards. ``pitch_correction = False`` is the paper's
    comparison, which integrates the pitch rate as measured. ``as_printed`` takes (5), (6), (11) and, unless ``eq12``
    says otherwise, (12) as they are printed. ``reset_at_fixes = False`` sets the chainage at the first balise only. The
    safety margin is ``margin_of_distance`` times the distance, and ``margin_of_slip_m``.
    """

    cycle_s: float = 0.1
    average_s: float = 3.0
    threshold_kmhps: float = 1.23
    jerk: JerkRule = field(default_factory=JerkRule)
    setback_s: float = 2.1
    speed_tolerance_kmhps: float = 0.41
    longest_s: float = 10.0
    pitch_correction: bool = True
    eq12: bool | None = None
    reset_at_fixes: bool = True
    margin_of_distance: float = 0.02
    margin_of_slip_m: float = 20.0
    as_printed: bool = False

    def coast(self, cycles: Cycles, start: VehicleState) -> Coasting:
        """Integrate the inertial sensor from a state."""
        eq12 = self.as_printed if self.eq12 is None else self.eq12
        return coast(
            cycles, start, self.longest_s, pitch_correction=self.pitch_correction, eq12=eq12, as_printed=self.as_printed
        )


def run(recording: Recording, *, curve_points: Sequence[CurvePoints] = (), **parameters: Any) -> BaselineResult:
    """Estimate chainage, speed and slips, ten rows a second; the trajectory's ``margin_m`` is the safety margin.

    ``parameters`` are fields of :class:`CompositeParameters`. Chainage starts so that the first balise comes out right,
    with ``reset_at_fixes`` or without it, and at 0 where there are none. Events are slips and slides with the distance
    taken off, balises, and the curves of the table that were passed, used or refused.

    Raises ``BadInputError`` without a tachometer, or where the record is shorter than an average.
    """
    p = CompositeParameters(**parameters)
    cycles = read_cycles(recording, cycle_s=p.cycle_s, average_s=p.average_s)
    steady = p.jerk.steady(cycles)
    beyond = np.flatnonzero(detections(cycles, p.threshold_kmhps))
    slips: list[_Slip] = []
    n = 0
    while n < len(beyond):
        detected = int(beyond[n])
        start, by_jerk_rule = _start(cycles, steady, detected, slips, p)
        way = p.coast(cycles, start)
        end = readhesion(
            cycles, way, detected, threshold_kmhps=p.threshold_kmhps, speed_tolerance_kmhps=p.speed_tolerance_kmhps
        )
        slip = _Slip.until(cycles, way, detected, by_jerk_rule, end)
        if slips and start.cycle == slips[-1].final.cycle:
            slips[-1] = slips[-1].followed_by(slip)
        else:
            slips.append(slip)
        n = int(np.searchsorted(beyond, slip.final.cycle, side="right"))

    direction = recording.description.track.direction
    distance, speed = _corrected(cycles, slips)
    position = _Position.begin(cycles.t, direction * distance, recording, p.reset_at_fixes)
    slipping = np.zeros(len(cycles), dtype=bool)
    for slip in slips:
        slipping[slip.start : slip.final.cycle + 1] = True
    for curve in sorted(curve_points, key=lambda curve: direction * curve.enter_m):
        position.look_for(curve, cycles, slipping, direction)

    since = np.abs(distance - distance[position.set_at])
    trajectory = filled(
        TRAJECTORY_COLUMNS, {"t_s": cycles.t, "chainage_m": position.chainage, "speed_mps": speed}
    ).assign(margin_m=p.margin_of_distance * since + p.margin_of_slip_m)
    return BaselineResult(
        name="composite positioning",
        trajectory=trajectory,
        events=_events(cycles, slips, position),
        parameters=recorded(p),
    )


def survey(recording: Recording, *, cycle_s: float = 0.1, average_s: float = 3.0) -> pd.DataFrame:
    """Return ``chainage_m, curvature_1pm`` as the system measures them, every metre: what a table of curves is made of.

    Chainage is set at balises; slips are left out.
    """
    cycles = read_cycles(recording, cycle_s=cycle_s, average_s=average_s)
    result = run(recording, cycle_s=cycle_s, average_s=average_s)
    chainage = result.trajectory["chainage_m"].to_numpy()
    place, curvature = _measured_curvature(cycles, chainage, recording.description.track.direction)
    slips = result.events[result.events["kind"].isin(["slip", "slide"])]
    known = cycles.mean_speed > 1.0
    for start, end in zip(slips["start_s"], slips["end_s"], strict=True):
        known &= (cycles.t < start) | (cycles.t > end + average_s)
    order = np.argsort(place[known], kind="stable")
    place, curvature = place[known][order], curvature[known][order]
    at = np.arange(np.ceil(place[0]), place[-1]) if place.size else np.zeros(0)
    return pd.DataFrame({"chainage_m": at, "curvature_1pm": np.interp(at, place, curvature) if place.size else at})


@dataclass(frozen=True)
class _Slip:
    """A correction: ``distance`` and ``speed`` replace the wheel's, one value for each cycle from start to final.

    ``by_jerk_rule``: a start point met the jerk rule. ``readhered``: it did not just run out of time.
    """

    kind: str
    detected: int
    start: int
    by_jerk_rule: bool
    readhered: bool
    speed: Array
    distance: Array
    final: VehicleState

    @classmethod
    def until(cls, cycles: Cycles, way: Coasting, detected: int, by_jerk_rule: bool, end: int | None) -> _Slip:
        """Return what was integrated, up to the re-adhesion at cycle ``end``; all of it where that is None."""
        n = len(way.speed) - 1 if end is None else end - way.start
        return cls(
            kind="slip" if cycles.disagreement[detected] < 0.0 else "slide",
            detected=detected,
            start=way.start,
            by_jerk_rule=by_jerk_rule,
            readhered=end is not None,
            speed=way.speed[: n + 1],
            distance=way.distance[: n + 1],
            final=VehicleState(way.start + n, float(way.speed[n]), float(way.pitch[n]), float(way.roll[n])),
        )

    def followed_by(self, other: _Slip) -> _Slip:
        """Return both as one, ``other`` having continued from this one's final state."""
        return replace(
            self,
            readhered=other.readhered,
            speed=np.concatenate([self.speed, other.speed[1:]]),
            distance=np.concatenate([self.distance, self.distance[-1] + other.distance[1:]]),
            final=other.final,
        )


def _start(
    cycles: Cycles, steady: np.ndarray, detected: int, slips: list[_Slip], p: CompositeParameters
) -> tuple[VehicleState, bool]:
    """Return where to begin, and whether the jerk rule found it."""
    half = cycles.window // 2
    earliest = max(detected - round(_SEARCH_S / cycles.step_s), 1)
    if slips:
        earliest = max(earliest, slips[-1].final.cycle + half)
    picked = start_point(cycles, steady, detected, p.setback_s, earliest)
    if picked is not None:
        return start_state(cycles, picked, as_printed=p.as_printed), True
    setback = detected - round(p.setback_s / cycles.step_s)
    if slips and setback < slips[-1].final.cycle + half:
        return slips[-1].final, False
    return start_state(cycles, max(setback, 1), as_printed=p.as_printed), False


def _corrected(cycles: Cycles, slips: list[_Slip]) -> tuple[Array, Array]:
    """Return distance and speed with the slips' parts replaced. Shapes (n,)."""
    steps = np.diff(cycles.distance, prepend=cycles.distance[0])
    # Half a second of pulses: the speed of one cycle is good to 0.3 m/s only.
    speed = np.convolve(np.pad(cycles.speed, 2, mode="edge"), np.full(5, 0.2), mode="valid")
    for slip in slips:
        rows = slice(slip.start + 1, slip.final.cycle + 1)
        steps[rows] = np.diff(slip.distance)
        speed[rows] = slip.speed[1:]
    return cycles.distance[0] + np.cumsum(steps), speed


@dataclass
class _Position:
    """The chainage at the cycles, and at which cycle it was last set, as fixes and curves come in. Shapes (n,)."""

    t: Array
    chainage: Array
    set_at: np.ndarray
    rows: list[tuple[str, float, float, str]]

    @classmethod
    def begin(cls, t: Array, odometer: Array, recording: Recording, reset: bool) -> _Position:
        position = cls(t, odometer.copy(), np.zeros(len(t), dtype=np.int64), [])
        if recording.fixes is None or recording.fixes.empty:
            return position
        fixes = recording.fixes.sort_values("t_s")
        for n, (at, chainage_m) in enumerate(zip(fixes["t_s"], fixes["chainage_m"], strict=True)):
            i = int(np.searchsorted(t, at))
            if i >= len(t):
                break
            step = chainage_m - float(np.interp(at, t, position.chainage))
            if n == 0:
                position.chainage += step
            elif reset:
                position._set(i, step)
            if n == 0 or reset:
                position.set_at[i:] = i
                position.rows.append(("fix used", at, float(chainage_m), f"position set by {step:+.2f} m"))
        return position

    def _set(self, i: int, step: float, until: int | None = None) -> None:
        self.chainage[i:until] += step
        self.set_at[i:until] = i

    def look_for(self, curve: CurvePoints, cycles: Cycles, slipping: np.ndarray, direction: int) -> None:
        """Correct the position by a curve, from where its exit straight is checked to the next balise."""
        place, curvature = _measured_curvature(cycles, self.chainage, direction)
        sighting = find_curve(curve, place, curvature, cycles.mean_speed, slipping, direction)
        if sighting is None:
            return
        kind = "curve refused" if sighting.refused else "curve used"
        what = sighting.refused or f"position set by {sighting.correction_m:+.2f} m"
        what = f"R {1.0 / abs(curve.curvature_1pm):.0f}, {what}"
        self.rows.append((kind, float(self.t[sighting.left]), sighting.place_m, what))
        if not sighting.refused:
            ahead = np.flatnonzero(self.set_at > sighting.checked)
            self._set(sighting.checked, sighting.correction_m, int(ahead[0]) if ahead.size else None)


def _measured_curvature(cycles: Cycles, chainage: Array, direction: int) -> tuple[Array, Array]:
    """Return places, m, and the curvatures facing increasing chainage, 1/m, over what was run during an average.

    Both (n,); the curvature is 0 where that is less than a metre.
    """
    window, time_s = cycles.window, cycles.window * cycles.step_s
    start = np.concatenate([np.full(window, chainage[0]), chainage[:-window]])
    turned, base = direction * cycles.mean_gyro[:, 2] * time_s, np.abs(cycles.mean_speed) * time_s
    moving = base > 1.0
    return 0.5 * (start + chainage), np.where(moving, turned / np.where(moving, base, 1.0), 0.0)


def _events(cycles: Cycles, slips: list[_Slip], position: _Position) -> pd.DataFrame:
    rows: list[dict[str, float | str]] = []
    for slip in slips:
        wheel = cycles.distance[slip.final.cycle] - cycles.distance[slip.start]
        detail = f"detected at {cycles.t[slip.detected]:.1f} s"
        detail += "" if slip.by_jerk_rule else ", no start point met the jerk rule"
        detail += "" if slip.readhered else ", no re-adhesion"
        rows.append(
            {
                "kind": slip.kind,
                "start_s": float(cycles.t[slip.start]),
                "end_s": float(cycles.t[slip.final.cycle]),
                "chainage_m": float(position.chainage[slip.start]),
                "distance_removed_m": float(wheel - (slip.distance[-1])),
                "detail": detail,
            }
        )
    rows += [
        {"kind": kind, "start_s": t, "end_s": t, "chainage_m": place, "detail": detail}
        for kind, t, place, detail in position.rows
    ]
    if not rows:
        return no_events()
    table = pd.DataFrame(rows, columns=list(EVENT_COLUMNS)).astype(
        {"chainage_m_sd": float, "distance_removed_m_sd": float}
    )
    return table.sort_values("start_s", ignore_index=True)
