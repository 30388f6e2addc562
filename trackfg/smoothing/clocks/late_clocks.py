"""Stamps of other sensors are set to the IMU's clock where they are off by more than the graph allows for.

The graph has a variable for the offset of each clock, in which its factors are linear. But rests, the search for slip,
the first guess and the level of the noise are made from the stamps as they are: they hold an estimate of an offset
near 0, however late the sensor is. So where a solution finds an offset beyond what is declared, the stamps are moved by
it, and the graph is built and solved again, until what remains is within that: a fixed-point iteration. The prior stays
about the clock as declared, with a sigma as large as the offset (empirical Bayes, as in
:mod:`trackfg.smoothing.wide_priors`); states are the remaining offsets, the residuals of their priors the whole ones.

A receiver on a serial line is late by up to 2 s, which is tens of metres. Its stamps are moved before there is a graph,
by the shape of the path (:mod:`trackfg.sensors.gnss_clock`); those of a tach that is as late are in
:mod:`trackfg.checks.tach_correction`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from trackfg.checks.diagnosis_clock import ClockOffset, estimate_clock_offset
from trackfg.factors.factor_type import FactorType
from trackfg.factors.family import Family, changed
from trackfg.factors.states import Kind, vectors
from trackfg.graph.build import Problem
from trackfg.graph.further_sensors import further_sensors
from trackfg.recording.antenna import with_antenna_named
from trackfg.recording.description import FurtherTach, GnssSpeed
from trackfg.recording.findings import Finding
from trackfg.recording.model import GNSS_SPEED_TABLE, Recording
from trackfg.sensors.gnss_clock import gnss_clock
from trackfg.smoothing.reassessment import SolvedRun

_LEAST_S = 0.15
"""Smaller offsets of GNSS are left to the graph, s: what is not linear in them makes 1 cm at 1 m/s^2."""

_SIGMAS = 4.0
"""Offsets of so many of their own sigmas are certain."""

_TACH_SIGMAS = 2.0
"""The tach's clock is set, for the path alone, where it is off by so many sigmas."""

_MOST_ROUNDS = 3
"""The graph is built again so many times at most: each time leaves a third of an offset at worst (ten runs of
``rough-ride``, 0.3 s late)."""


class _Clock(NamedTuple):
    """The offset of the stamps of a ``table`` is an entry of the shared ``variable`` of a kind."""

    table: str
    kind: Kind
    variable: int
    column: int

    def state(self, run: SolvedRun) -> float:
        """Return the offset that remains, the seconds to add to the stamps."""
        return float(vectors(run.solution.states.of(self.kind))[self.variable, self.column])

    def sd(self, run: SolvedRun) -> float:
        """Return its sigma, s."""
        entry = self.kind.dim * self.variable + self.column
        return float(np.sqrt(run.covariance.of(self.kind)[0, entry, entry]))

    def is_of(self, prior: Family) -> bool:
        """Return whether a family is the prior of the variable."""
        return prior.type is FactorType[f"PRIOR_{self.kind.name}"] and int(prior.slots[0].index[0]) == self.variable

    def declared_sd(self, problem: Problem) -> float:
        """Return how far off it was thought to be, s."""
        return next(float(family.sigma[0, self.column]) for family in problem.families if self.is_of(family))


Offsets = dict[_Clock, float]
"""What was added to the stamps of each clock, s."""


def solved_in_time(recording: Recording, solved: Callable[[Recording, Offsets], SolvedRun]) -> SolvedRun:
    """Return the solution of a recording with stamps on the IMU's clock, and a finding for each clock that was set.

    ``solved`` builds and solves the graph of a recording whose stamps were moved by the offsets
    (:func:`with_offsets`).
    """
    clocks, offsets = _clocks(recording), Offsets()
    run = solved(recording, offsets)
    declared = {clock: clock.declared_sd(run.declared) for clock in clocks}

    def is_far(clock: _Clock, offset: float) -> bool:
        return abs(offset) > max(declared[clock], _SIGMAS * clock.sd(run))

    for _ in range(_MOST_ROUNDS):
        if not run.solution.converged or not any(is_far(clock, clock.state(run)) for clock in clocks):
            break
        offsets = {clock: offsets.get(clock, 0.0) + clock.state(run) for clock in clocks}
        run = solved(_moved(recording, offsets), offsets)
    whole = {clock: offset + clock.state(run) for clock, offset in offsets.items()}
    findings = [_set(clock.table, off, clock.sd(run)) for clock, off in whole.items() if is_far(clock, off)]
    return replace(run, findings=(*run.findings, *findings))


