"""A checkpoint is a file from which a stream that was killed goes on, with the same result as if it had not been.

    {"format": "trackfg-checkpoint/9", "trackfg": "1.0"}     which version wrote it
    {"position": ..., "smoother": ..., ...}                  JSON values, on one line
    ...                                                      the numbers of the arrays of intake and smoother
    ...                                                      SHA-256 of all that stands before, 32 bytes

The file is replaced as a whole, after everything that was estimated until then is on the disk. Whatever the moment of a
kill, it is the last one that was written.
"""

from __future__ import annotations

import hashlib
import json
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from trackfg import __version__
from trackfg.errors import BadInputError, first_line
from trackfg.files.atomic_file import write_whole
from trackfg.files.small_file import read_small
from trackfg.streaming.checkpoint.snapshot import Snapshot

FORMAT = "trackfg-checkpoint/9"
EVERY_S = 60.0
"""Time of the stream from one checkpoint to the next, s: as much is computed again after a kill."""
APART_S = 5.0
"""Time of the computer from one checkpoint to the next, s, unless the stream's is given: an hour of stored rows takes
less than half a minute, and would have 60 of them. With the last parts that come before it a checkpoint takes some
0.03 s: less than 1 % of this time.
"""
_BEGINS = b'{"format": "trackfg-checkpoint/'
_MOST_BYTES = 1024 * 2**20
"""Size of a checkpoint: the rows of an hour at 1 kHz, 7 numbers of 8 bytes each, take 200 MB."""
_DIGEST_BYTES = hashlib.sha256().digest_size
_SNAPSHOTS = ("intake", "smoother")
"""Fields that are snapshots, in the order in which their arrays' numbers follow."""


@dataclass(frozen=True)
class Checkpoint:
    """A stream between two batches; without any but the first two, before its first one.

    ``settings``: what it runs with, as digests by name. ``sink``, ``position`` (of the source), ``intake`` and
    ``smoother``: where each of them stands. ``until_s``: up to when rows were complete, s. ``keyframes``, ``events``
    (by kind): how many there were.
    """

    settings: Mapping[str, str]
    sink: Mapping[str, Any]
    position: int = 0
    intake: Snapshot | None = None
    smoother: Snapshot | None = None
    until_s: float | None = None
    keyframes: int = 0
    events: Mapping[str, int] = field(default_factory=dict)
    finished: bool = False

    def refuse_others(self, settings: Mapping[str, str]) -> None:
        """Raise :class:`BadInputError` unless these are its own settings.

        A source whose first rows are not known is not compared: a live feed of lines may send only its next rows.
        """
        unknown = set[str]() if self.settings.get("recording") and settings.get("recording") else {"recording"}
        names = sorted({*self.settings, *settings} - unknown)
        changed = [name for name in names if self.settings.get(name) != settings.get(name)]
        if "source" in changed and "recording" in changed:
            changed.remove("recording")  # each kind of source describes its own in another way
        if changed:
            raise BadInputError(
                f"the checkpoint was made with another {', '.join(changed)}; "
                "expected what the stream began with: anything else is a stream of its own"
            )

    def to_bytes(self) -> tuple[bytes, bytes, bytes]:
        """Return the file's content, in parts."""
        arrays, content = b"", dict(vars(self))
        for name in _SNAPSHOTS:
            if (snapshot := content[name]) is not None:
                content[name] = {"tree": snapshot.tree, "bytes": len(snapshot.data)}
                arrays += snapshot.data
        head = json.dumps({"format": FORMAT, "trackfg": __version__})
        text = f"{head}\n{json.dumps(content)}\n".encode()
        digest = hashlib.sha256(text)
        digest.update(arrays)
        return text, arrays, digest.digest()

    @classmethod
    def from_bytes(cls, content: bytes) -> Checkpoint:
        """Return the checkpoint of a file's content. Raises :class:`BadInputError`."""
        if not content.startswith(_BEGINS):
            raise BadInputError("expected the checkpoint of a stream")
        whole, digest = content[:-_DIGEST_BYTES], content[-_DIGEST_BYTES:]
        if hashlib.sha256(whole).digest() != digest:
            raise BadInputError("damaged: its content is not what was written; the stream has to begin anew")
        try:
            head, text, data = whole.split(b"\n", 2)
            made = json.loads(head)
            if made["format"] != FORMAT:
                raise BadInputError(
                    f"a checkpoint of format {made['format']}; expected {FORMAT}; "
                    "finish the stream with the version of trackfg that began it"
                )
            if made != {"format": FORMAT, "trackfg": __version__}:
                raise BadInputError(
                    f"written by trackfg {made.get('trackfg')}, this is {__version__}, which would go on differently; "
                    "finish the stream with the version that began it"
                )
            values = json.loads(text)
            for name in _SNAPSHOTS:
                if values[name] is not None:
                    size = values[name]["bytes"]
                    values[name], data = (values[name]["tree"], data[:size]), data[size:]
            return _CHECKPOINT.validate_python(values)
        except (ValueError, TypeError, KeyError, RecursionError) as error:
            raise BadInputError(f"not a checkpoint ({_reason(error)})") from error


_CHECKPOINT = TypeAdapter(Checkpoint)


class Checkpoints:
    """The file ``path``, replaced when the stream has moved on by ``every_s`` seconds of its own time: without any
    given, by :data:`EVERY_S`, and when :data:`APART_S` of the computer's time are over too.
    """

    def __init__(
        self, path: Path | str, *, every_s: float | None = None, clock: Callable[[], float] = time.monotonic
    ) -> None:
        if every_s is not None and not (math.isfinite(every_s) and every_s > 0.0):
            raise BadInputError(f"a checkpoint every {every_s:g} s: expected more than 0 s")
        self.path, self._clock = Path(path), clock
        self._every_s, self._apart_s = (EVERY_S, APART_S) if every_s is None else (every_s, 0.0)
        self._last_s: float | None = None
        self._written_s = clock()

    def due(self, until_s: float) -> bool:
        """Return whether it is time for the next one, with rows complete up to ``until_s``, s."""
        if not math.isfinite(until_s):
            return False
        if self._last_s is None:
            self._last_s = until_s
        now_s = self._clock()
        if until_s < self._last_s + self._every_s or now_s < self._written_s + self._apart_s:
            return False
        self._last_s, self._written_s = until_s, now_s
        return True

    def write(self, checkpoint: Checkpoint) -> None:
        """Replace the last one. Raises :class:`~trackfg.errors.OutputError`."""
        write_whole(self.path, *checkpoint.to_bytes())

    def read(self) -> Checkpoint:
        """Return the last one. Raises :class:`BadInputError` where there is none, or it cannot be used."""
        try:
            return Checkpoint.from_bytes(read_small(self.path, _MOST_BYTES))
        except OSError as error:
            raise BadInputError(f"{self.path}: expected the checkpoint of a stream: {error.strerror}") from error
        except BadInputError as error:
            raise BadInputError(f"{self.path}: {error}") from error


def _reason(error: Exception) -> str:
    if isinstance(error, ValidationError):
        first = error.errors()[0]
        return f"{'.'.join(map(str, first['loc']))}: {first['msg']}"
    return first_line(error)
