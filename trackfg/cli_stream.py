"""``trackfg stream``: estimates while rows arrive."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from trackfg.errors import BadInputError

if TYPE_CHECKING:
    from trackfg.streaming.sources import Source

_STANDARD = "-"


def stream(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE", help="Folder of a recording, an MCAP file, or - for JSON lines.", show_default=False
        ),
    ],
    out: Annotated[
        str, typer.Option("-o", "--out", metavar="OUT", help="Folder for Parquet parts, or - for JSON lines.")
    ],
    lag: Annotated[
        float, typer.Option(metavar="S", help="Smoothed estimates come this much later than the newest rows.")
    ] = 10.0,
    config: Annotated[
        Path | None, typer.Option(metavar="C.toml", help="Settings other than the defaults.", show_default=False)
    ] = None,
    real_time: Annotated[
        bool, typer.Option("--real-time", help="Replay a recording as fast as it was made, not as fast as it can be.")
    ] = False,
) -> None:
    """Estimate while rows arrive: at once, and smoothed once the lag is over.

    In OUT are the tables filtered, smoothed, geometry and events, in parts.
    """
    from trackfg.config import SmoothConfig
    from trackfg.own_folder import refuse_used
    from trackfg.streaming.fixed_lag import FixedLagSmoother
    from trackfg.streaming.parquet_parts import ParquetParts
    from trackfg.streaming.run import run_stream
    from trackfg.streaming.sinks import JsonLines, Sink

    settings = SmoothConfig.from_toml(config) if config else None
    if out != _STANDARD:
        refuse_used(Path(out), "a stream is never added to another")
    rows = _source(source, real_time=real_time)
    smoother = FixedLagSmoother(rows.description, settings, lag_s=lag)
    sink: Sink = JsonLines(sys.stdout) if out == _STANDARD else ParquetParts(out)
    counts = run_stream(rows, smoother, sink)
    events = ", ".join(f"{number} {kind}" for kind, number in sorted(counts.events.items())) or "no events"
    print(
        f"{counts.rows_in} rows, {counts.rows_used} of them used; {counts.keyframes} keyframes; {events}",
        file=sys.stderr,
    )


def _source(name: str, *, real_time: bool) -> Source:
    from trackfg.streaming.sources import RecordingSource

    if real_time and (name == _STANDARD or not Path(name).is_dir()):
        raise BadInputError(f"--real-time {name}: expected the folder of a recording: other rows come when they come")
    if name == _STANDARD:
        from trackfg.streaming.json_lines_source import JsonLinesSource

        return JsonLinesSource(sys.stdin.buffer)
    if Path(name).is_file():
        from trackfg.streaming.mcap_source import McapSource

        return McapSource(name)
    from trackfg.recording_io import read_recording

    return RecordingSource(read_recording(name), speed=1.0 if real_time else None)
