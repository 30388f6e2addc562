"""The MCAP source reads rows from an MCAP file (https://mcap.dev): messages in JSON, the topic is the table.

Messages are read in the order of the file, without its index, so that a file whose end is missing gives all that it
has. The description comes from the caller, or is the first message, topic ``description``.
"""

from __future__ import annotations

import hashlib
import io
import struct
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any, cast

from trackfg.errors import BadInputError, TrackfgError, first_line
from trackfg.recording.description import RecordingDescription
from trackfg.results.events import Event
from trackfg.streaming.rows import described_tables
from trackfg.streaming.sources.row_parser import RowError, RowParser, json_object, stream_description
from trackfg.streaming.sources.source import STORED_BATCH_S, Batch

try:
    import lz4.frame
    import zstandard
    from mcap.exceptions import McapError
    from mcap.records import Channel, Chunk, McapRecord, Message
    from mcap.stream_reader import StreamReader, breakup_chunk
except ImportError as error:
    raise TrackfgError("MCAP files need the package mcap: pip install 'trackfg[mcap]'") from error

LARGEST_RECORD = 256_000_000
"""Bytes of a record, packed or unpacked."""

_COMPARED_BYTES = 2**16
"""First bytes of a file that identify it: besides the description and the schemas they hold rows."""

DESCRIPTION_TOPIC = "description"

_MAGIC = b"\x89MCAP"
"""The first bytes of an MCAP file; its version follows."""
_DAMAGE = (McapError, zstandard.ZstdError, struct.error, ValueError, RuntimeError, EOFError, OSError)
"""Errors that reading a damaged file raises."""


class McapSource:
    """An MCAP file; a batch comes whenever the IMU has moved on by ``batch_s``. ``position`` counts messages.

    A leading ``/`` of a topic is not part of the table's name. Topics that are no table are left out, and counted when
    the file ends. Raises :class:`BadInputError` where the file is none, or has no usable description.
    """

    canonical, live = False, False
    gnss_origin = None
    length = None

    def __init__(
        self,
        path: Path | str,
        description: RecordingDescription | None = None,
        *,
        batch_s: float = STORED_BATCH_S,
        position: int = 0,
    ) -> None:
        self._path, self._batch_s, self._position = Path(path), batch_s, position
        self.description = self._first_message() if description is None else description
        with self._path.open("rb") as file:
            self.first_rows = hashlib.sha256(file.read(_COMPARED_BYTES)).hexdigest()

    def __iter__(self) -> Iterator[Batch]:
        parser = RowParser(self.description, "message", self._batch_s)
        tables = described_tables(self.description)
        others: Counter[str] = Counter()
        number, broken = 0, []
        messages = self._messages()
        while True:
            try:
                topic, encoding, data = next(messages)
            except StopIteration:
                break
            except _DAMAGE as error:
                if number == 0:
                    raise self._unreadable(error) from error
                detail = f"{self._path.name}: cannot be read beyond message {number} ({first_line(error)})"
                broken = [Event("broken-input", detail=detail)]
                break
            number += 1
            if topic == DESCRIPTION_TOPIC:
                continue
            if topic not in tables:
                others[topic] += 1
                continue
            if number <= self._position:
                continue
            try:
                parser.take(topic, _object(encoding, data))
            except RowError as fault:
                parser.refuse(number, fault)
            if parser.full:
                yield parser.batch(number)
        last = parser.batch(max(number, self._position))
        left_out = [
            Event("other-topic", topic, None, None, count, "no table of the description: left out")
            for topic, count in sorted(others.items())
        ]
        yield Batch(last.tables, (*last.events, *left_out, *broken), last.position)

    def _first_message(self) -> RecordingDescription:
        place = f"{self._path.name}, message 1"
        expected = f"expected the topic {DESCRIPTION_TOPIC!r} first, or a description given with the file"
        try:
            topic, encoding, data = next(self._messages())
        except StopIteration:
            raise BadInputError(f"{self._path}: no messages; {expected}") from None
        except _DAMAGE as error:
            raise self._unreadable(error) from error
        if topic != DESCRIPTION_TOPIC:
            raise BadInputError(f"{place}: topic {ascii(topic)[:60]}; {expected}")
        try:
            return stream_description(_object(encoding, data), place)
        except RowError as fault:
            raise BadInputError(f"{place}: {fault}") from None

    def _unreadable(self, error: BaseException) -> BadInputError:
        expected = "expected MCAP, a folder, or - for JSON lines"
        begin = b"" if isinstance(error, OSError) else _first_bytes(self._path)
        if not begin or begin == _MAGIC:
            return BadInputError(f"{self._path}: cannot be read ({first_line(error)}); {expected}")
        if begin.lstrip().startswith(b"{"):
            hint = f"for JSON lines, trackfg stream - -o OUT < {self._path.name}"
        else:
            hint = "trackfg import makes a recording of a log"
        return BadInputError(f"{self._path}: no MCAP file; {expected}. Hint: {hint}")

    def _messages(self) -> Iterator[tuple[str, str, bytes]]:
        """Yield topic, encoding and content of each message."""
        channels: dict[int, Channel] = {}
        with self._path.open("rb") as file:
            for record in _records(file):
                if isinstance(record, Channel):
                    channels[record.id] = record
                elif isinstance(record, Message) and record.channel_id in channels:
                    channel = channels[record.channel_id]
                    yield channel.topic.removeprefix("/"), channel.message_encoding, record.data


def _first_bytes(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(len(_MAGIC))


def _object(encoding: str, data: bytes) -> dict[str, Any]:
    if encoding != "json":
        raise RowError(f"encoded as {ascii(encoding)[:40]}; expected 'json'")
    return json_object(data)


class _Bounded:
    """Reads no more at once than a record may have, whatever a damaged length says."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file

    def read(self, size: int) -> bytes:
        if size > LARGEST_RECORD:
            raise ValueError(f"a length of {size} bytes")
        return self._file.read(size)


def _records(file: IO[bytes]) -> Iterator[McapRecord]:
    """Yield all records; chunks are unpacked here, because the size that they give is not trusted."""
    for record in StreamReader(
        cast("IO[bytes]", _Bounded(file)), emit_chunks=True, record_size_limit=LARGEST_RECORD
    ).records:
        if isinstance(record, Chunk):
            yield from breakup_chunk(_unpacked(record))
        else:
            yield record


def _unpacked(chunk: Chunk) -> Chunk:
    packed = io.BytesIO(chunk.data)
    if chunk.compression == "zstd":
        data = zstandard.ZstdDecompressor().stream_reader(packed).read(LARGEST_RECORD + 1)
    elif chunk.compression == "lz4":
        data = lz4.frame.LZ4FrameFile(packed).read(LARGEST_RECORD + 1)
    elif chunk.compression == "":
        data = chunk.data
    else:
        raise ValueError(f"compression {ascii(chunk.compression)[:40]} is unknown")
    if len(data) > LARGEST_RECORD:
        raise ValueError(f"a chunk unpacks to more than {LARGEST_RECORD} bytes")
    return Chunk("", data, chunk.message_end_time, chunk.message_start_time, 0, len(data))
