"""The JSON lines source reads one row per line, ``{"table": "imu", "t": 0.005, "wx": ..., ...}``.

The description comes from the caller, or stands on the first line: ``{"description": {...}}``. See
docs/streaming-formats.md.
"""

from __future__ import annotations

import hashlib
import io
import os
import stat
from collections.abc import Iterator
from contextlib import suppress
from typing import IO, Any

from trackfg.errors import BadInputError
from trackfg.recording.description import RecordingDescription
from trackfg.streaming.sources.row_parser import LONGEST_BYTES, RowError, RowParser, json_object, stream_description
from trackfg.streaming.sources.source import BATCH_S, COMPARED_ROWS, Batch


class JsonLinesSource:
    """A stream of lines; a batch comes whenever the IMU has moved on by ``batch_s``. ``position`` counts lines.

    Binary streams are read as UTF-8 whatever they hold. Raises :class:`BadInputError` where there is no description, or
    it cannot be used; a bad line is an event, and so is an input that ends within a line.
    """

    canonical = False
    gnss_origin = None
    length = None

    def __init__(
        self,
        stream: IO[bytes] | IO[str],
        description: RecordingDescription | None = None,
        *,
        batch_s: float = BATCH_S,
        position: int = 0,
    ) -> None:
        self._stream: Any = stream.buffer if isinstance(stream, io.TextIOWrapper) else stream
        self._position, self._read = position, 0
        self.live = not _is_file(self._stream)
        self.description = self._first_line() if description is None else description
        self._parser, self._compared = RowParser(self.description, "line", batch_s), ""
        while self._read < min(position, COMPARED_ROWS) and self._next():
            pass

    @property
    def first_rows(self) -> str:
        """A digest of the numbers in the first lines, as far as these are read; of those passed over at once."""
        return hashlib.sha256(self._compared.encode()).hexdigest() if self._compared else ""

    def __iter__(self) -> Iterator[Batch]:
        parser = self._parser
        while line := self._next():
            if self._read <= self._position or line.isspace():
                continue
            try:
                parser.take(*self._row(line))
            except RowError as fault:
                parser.refuse(self._read, fault)
            if parser.full:
                yield parser.batch(self._read)
        yield parser.batch(max(self._read, self._position))

    def _next(self) -> bytes:
        """Return the next line after the description, as :meth:`_line` does, of which the first ones are compared."""
        line = self._line()
        if self._read <= COMPARED_ROWS and line and not line.isspace():
            with suppress(RowError):
                table, values = self._row(line)
                self._compared += f"{table} {self._parser.numbers(table, values)}\n"
        return line

    def _first_line(self) -> RecordingDescription:
        line = self._line()
        while line and line.isspace():
            line = self._line()
        place = f"line {self._read}"
        expected = 'expected {"description": {...}} before the first row, or a description given with the stream'
        if not line:
            raise BadInputError(f"the stream is empty; {expected}")
        try:
            first = json_object(line)
        except RowError as fault:
            raise BadInputError(f"{place}: {fault}; {expected}") from None
        if "description" not in first:
            raise BadInputError(f"{place}: no description; {expected}")
        return stream_description(first["description"], place)

    def _row(self, line: bytes) -> tuple[str, dict[str, Any]]:
        try:
            values = json_object(line)
        except RowError:
            if len(line) <= LONGEST_BYTES and not line.endswith(b"\n"):
                raise RowError("the input ends within the line") from None
            raise
        table = values.get("table")
        if isinstance(table, str):
            return table, values
        if self._read == 1 and "description" in values:
            raise RowError("the description is not used: another was given with the stream")
        if "description" in values:
            raise RowError('no "table" but a description; expected it before the first row: that one stays in use')
        raise RowError('no "table"; expected {"table": "imu", ...}')

    def _line(self) -> bytes:
        """Return the next line with its end, or empty at the end of the stream; of one that is too long, enough to show
        it.
        """
        line = rest = self._piece()
        if line:
            self._read += 1
        while len(rest) > LONGEST_BYTES and not rest.endswith(b"\n"):
            rest = self._piece()
        return line

    def _piece(self) -> bytes:
        piece: str | bytes = self._stream.readline(LONGEST_BYTES + 1)
        return piece.encode("utf-8", "replace") if isinstance(piece, str) else piece


def _is_file(stream: Any) -> bool:
    """Return whether all lines are there already: in a file on disk, or in memory."""
    try:
        return stat.S_ISREG(os.fstat(stream.fileno()).st_mode)
    except (OSError, AttributeError):
        return True
