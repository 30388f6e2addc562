"""Logs of GNSS receivers: UBX NAV-PVT and NMEA GGA, GST, RMC and ZDA, in any mixture.

Speeds are of NAV-PVT, with their accuracy, or of RMC, without any.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from datetime import UTC, datetime, time, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from trackfg.errors import BadInputError
from trackfg.files.libraries import library
from trackfg.interchange.importing.proposal import UNKNOWN_HEIGHT_SD_M
from trackfg.interchange.importing.shapes.tagged_lines import delimiter_of_tagged
from trackfg.interchange.importing.source_format import DialectFor, SourceFormat, starts_with
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.interchange.importing.times import as_ns
from trackfg.numerics.units import KNOT

_UERE_M = 3.0
"""Error of one range, m: with the dilution of precision it gives a sigma where the receiver states none (GPS SPS
Performance Standard 2020, single frequency)."""
_RANGE_SD_M = {2: 1.0, 4: 0.05, 5: 0.5}
"""The same by the quality of a GGA sentence (NMEA 0183): with corrections of code (2), carrier phase with its
ambiguities fixed (4) or not (5). A ZED-F9P has 1.0 m of 2 and 0.01 m of 4 by its data sheet, under an open sky. That of
other positions is :data:`_UERE_M`; estimated, typed or simulated ones, 6 and above, are no measurements."""
_MEASURED = 5
"""Highest quality of a GGA sentence that is a measurement."""

_WITHOUT_MESSAGE_BYTES = 1_048_576
"""Most bytes of a log between two messages: minutes of corrections (RTCM), which are passed over. Searching so much
takes a second."""

_COLUMNS = ("latitude", "longitude", "height", "sd_east_m", "sd_north_m", "sd_up_m", "speed_mps", "sd_speed_mps")
_NO_SPEED = (np.nan, np.nan)


class GnssLog(SourceFormat):
    """All positions are one table ``gnss``: it goes beside the table of an IMU, since alone it is no recording."""

    key = "gnss"
    title = "GNSS receiver: UBX (NAV-PVT) or NMEA (RMC, or GGA with GST, ZDA or RMC)"

    def recognises(self, path: Path) -> bool:
        """Return whether the file begins with a UBX or NMEA message, and has no lines that begin with a tag."""
        return starts_with(path, b"\xb5b", b"$GP", b"$GN", b"$GL", b"$GA") and delimiter_of_tagged(path) is None

    def tables(self, path: Path, dialect_for: DialectFor) -> Sequence[SourceTable]:
        """Read the positions, with a date from the log."""
        return [read_gnss_log(path)]

    def mapping(self, tables: Sequence[SourceTable]) -> dict[str, Any] | None:
        """Raise :class:`BadInputError`, since nothing is beside the positions."""
        raise BadInputError(
            "a receiver's log is no recording, since inertial samples in it (ESF-RAW, ESF-MEAS) are not read; expected "
            "the log in a folder with the table of an inertial sensor"
        )


def read_gnss_log(path: Path) -> SourceTable:
    """Read the positions of a log: UBX where there are any, else NMEA. Raises :class:`BadInputError` without any."""
    pyubx2 = library("pyubx2", "gnss")
    ubx: list[tuple[int, tuple[float, ...]]] = []
    nmea = _Nmea()
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
        raise BadInputError(
            f"{path.name}: no position found; expected UBX NAV-PVT, or NMEA RMC, or GGA with ZDA or RMC"
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


class _Nmea:
    """Sentences of one epoch are put together by their time of day; RMC and ZDA give dates, GGA the position.

    A time of day is on the day on which it is nearest to the date or position before it, so that a log may pass
    midnight; positions before the first date are near that one. Without any GGA positions are those of RMC, without
    heights.
    """

    def __init__(self) -> None:
        self._date: datetime | None = None
        self._found: dict[str, list[tuple[datetime | None, time, tuple[float, ...]]]] = {"GGA": [], "RMC": []}
        self._sigmas: dict[time, tuple[float, float, float]] = {}
        self._speeds: dict[datetime, tuple[float, float]] = {}

    def take(self, kind: str, message: Any) -> None:
        """Take up a sentence."""
        at = getattr(message, "time", None)
        if not isinstance(at, time):
            return
        if kind == "RMC" and message.date:
            self._date = datetime.combine(message.date, at, tzinfo=UTC)
        elif kind == "ZDA" and message.year:
            day = datetime(int(message.year), int(message.month), int(message.day), tzinfo=UTC)
            self._date = datetime.combine(day, at, tzinfo=UTC)
        if kind == "RMC" and message.status == "A" and self._date is not None and message.spd != "":
            self._speeds[self._date] = float(message.spd) * KNOT, np.nan
        if kind == "GST" and message.stdLat != "":
            self._sigmas[at] = (message.stdLong, message.stdLat, message.stdAlt)
        elif kind == "GGA" and 0 < (quality := int(message.quality or 0)) <= _MEASURED and message.lat != "":
            sd = float(message.HDOP or 1.0) * _RANGE_SD_M.get(quality, _UERE_M)
            height = float(message.alt or 0.0) + float(message.sep or 0.0)
            self._found[kind].append((self._date, at, (message.lat, message.lon, height, sd, sd, 2.0 * sd)))
        elif kind == "RMC" and message.status == "A" and message.lat != "":
            values = (message.lat, message.lon, 0.0, _UERE_M, _UERE_M, UNKNOWN_HEIGHT_SD_M)
            self._found[kind].append((self._date, at, values))

    def rows(self) -> list[tuple[int, tuple[float, ...]]]:
        """Return times, ns since 1970, and positions. Without any date there is none."""
        found = self._found["GGA"] or self._found["RMC"]
        last = next((date for date, *_ in found if date is not None), self._date)
        rows = []
        for date, at, values in found:
            if last is None:
                break
            last = _nearest(at, last if date is None else max(last, date))
            sigmas, speed = self._sigmas.get(at, values[3:]), self._speeds.get(last, _NO_SPEED)
            rows.append((as_ns(last), (*values[:3], *sigmas, *speed)))
        return rows


def _nearest(at: time, reference: datetime) -> datetime:
    """Return the date nearest to ``reference`` with this time of day."""
    same_day = datetime.combine(reference, at, tzinfo=UTC)
    return same_day - timedelta(days=round((same_day - reference) / timedelta(days=1)))
