"""A run's row in the store's catalogue: what it is, how it ended, and the key figures and verdicts of its result."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from trackfg.errors import BadInputError
from trackfg.files.small_file import read_toml
from trackfg.fleet.catalogue import Run
from trackfg.fleet.freshness import Inputs
from trackfg.io.description_reader import locate
from trackfg.results.summary import Estimate, Summary, utc
from trackfg.results.verdict import QUANTITIES

UNKNOWN_MONTH = "unknown"
"""The month of a run whose recording does not say when it was."""

RESULTS = "results"
"""The folder of a store that holds the folders of results."""

EVENT_COUNTS = {"slips": "slip", "slides": "slide", "standstills": "standstill", "imu_gaps": "imu gap"}
"""Columns that count the events of a kind."""

_TEXT, _NUMBER, _COUNT, _FLAG = pa.string(), pa.float64(), pa.int64(), pa.bool_()

PARTITIONS = ("line", "month")
"""Columns that are the names of the catalogue's folders, not in its files: ``line=7/month=2026-05``."""

SCHEMA = pa.schema(
    [
        ("run", _TEXT),
        ("status", _TEXT),
        ("reason", _TEXT),
        ("log", _TEXT),
        ("recording", _TEXT),
        ("recording_id", _TEXT),
        ("result", _TEXT),
        ("start", pa.timestamp("us", tz="UTC")),
        ("tags", _TEXT),
        ("duration_s", _NUMBER),
        ("distance_m", _NUMBER),
        ("from_chainage_m", _NUMBER),
        ("to_chainage_m", _NUMBER),
        ("direction", _COUNT),
        ("anchored", _FLAG),
        ("converged", _FLAG),
        *((name, _COUNT) for name in EVENT_COUNTS),
        ("warnings", _COUNT),
        ("wheel_scale", _NUMBER),
        ("wheel_scale_sd", _NUMBER),
        ("clock_offset_s", _NUMBER),
        ("clock_offset_s_sd", _NUMBER),
        *((f"verdict_{name}", _TEXT) for name in QUANTITIES),
        ("map_recognised_m", _NUMBER),
        ("map_probability", _NUMBER),
        *((name, _TEXT) for name in Inputs._fields),
    ]
)
"""Columns of the files. ``status`` is ``done`` or ``failed``; only those have a ``reason`` and the last lines of a
``log``."""
NEVER_EMPTY = ("run", "status", "recording")
"""Columns that every row has a text in."""


def done_row(run: Run, folder: Path) -> dict[str, Any]:
    """Return the row of a run whose result lies in ``folder``. Raises ``OSError``, ``ValueError`` where it is none."""
    summary = Summary.model_validate_json((folder / "summary.json").read_bytes())
    events = pd.read_csv(folder / "events.csv", usecols=["kind"], dtype=str)["kind"].value_counts()
    chainage = _chainage(folder / "geometry.parquet")
    facts, use = summary.run, summary.map
    start = None if facts is None else facts.start_utc
    return {
        **_head(run, "done", start),
        "recording_id": summary.recording_id,
        "result": f"{RESULTS}/{run.name}",
        "duration_s": summary.duration_s,
        "distance_m": summary.distance_m,
        "from_chainage_m": chainage[0],
        "to_chainage_m": chainage[1],
        "direction": None if facts is None else facts.direction,
        "anchored": None if facts is None else facts.anchored,
        "converged": summary.converged,
        **{name: int(events.get(kind, 0)) for name, kind in EVENT_COUNTS.items()},
        "warnings": sum(finding.level == "warning" for finding in summary.findings),
        **_estimate("wheel_scale", summary.wheel_scale),
        **_estimate("clock_offset_s", summary.clock_offset_s),
        **{f"verdict_{verdict.quantity}": verdict.status for verdict in summary.verdicts},
        "map_recognised_m": None if use is None else use.recognised_m,
        "map_probability": None if use is None else use.probability,
        **Inputs.of_summary(summary.model_dump(mode="json"))._asdict(),
    }


def failed_row(run: Run, reason: str, log: str) -> dict[str, Any]:
    """Return the row of a run without a result."""
    return {**_head(run, "failed", _start_of(run.recording)), "reason": reason, "log": log}


def _head(run: Run, status: str, start: datetime | None) -> dict[str, Any]:
    month = UNKNOWN_MONTH if start is None else f"{start:%Y-%m}"
    head = {"run": run.name, "status": status, "recording": run.recording, "line": run.line}
    return {**dict.fromkeys(SCHEMA.names), **head, "month": month, "start": start, "tags": run.tags}


def _estimate(name: str, estimate: Estimate | None) -> dict[str, float | None]:
    return {} if estimate is None else {name: estimate.value, f"{name}_sd": estimate.sd}


def _chainage(geometry: Path) -> tuple[float | None, float | None]:
    """Return the first and the last chainage of a table of geometry, from what its file says of itself."""
    metadata = pq.read_metadata(geometry)
    column = metadata.schema.names.index("chainage_m")
    parts = [metadata.row_group(group).column(column).statistics for group in range(metadata.num_row_groups)]
    spans = [(part.min, part.max) for part in parts if part is not None and part.has_min_max]
    return (min(low for low, _ in spans), max(high for _, high in spans)) if spans else (None, None)


def _start_of(recording: str) -> datetime | None:
    """Return when a recording of this machine says that it began; None where it cannot be read."""
    try:
        start = read_toml(locate(recording)[1])["start"]
        return utc(start if isinstance(start, str) else start.isoformat())
    except (BadInputError, ValueError, KeyError, AttributeError):
        return None
