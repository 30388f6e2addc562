"""``trackfg stream``: estimates while rows arrive."""

from __future__ import annotations

import json as json_text
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from trackfg.cli.options import PORT, Config, Port, newest_map, with_options
from trackfg.cli.terminal import complain, note, progress_bar
from trackfg.errors import BadInputError, counted

if TYPE_CHECKING:
    from trackfg.streaming.checkpoint.checkpoint import Checkpoint
    from trackfg.streaming.run import Stream, StreamStep
    from trackfg.streaming.sources.source import Source
    from trackfg.streaming.stream_counts import StreamCounts

_STANDARD = "-"
_CHECKPOINT = "checkpoint"
_ONLY_SMOOTHED = ("balises", "known_line")
"""Sections of a recording that a stream does not use."""


@dataclass(frozen=True)
class StreamOptions:
    """The options of ``trackfg stream``."""

    source: Annotated[
        str, typer.Argument(metavar="SOURCE", help="Folder of a recording, an MCAP file, or - for JSON lines.")
    ]
    out: Annotated[
        str, typer.Option("-o", "--out", metavar="OUT", help="Folder for Parquet parts, or - for JSON lines.")
    ]
    lag: Annotated[
        float, typer.Option(metavar="S", help="Smoothed estimates come this many seconds later than the newest rows.")
    ] = 10.0
    config: Config = None
    map_location: Annotated[
        str | None, typer.Option("--map", metavar="MAP", help="A map to be located on: its newest version.")
    ] = None
    real_time: Annotated[
        bool, typer.Option("--real-time", help="Replay a recording as fast as it was made, not as fast as it can be.")
    ] = False
    checkpoint_every: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            help="Seconds of the stream from one checkpoint in OUT to the next. Unless given, 60, and five seconds of "
            "the computer's time.",
        ),
    ] = None
    view: Annotated[
        bool, typer.Option("--view", help="Serve a live page at 127.0.0.1, for a browser on this machine.")
    ] = False
    port: Port = PORT
    json: Annotated[bool, typer.Option("--json", help="Print what came of it as JSON, with OUT a folder.")] = False
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with the unfinished stream in OUT, from its last checkpoint.")
    ] = False
    from_now: Annotated[
        bool,
        typer.Option(
            "--from-now", help="With --resume and SOURCE -: its lines go on from now; those that were missed are a gap."
        ),
    ] = False


@with_options(StreamOptions)
def stream(options: StreamOptions) -> None:
    """Estimate while rows arrive: at once, and smoothed once the lag is over.

    In OUT are the tables filtered, smoothed, geometry and events, in parts. A stream that was killed goes on with
    --resume, as if it had not been; rows from standard input have to come again from the first one, or, with
    --from-now, are those of a live feed, which cannot send them again.
    """
    from trackfg.config import SmoothConfig
    from trackfg.streaming.fixed_lag import FixedLagSmoother
    from trackfg.streaming.run import Stream
    from trackfg.streaming.sinks.sink import JsonLines

    settings = SmoothConfig.from_toml(options.config) if options.config else None
    feature_map = newest_map(options.map_location)

    def opened(saved: Checkpoint | None) -> Stream:
        position = saved.position if saved is not None and not options.from_now else 0
        rows = _source(options, position)
        smoother = FixedLagSmoother(rows.description, settings, lag_s=options.lag, feature_map=feature_map)
        return Stream.of(rows, smoother, saved, from_now=options.from_now)

    into_folder = options.out != _STANDARD
    if not into_folder and (options.resume or options.checkpoint_every is not None):
        raise BadInputError("-o -: expected a folder: what was written to standard output cannot be taken back")
    if options.from_now and not (options.resume and options.source == _STANDARD):
        raise BadInputError("--from-now: expected --resume and - as the source: anything else can be read again")
    if options.json and not into_folder:
        raise BadInputError("--json: the rows on standard output are JSON already; expected -o with a folder")
    with _view(options) as show, _status_line(shown=into_folder or not sys.stdout.isatty()) as tell_status:

        def watch(step: StreamStep) -> None:
            show(step)
            tell_status(step)

        if into_folder:
            counts = _into_folder(options, opened, watch)
        else:
            counts = opened(None).run(JsonLines(sys.stdout), watch=watch)
    if counts is None:
        note(f"{options.out}: the stream in it is finished")
        return
    if options.json:
        print(json_text.dumps(vars(counts), indent=2))
    events = ", ".join(f"{number} {kind}" for kind, number in sorted(counts.events.items())) or "no events"
    note(f"{counts.rows_in} rows, {counts.rows_used} of them used; {counts.keyframes} keyframes; {events}")
    if 2 * counts.rows_used < counts.rows_in:
        complain(
            f"trackfg: warning: {counts.rows_in - counts.rows_used} of {counts.rows_in} rows were dropped, so that the "
            "estimates are of little worth. Hint: the table events says why; rows of a table have to come nearly in "
            "the order of their times"
        )
    for loss in counts.losses():
        complain(f"trackfg: warning: {loss}")
    if not counts.keyframes:
        complain(
            "trackfg: warning: no estimates: expected more than 10 s in which the IMU and the tach, or the IMU and "
            "GNSS, have rows"
        )
    for doubt in counts.doubts.values():
        complain(f"trackfg: warning: {doubt}")


@contextmanager
def _view(options: StreamOptions) -> Iterator[Callable[[StreamStep], None]]:
    """Serve a page of the stream where that is asked for."""
    if not options.view:
        yield lambda step: None
        return
    from trackfg.streaming.view.live_server import serving
    from trackfg.streaming.view.live_state import LiveState

    name = "standard input" if options.source == _STANDARD else Path(options.source).name
    state = LiveState(name, options.lag)
    with serving(state, options.port) as address:
        print(f"view: {address}", file=sys.stderr)
        yield state.watch


