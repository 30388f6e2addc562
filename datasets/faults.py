"""Damage done to a recording, for tests of what must cope with it."""

from __future__ import annotations

from dataclasses import replace

import pandas as pd

from trackfg.recording import Recording


def drop_imu(recording: Recording, start_s: float, end_s: float) -> Recording:
    """The recording without the IMU samples of ``start_s <= t_s < end_s``."""
    return replace(recording, imu=_without(recording.imu, start_s, end_s))


def drop_tach(recording: Recording, start_s: float, end_s: float) -> Recording:
    """The recording without the tachometer samples of ``start_s <= t_s < end_s``; the count goes on meanwhile."""
    if recording.tach is None:
        return recording
    return replace(recording, tach=_without(recording.tach, start_s, end_s))


def _without(table: pd.DataFrame, start_s: float, end_s: float) -> pd.DataFrame:
    kept = (table["t_s"] < start_s) | (table["t_s"] >= end_s)
    return table[kept].reset_index(drop=True)
