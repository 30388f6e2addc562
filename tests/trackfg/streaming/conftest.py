"""A simulated run as a stream, and what came of it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pandas as pd

from trackfg.config import KeyframeConfig, SmoothConfig
from trackfg.recording import Recording
from trackfg.streaming.fixed_lag import Estimates, FixedLagSmoother

TWICE_A_SECOND = SmoothConfig(keyframes=KeyframeConfig(interval_s=0.5))


def batches(recording: Recording, every_s: float) -> Iterator[dict[str, object]]:
    """The rows of a recording as they come, some at a time."""
    tables = {"imu": recording.imu, "tach": recording.tach, "fixes": recording.fixes, "gnss": recording.gnss}
    begin, end = float(recording.imu["t_s"].iloc[0]), float(recording.imu["t_s"].iloc[-1])
    for t in np.arange(begin, end + every_s, every_s):
        rows: dict[str, object] = {}
        for name, table in tables.items():
            if table is not None:
                now = table[table["t_s"].between(t, t + every_s, inclusive="left")]
                rows[name] = now.to_numpy() if name in ("imu", "tach") else now
        yield rows


class Streamed(NamedTuple):
    smoother: FixedLagSmoother
    filtered: pd.DataFrame
    smoothed: pd.DataFrame
    geometry: pd.DataFrame


def streamed(
    recording: Recording, *, lag_s: float, every_s: float = 0.5, config: SmoothConfig = TWICE_A_SECOND
) -> Streamed:
    smoother = FixedLagSmoother(recording.description, config, lag_s=lag_s, gnss_origin=recording.gnss_origin)
    pieces: list[Estimates] = [smoother.put(**rows) for rows in batches(recording, every_s)]  # type: ignore[arg-type]
    pieces.append(smoother.finish())
    tables = (pd.concat([piece[i] for piece in pieces if len(piece[i])], ignore_index=True) for i in range(3))
    return Streamed(smoother, *tables)
