"""A sensor without weight most of the time contradicts all others, and the solution is one without it: a finding.

A receiver's speeds in another unit would bend the solution before they lose their weight, each
known to 0.1 m/s. Where its own positions contradict them they are left out beforehand.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from trackfg.checks.diagnosis_wheel import receiver_speed_scale
from trackfg.checks.limits import CheckLimits
from trackfg.checks.receiver_speeds import receiver_speed_findings
from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family
from trackfg.factors.states import States
from trackfg.numerics.arrays import Array
from trackfg.numerics.units import KMH
from trackfg.recording.findings import Finding
from trackfg.recording.model import GNSS_SPEED_TABLE, Recording
from trackfg.recording.unmeasured_rows import unmeasured_in
from trackfg.results.verdict import QUANTITIES, Doubt, Quantity
from trackfg.smoothing.reassessment import Reassessment, SolvedRun

_NO_WEIGHT = 0.1
"""A measurement with less of its weight than this hardly moves the solution: with Huber's loss it is 30 sigmas off."""

_MOST = 0.5
"""Share of such measurements from which on most of a sensor is given up, and not outliers."""

_FEWEST = 4
"""Of fewer measurements a share says nothing."""

_MOVING_MPS = 0.3
"""At rest a tachometer that is wrong by a factor agrees, and so does any direction of travel."""

_NO_WEIGHT_SD = 1e3
"""A sigma from here on, m or m/s, marks a measurement without information, as of a tach in a gap."""

_UNIT = 0.05
"""A ratio of speeds this near to that of two units is due to them: wheels wear by 5 % of their diameter at most."""


class _Sensor(NamedTuple):
    """A sensor: what its measurements are called, the quantities that rest on them where nothing else measures, what
    else does, and what to do.
    """

    name: str
    quantities: tuple[Quantity, ...]
    instead: tuple[FactorType, ...]
    hint: str


_POSITIONS = (FactorType.ABSOLUTE_FIX, FactorType.GNSS_POSITION)
_WITH_SENSE: tuple[Quantity, ...] = tuple(quantity for quantity in QUANTITIES if quantity not in ("position", "height"))
"""What is wrong where the vehicle goes the other way than it seems to: positions do not show which end is ahead."""

_SENSORS = {
    FactorType.TACH_DISTANCE: _Sensor(
        "the tachometer's distances", ("chainage", "speed"), _POSITIONS, "check unit, sign and clock of [tach]"
    ),
    FactorType.GNSS_POSITION: _Sensor(
        "the GNSS positions", ("position", "height"), (), "check origin, clock, lever arm and sigmas of [gnss]"
    ),
    FactorType.GNSS_SPEED: _Sensor(
        "the receiver's speeds",
        ("chainage", "speed"),
        (FactorType.TACH_DISTANCE, *_POSITIONS),
        "check unit, clock and sigmas of [gnss_speed]",
    ),
    FactorType.ABSOLUTE_FIX: _Sensor(
        "the fixes", ("chainage",), (), "check the chainages of the fixes, their sigmas and track.direction"
    ),
    FactorType.NON_HOLONOMIC: _Sensor(
        "motion along the vehicle's axis",
        ("position", "height", "pitch", "yaw"),
        (FactorType.GNSS_POSITION,),
        "check imu.axes, the units of the IMU and the sign of the tachometer; trackfg check distinguishes them",
    ),
}


def without_unmeasured_rows(recording: Recording) -> Recording:
    """Return the recording without rows of its receiver that are held or interpolated, with a finding."""
    unmeasured = unmeasured_in(recording)
    if not unmeasured:
        return recording
    findings = (replace(finding, message=f"{finding.message}; they are left out") for _, finding in unmeasured.values())
    tables = {name: recording.tables[name][~rows].reset_index(drop=True) for name, (rows, _) in unmeasured.items()}
    return replace(recording.with_tables(tables), findings=(*recording.findings, *findings))


def without_contradicted_speeds(recording: Recording, limits: CheckLimits) -> Recording:
    """Return the recording without its receiver's speeds where positions or tach contradict them, with a finding."""
    scale = receiver_speed_scale(recording.others.get(GNSS_SPEED_TABLE), recording.gnss, recording.tach)
    contradictions = receiver_speed_findings(recording.description.gnss_speed, scale, limits)
    if not contradictions:
        return recording
    findings = (replace(finding, message=f"{finding.message}; they are left out") for finding in contradictions)
    others = {name: table for name, table in recording.others.items() if name != GNSS_SPEED_TABLE}
    return replace(recording, others=others, findings=(*recording.findings, *findings))


