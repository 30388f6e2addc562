"""Damage done to a recording, for tests of what must cope with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from trackfg.datasets.scenarios import Simulation
from trackfg.datasets.sensors import odometer
from trackfg.datasets.vehicle.adhesion import AdhesionModel, WheelSlip, draw_slip
from trackfg.recording.model import Recording


def drop_imu(recording: Recording, start_s: float, end_s: float) -> Recording:
    """Return a recording without a stretch of its IMU.

    Parameters
    ----------
    recording
        The recording as it is.
    start_s
        Begin of the gap, s.
    end_s
        End of the gap, s: the first sample that stays.

    Returns
    -------
    Recording
        The same without the IMU samples of ``start_s <= t_s < end_s``.

    Examples
    --------
    >>> import trackfg
    >>> from trackfg.datasets import drop_imu
    >>> drop_imu(trackfg.read_recording("run1"), 10.0, 12.0)
    <Recording mainline-seed1-run0: 60.0 s, imu 11600 rows at 200 Hz, tach 3001 rows>
    """
    return replace(recording, imu=_without(recording.imu, start_s, end_s))


def drop_tach(recording: Recording, start_s: float, end_s: float) -> Recording:
    """Return a recording without a stretch of its tachometer; later counts include it.

    Parameters
    ----------
    recording
        The recording as it is.
    start_s
        Begin of the gap, s.
    end_s
        End of the gap, s: the first sample that stays.

    Returns
    -------
    Recording
        The same without the tachometer samples of ``start_s <= t_s < end_s``.

    Examples
    --------
    >>> import trackfg
    >>> from trackfg.datasets import drop_tach
    >>> drop_tach(trackfg.read_recording("run1"), 10.0, 12.0)
    <Recording mainline-seed1-run0: 60.0 s, imu 12000 rows at 200 Hz, tach 2901 rows>
    """
    if recording.tach is None:
        return recording
    return replace(recording, tach=_without(recording.tach, start_s, end_s))


def slip_wheel(run: Simulation, events: Sequence[WheelSlip]) -> Simulation:
    """Return a run with its wheel slipping and sliding besides: in its count and in ``slips``.

    What the wheel did before stays.

    Parameters
    ----------
    run
        What :func:`simulate` returns.
    events
        When, how long, s, and how much: creep above 0 is a slip, below 0 a slide.

    Returns
    -------
    Simulation
        The run with these events.

    Raises
    ------
    ValueError
        For events that overlap, and for a tach that does not count.

    Examples
    --------
    >>> from trackfg.datasets import simulate, slip_wheel
    >>> from trackfg.datasets.vehicle.adhesion import WheelSlip
    >>> run = slip_wheel(simulate("mainline", duration_s=60.0), [WheelSlip(start_s=45.0, duration_s=3.0, creep=0.1)])
    >>> run.slips["kind"].tolist()
    ['slip']
    """
    recording, tach = run.recording, run.recording.description.tach
    if recording.tach is None or tach is None or tach.kind != "pulses":
        raise ValueError("a tach that counts pulses is needed")
    model = odometer.TachModel(
        pulses_per_rev=float(tach.pulses_per_rev or 0.0),
        wheel_diameter_m=float(tach.wheel_diameter_m or 0.0),
        signed=tach.signed,
    )
    placed = AdhesionModel(top_creep=0.0, events=tuple(events))
    slip = draw_slip(run.ride, placed, run.ride.motion.duration_s, np.random.default_rng(0))
    t = recording.tach["t_s"].to_numpy()
    rolled, original = (odometer.rolled_distance(run.ride, model, t, wheel_slip) for wheel_slip in (slip, None))
    count = np.round(recording.tach["distance_m"].to_numpy() / model.quantum_m)
    # Half a pulse: where between two pulses the wheel was is not known, and on the average it was in the middle.
    count = np.floor(count + 0.5 + (rolled - original) / run.wheel_scale / model.quantum_m)
    count = count if model.signed else np.maximum.accumulate(count)
    table = recording.tach.assign(distance_m=count * model.quantum_m)
    slips = odometer.slip_table(run.ride, model, slip)
    return replace(run, recording=replace(recording, tach=table), slips=slips)


def _without(table: pd.DataFrame, start_s: float, end_s: float) -> pd.DataFrame:
    kept = (table["t_s"] < start_s) | (table["t_s"] >= end_s)
    return table[kept].reset_index(drop=True)