def with_offsets(problem: Problem, offsets: Offsets) -> Problem:
    """Return the problem of a recording whose stamps were moved, with priors of the clocks as they were declared."""
    families = problem.families
    for clock, offset in offsets.items():

        def about_declared(prior: Family, clock: _Clock = clock, offset: float = offset) -> Family:
            if not clock.is_of(prior):
                return prior
            mean, sigma = prior.data["mean"].copy(), prior.sigma.copy()
            mean[0, clock.column] = -offset
            sigma[0, clock.column] = max(sigma[0, clock.column], abs(offset))
            return replace(prior, data={"mean": mean}, sigma=sigma)

        families = changed(families, FactorType[f"PRIOR_{clock.kind.name}"], about_declared)
    return replace(problem, families=families)


def with_gnss_in_time(recording: Recording, tach_clock_sd_s: float) -> Recording:
    """Return the recording with the stamps of GNSS on the IMU's clock, and findings where that moved them.

    The receiver's speeds are of the same clock; by what they are later, since it filters them, the graph estimates.

    The path has the tach's speed, and a tach that is late makes positions early: what is not known of its clock, which
    is ``tach_clock_sd_s`` where accelerations do not show it, is not known of the receiver's either.
    """
    if recording.gnss is None:
        return recording
    tach_clock = estimate_clock_offset(recording)
    offset = gnss_clock(_with_tach_set(recording, tach_clock))
    if offset is None:
        return recording
    sd_s = float(np.hypot(offset.sd_s, tach_clock_sd_s if tach_clock is None else tach_clock.sd_s))
    if abs(offset.offset_s) < max(_LEAST_S, _SIGMAS * sd_s):
        return recording
    tables = recording.tables
    of_receiver = [name for name in ("gnss", GNSS_SPEED_TABLE) if name in tables]
    moved = {name: tables[name].assign(t_s=tables[name]["t_s"] + offset.offset_s) for name in of_receiver}
    findings = with_antenna_named([_set(name, offset.offset_s, sd_s) for name in moved], recording.description.gnss)
    others = {name: moved.get(name, table) for name, table in recording.others.items()}
    return replace(recording, gnss=moved["gnss"], others=others, findings=(*recording.findings, *findings))


def gnss_moved_s(declared: Recording, moved: Recording) -> float:
    """Return what was added to the stamps of GNSS between two states of a recording, s."""
    if declared.gnss is None or moved.gnss is None or moved.gnss.empty:
        return 0.0
    return float(moved.gnss["t_s"].iloc[0] - declared.gnss["t_s"].iloc[0])


def _clocks(recording: Recording) -> list[_Clock]:
    """Return the clocks that the graph of a recording has offsets of."""
    further = [
        _Clock(sensor.name, Kind.SENSOR, sensor.variable, 1)
        for sensor in further_sensors(recording.description)
        if isinstance(sensor.part, FurtherTach | GnssSpeed)
    ]
    clocks = [_Clock("tach", Kind.CLOCK, 0, 0), _Clock("gnss", Kind.CLOCK, 0, 2), *further]
    return [clock for clock in clocks if clock.table in recording.tables]


def _moved(recording: Recording, offsets: Offsets) -> Recording:
    """Return the recording with so much added to its stamps."""
    tables = recording.tables
    for clock, offset_s in offsets.items():
        tables[clock.table] = tables[clock.table].assign(t_s=tables[clock.table]["t_s"] + offset_s)
    others = {name: tables[name] for name in recording.others}
    return replace(recording, tach=tables.get("tach"), gnss=tables.get("gnss"), others=others)


def _with_tach_set(recording: Recording, offset: ClockOffset | None) -> Recording:
    """Return the recording with its tach on the IMU's clock, as far as accelerations determine the offset."""
    if recording.tach is None or offset is None or abs(offset.offset_s) < _TACH_SIGMAS * offset.sd_s:
        return recording
    return replace(recording, tach=recording.tach.assign(t_s=recording.tach["t_s"] + offset.offset_s))


def in_words(table: str, offset_s: float) -> str:
    """Say how late or early the stamps of a table are, of the seconds to add to them."""
    return f"the stamps of {table} are {abs(offset_s):.2f} s {'late' if offset_s < 0.0 else 'early'}"


def _set(table: str, offset_s: float, sd_s: float) -> Finding:
    return Finding(
        "warning",
        f"{table.replace('/', '-').replace('_', '-')}-clock",
        f"{in_words(table, offset_s)} (sigma {sd_s:.2f} s); they were moved",
        hint=f"add {offset_s:.2f} to its time_offset_s",
    )