@contextmanager
def _status_line(*, shown: bool) -> Iterator[Callable[[StreamStep], None]]:
    """Give what shows the newest estimate, its delay and the number of events in one line of a terminal."""
    if not shown:
        yield lambda step: None
        return
    with progress_bar() as progress:
        events, text = 0, "waits for its first rows"

        def watch(step: StreamStep) -> None:
            nonlocal events, text
            events += len(step.events)
            if len(step.estimates.filtered):
                text = _status(step)
            if progress is not None:
                progress(f"{text} {counted(events, 'event')}", step.done)

        yield watch


def _status(step: StreamStep) -> str:
    newest = step.estimates.filtered.iloc[-1]
    place, speed = newest["chainage_m"], 3.6 * newest["speed_mps"]
    return f"{newest['t_s']:.1f} s {place:z.1f} m {speed:z.1f} km/h delay {step.delay_s or 0.0:.1f} s"


_NEVER_ADDED = "a stream is never added to another"


def _into_folder(
    options: StreamOptions, opened: Callable[[Checkpoint | None], Stream], watch: Callable[[StreamStep], None]
) -> StreamCounts | None:
    """Begin a stream in a folder, or go on with the one in it; None where that is finished."""
    from trackfg.files.atomic_file import UNFINISHED
    from trackfg.files.owned_folder import refuse_used, sole_writer
    from trackfg.streaming.checkpoint.checkpoint import Checkpoint, Checkpoints
    from trackfg.streaming.sinks.parquet_parts import NOTHING_WRITTEN, ParquetParts
    from trackfg.streaming.sinks.sink import TABLES

    out = Path(options.out)
    checkpoints = Checkpoints(out / _CHECKPOINT, every_s=options.checkpoint_every)
    leftovers = list(out.glob(f"{UNFINISHED}{_CHECKPOINT}*"))
    if leftovers:
        with sole_writer(out):
            for path in leftovers:  # of a stream that was killed while it wrote a checkpoint
                path.unlink(missing_ok=True)
    if options.resume and checkpoints.path.exists():
        with sole_writer(out):
            saved = checkpoints.read()
            if saved.finished:
                return None
            try:
                stream = opened(saved)
            except BadInputError as error:
                if options.source != _STANDARD or options.from_now:
                    raise
                raise BadInputError(
                    f"{error}. Hint: lines have to come again from the first one, the description before it; of a "
                    "live feed, which cannot send them again, --from-now takes the description and the lines that come "
                    "now"
                ) from error
            note(f"{out}: {_place(saved, stream, options)}")
            return stream.run(ParquetParts(out, state=saved.sink), checkpoints, watch)
    if checkpoints.path.exists() and not checkpoints.read().finished:
        raise BadInputError(f"{out}: holds an unfinished stream: go on with it by --resume, or choose another folder")
    refuse_used(out, _NEVER_ADDED)
    stream = opened(None)
    out.mkdir(parents=True, exist_ok=True)
    with sole_writer(out):
        refuse_used(out, _NEVER_ADDED)  # by another process meanwhile
        checkpoints.write(Checkpoint(stream.settings, NOTHING_WRITTEN))
        try:
            return stream.run(ParquetParts(out), checkpoints, watch)
        except BadInputError:
            if not stream.counts.keyframes:  # nothing was estimated: the corrected stream can begin in the same folder
                checkpoints.path.unlink()
                for table in TABLES:
                    shutil.rmtree(out / table, ignore_errors=True)
            raise


def _place(saved: Checkpoint, stream: Stream, options: StreamOptions) -> str:
    """Return where a stream goes on."""
    from trackfg.streaming.sources.json_lines import JsonLinesSource

    if saved.until_s is None:
        return "begins again: it was stopped before its first checkpoint"
    where = f"goes on at t = {saved.until_s:.3f} s"
    if options.from_now:
        return f"{where} with the lines that come now; what was sent since then is missing"
    if isinstance(stream.source, JsonLinesSource):
        return f"{where}; {saved.position} lines are passed over, which have to be those sent before"
    return where


def _source(options: StreamOptions, position: int) -> Source:
    from trackfg.streaming.sources.source import STORED_BATCH_S, RecordingSource

    name, real_time = options.source, options.real_time
    batch_s = min(STORED_BATCH_S, options.checkpoint_every or STORED_BATCH_S)  # a checkpoint comes after a batch
    if real_time and (name == _STANDARD or not Path(name).is_dir()):
        raise BadInputError(f"--real-time {name}: expected the folder of a recording: other rows come when they come")
    if name == _STANDARD:
        from trackfg.streaming.sources.json_lines import JsonLinesSource

        return JsonLinesSource(sys.stdin.buffer, position=position)
    if Path(name).is_file():
        from trackfg.streaming.sources.mcap import McapSource

        return McapSource(name, batch_s=batch_s, position=position)
    from trackfg.io.reader import read_recording

    recording = read_recording(name)
    for finding in recording.findings:
        complain(f"trackfg: {finding.level}: {finding}")
    for section in _ONLY_SMOOTHED:
        if getattr(recording.description, section) is not None:
            complain(f"trackfg: warning: a stream does not use [{section}], as trackfg smooth does")
    if real_time:
        return RecordingSource(recording, speed=1.0, position=position)
    return RecordingSource(recording, batch_s=batch_s, position=position)
