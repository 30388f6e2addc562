"""Every kind of sensor that a recording or a stream may have."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from trackfg.io.formats.fixes import FixesFormat
from trackfg.io.formats.further_tach import FurtherTachFormat
from trackfg.io.formats.gnss import GnssFormat
from trackfg.io.formats.gnss_speed import GnssSpeedFormat
from trackfg.io.formats.imu import ImuFormat
from trackfg.io.formats.laser import LaserFormat
from trackfg.io.formats.sensor_format import SensorFormat
from trackfg.io.formats.speed import SpeedFormat
from trackfg.io.formats.tach import TachFormat
from trackfg.recording.description import RecordingDescription, Table

FORMATS: tuple[SensorFormat[Any], ...] = (
    ImuFormat(),
    TachFormat(),
    FurtherTachFormat(),
    FixesFormat(),
    GnssFormat(),
    GnssSpeedFormat(),
    SpeedFormat(),
    LaserFormat(),
)
"""In the order in which tables are read, checked and streamed; the IMU first."""

_BY_MODEL = {sensor.model: sensor for sensor in FORMATS}
_BY_KEY = {sensor.key: sensor for sensor in FORMATS}


def format_of(part: Table) -> SensorFormat[Any]:
    """Return the format of a part of a description. Raises ``KeyError`` where the part is of no sensor."""
    return _BY_MODEL[type(part)]


def format_of_table(name: str) -> SensorFormat[Any]:
    """Return the format of a table in memory by its name, ``"imu"`` or ``"laser/left"``. Raises ``KeyError`` if
    unknown.
    """
    return _BY_KEY[name.partition("/")[0]]


def sensors_of(description: RecordingDescription) -> Iterator[tuple[str, Table]]:
    """Return the name of each sensor's table in memory, and its part of the description."""
    for sensor in FORMATS:
        value = getattr(description, sensor.key)
        parts = value if sensor.several else () if value is None else (value,)
        for number, part in enumerate(parts, start=1):
            yield sensor.table_name(part, number), part