def weightless_sensors(run: SolvedRun) -> Reassessment:
    """Reassess whether measurements have weight: a finding where not, and a doubt of what nothing else measures."""
    states, families = run.solution.states, run.problem.families
    shares = {family.type: _weightless_share(family, states) for family in families if family.type in _SENSORS}
    findings: list[Finding] = []
    doubts: list[Doubt] = []
    for family in families:
        if shares.get(family.type, 0.0) <= _MOST:
            continue
        ratio = None
        if family.type is FactorType.TACH_DISTANCE:
            ratio = TachRows.of(family, states).usually_moved
        contradiction = contradiction_of(family.type, shares[family.type], ratio)
        findings.append(Finding("warning", "without-weight", contradiction.reason, hint=contradiction.hint))
        instead = any(shares.get(other, 1.0) <= _MOST for other in _SENSORS[family.type].instead)
        doubts += contradiction.doubts(instead=instead)
    return Reassessment(run.problem, tuple(findings), tuple(doubts))


class Contradiction(NamedTuple):
    """A sensor without weight contradicts all others: the ``reason``, what to do, and which ``quantities`` rest on it;
    ``always``: whether these also do where something else measures them.
    """

    reason: str
    hint: str
    quantities: tuple[Quantity, ...]
    always: bool

    def doubts(self, *, instead: bool) -> tuple[Doubt, ...]:
        """Return the doubt of the quantities; none where something else measures them ``instead``."""
        if instead and not self.always:
            return ()
        return (Doubt(self.quantities, np.inf, self.reason, self.hint),)


def contradiction_of(kind: FactorType, share: float, ratio: float | None = None) -> Contradiction:
    """Return what a sensor contradicts of whose measurements a ``share`` has no weight.

    ``ratio``: how many times as far as a tach counts the vehicle moves, where that is known.
    """
    sensor = _SENSORS[kind]
    reason = f"{sensor.name} contradict the other sensors and {100 * share:.0f} % of them have no weight"
    if ratio is None:
        return Contradiction(reason, sensor.hint, sensor.quantities, always=False)
    backwards = ratio < 0.0
    quantities = _WITH_SENSE if backwards else sensor.quantities
    return Contradiction(reason + _in_words(ratio), sensor.hint, quantities, always=backwards)


class TachRows(NamedTuple):
    """Distances of a tach in motion, each up to its ``last_keyframe`` (m,): whether they are ``weightless`` (m,), and
    how many times as far as each says the vehicle ``moved`` (m,), NaN where it counts nothing.
    """

    last_keyframe: np.ndarray
    weightless: np.ndarray
    moved: Array

    @classmethod
    def of(cls, family: Family, states: States) -> TachRows:
        """Return those of a ``family`` of a tach's distances."""
        moving = _moving(family, np.linalg.norm(states.nav.v, axis=1))
        k = family.last_keyframe[moving]
        counted = states.odo.count[k] - states.odo.count[k - 1]
        moved = np.divide(states.odo.step[k], counted, out=np.full(len(k), np.nan), where=counted != 0.0)
        return cls(k, family.weights(states)[moving] < _NO_WEIGHT, moved)

    @property
    def usually_moved(self) -> float | None:
        """The median of how many times as far the vehicle moves; None where the tach counts nothing."""
        return float(np.nanmedian(self.moved)) if np.isfinite(self.moved).any() else None

    @property
    def contradiction(self) -> Contradiction | None:
        """What the tach contradicts; None unless most of its distances have no weight."""
        share = float(np.mean(self.weightless)) if len(self.weightless) >= _FEWEST else 0.0
        return contradiction_of(FactorType.TACH_DISTANCE, share, self.usually_moved) if share > _MOST else None


def _weightless_share(family: Family, states: States) -> float:
    """Return the share of its measurements in motion without weight; 0 where there are too few."""
    speed = np.linalg.norm(states.nav.v, axis=1)
    known = _moving(family, speed)
    return float(np.mean(family.weights(states)[known] < _NO_WEIGHT)) if known.sum() >= _FEWEST else 0.0


def _moving(family: Family, speed: np.ndarray) -> np.ndarray:
    """Return which factors lie in motion with a sigma that gives them a weight; of fixes all."""
    if family.type is FactorType.ABSOLUTE_FIX:
        return np.ones(len(family), dtype=bool)
    slow = np.minimum(speed[family.first_keyframe], speed[family.last_keyframe])
    return np.asarray((slow > _MOVING_MPS) & (family.sigma[:, 0] < _NO_WEIGHT_SD))


def _in_words(ratio: float) -> str:
    """Say that the vehicle moves ``ratio`` times as far as the wheel counts, and whether that is a unit's."""
    text = f"; the vehicle moves {ratio:.3g} times as far as they say"
    for unit_ratio, meaning in (
        (KMH, "they are in km/h, declared in m/s"),
        (1.0 / KMH, "they are in m/s, declared in km/h"),
    ):
        if abs(ratio / unit_ratio - 1.0) < _UNIT:
            return f"{text}: {meaning}"
    return text
