"""Logs of GNSS receivers: UBX NAV-PVT and NMEA GGA, GST, RMC, VTG and ZDA, in any mixture.

Speeds are of NAV-PVT, with their accuracy, or of RMC or VTG, without any.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError
from trackfg.files.libraries import library
from trackfg.interchange.importing.delimited.tagged_lines import delimiter_of_tagged
from trackfg.interchange.importing.source_format import DialectFor, SourceFormat, starts_with
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.interchange.importing.sources.receivers.gpx import TRACK, read_gpx
from trackfg.interchange.importing.sources.receivers.nmea import NmeaEpochs
from trackfg.interchange.importing.sources.receivers.rtklib import SOLUTION, read_rtklib
from trackfg.interchange.importing.times.clock import as_ns

_WITHOUT_MESSAGE_BYTES = 1_048_576
"""Most bytes of a log between two messages: minutes of corrections (RTCM), which are passed over. Searching so much
takes a second."""

_COLUMNS = ("latitude", "longitude", "height", "sd_east_m", "sd_north_m", "sd_up_m", "speed_mps", "sd_speed_mps")


class GnssLog(SourceFormat):
    """All positions are one table ``gnss``: it goes beside the table of an IMU, since alone it is no recording."""

    key = "gnss"
    title = "GNSS receiver: UBX (NAV-PVT) or NMEA (RMC, or GGA with GST, VTG, ZDA or RMC), or RTKLIB's .pos"

    def recognises(self, path: Path) -> bool:
        """Return whether it begins with a UBX or NMEA message and has no tagged lines, or is a solution of RTKLIB."""
        if path.suffix.casefold() == SOLUTION:
            return starts_with(path, b"%")
        return starts_with(path, b"\xb5b", b"$GP", b"$GN", b"$GL", b"$GA") and delimiter_of_tagged(path) is None

    def tables(self, path: Path, dialect_for: DialectFor) -> Sequence[SourceTable]:
        """Read the positions, with a date from the log."""
        return [read_positions(path)]

    def mapping(self, tables: Sequence[SourceTable]) -> dict[str, Any] | None:
        """Raise :class:`BadInputError`, since nothing is beside the positions."""
        raise BadInputError(
            "a receiver's log is no recording, since inertial samples in it (ESF-RAW, ESF-MEAS) are not read; expected "
            "the log in a folder with the table of an inertial sensor"
        )


def read_positions(path: Path) -> SourceTable:
    """Read the positions of a receiver's log, a solution or a track. Raises :class:`BadInputError` without any."""
    return {SOLUTION: read_rtklib, TRACK: read_gpx}.get(path.suffix.casefold(), read_gnss_log)(path)


def read_gnss_log(path: Path) -> SourceTable:
    """Read the positions of a log: UBX where there are any, else NMEA. Raises :class:`BadInputError` without any."""
    pyubx2 = library("pyubx2", "gnss")
    ubx: list[tuple[int, tuple[float, ...]]] = []
    nmea = NmeaEpochs()
    try:
        with _Messages(path) as stream:
            reader = pyubx2.UBXReader(stream, protfilter=pyubx2.UBX_PROTOCOL | pyubx2.NMEA_PROTOCOL, quitonerror=0)
            for _, message in reader:
                stream.found()
                identity = getattr(message, "identity", "")
                if identity == "NAV-PVT" and message.fixType in (2, 3, 4) and message.gnssFixOk:
                    ubx.append(_pvt(message))
                elif len(identity) == 5:
                    nmea.take(identity[2:], message)
    except (OSError, ValueError, AttributeError) as error:
        raise BadInputError(f"{path.name}: cannot be read ({error}); expected UBX or NMEA") from error
    rows = ubx or nmea.rows()
    if not rows:
        sentences = ", ".join(f"{count} {kind}" for kind, count in nmea.counts.items())
        raise BadInputError(
            f"{path.name}: no position found{f' in {sentences}' if sentences else ''}; expected UBX NAV-PVT, or NMEA "
            "RMC, or GGA with ZDA or RMC, whose dates GGA and VTG have not"
        )
    frame = pd.DataFrame(np.array([values for _, values in rows]), columns=list(_COLUMNS))
    frame = frame.dropna(axis="columns", how="all")  # speeds, or their sigmas
    frame.insert(0, "time_ns", np.array([ns for ns, _ in rows], dtype=np.int64))
    return SourceTable("gnss", _without_repetitions(frame))


class _Messages(io.BufferedReader):
    """The bytes of a log, as long as messages are found in them."""

    def __init__(self, path: Path) -> None:
        super().__init__(io.FileIO(path))
        self._since = 0

    def found(self) -> None:
        """Note that what was read until now has ended in a message."""
        self._since = 0

    def read(self, size: int | None = -1, /) -> bytes:
        """Read. Raises ``ValueError`` where no message is found any more."""
        return self._counted(super().read(size))

    def readline(self, size: int | None = -1, /) -> bytes:
        """Read a line, or as much of it as may be read without a message."""
        return self._counted(super().readline(_WITHOUT_MESSAGE_BYTES if size is None or size < 0 else size))

    def _counted(self, content: bytes) -> bytes:
        self._since += len(content)
        if self._since > _WITHOUT_MESSAGE_BYTES:
            raise ValueError(f"no message within {_WITHOUT_MESSAGE_BYTES / 2**20:g} MiB before byte {self.tell()}")
        return content


def _without_repetitions(frame: pd.DataFrame) -> pd.DataFrame:
    """Return the rows whose time is later than all before: a log that was started twice repeats some."""
    latest = np.maximum.accumulate(frame["time_ns"].to_numpy())
    later = np.concatenate([[True], frame["time_ns"].to_numpy()[1:] > latest[:-1]])
    return frame[later].reset_index(drop=True)


def _pvt(message: Any) -> tuple[int, tuple[float, ...]]:
    day = datetime(message.year, message.month, message.day, message.hour, message.min, message.second, tzinfo=UTC)
    ns = as_ns(day) + int(message.nano)
    # hAcc is that of both coordinates together, as the receiver's description has it.
    across, up = message.hAcc * 1e-3 / np.sqrt(2.0), message.vAcc * 1e-3
    speed = message.gSpeed * 1e-3, message.sAcc * 1e-3
    return ns, (message.lat, message.lon, message.height * 1e-3, across, across, up, *speed)
