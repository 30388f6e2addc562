"""A recording in memory: the contract's description and its tables, in SI, body axes and one clock.

Whatever the files say (units, axes, stamps, clock offsets), a :class:`Recording` always holds

==========  =====================================================================================================
table       columns
==========  =====================================================================================================
``imu``     ``t_s`` (centre of the interval that the sample averages), ``wx_radps wy_radps wz_radps`` (angular
            rate), ``fx_mps2 fy_mps2 fz_mps2`` (specific force), in vehicle axes FLU
``tach``    ``t_s, distance_m``: cumulative distance with the nominal wheel, not yet scaled; ``speed`` tachs are
            integrated (trapezoid)
``fixes``   ``t_s, chainage_m, chainage_sd_m``
``balises``  ``t_s, id, chainage_m, chainage_sd_m``: passages, with the place that is planned, NaN where none is known
``gnss``    ``t_s, east_m, north_m, up_m, east_sd_m, north_sd_m, up_sd_m``, ENU tangent at ``gnss_origin``
``others``  by name, ``"speed/1"``: ``t_s, speed_mps``, without rows where the sensor says nothing;
            ``"gnss_speed"``: ``t_s, speed_mps, speed_sd_mps``, likewise
``lasers``  by name: ``t_s, displacement_m``
==========  =====================================================================================================

All of this is applied already: what ``description`` says of units, axes, stamps, mounting and clock offsets is where
the tables came from, and must not be applied again. Truth is not here: estimators never see it.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from trackfg.numerics.arrays import Array
from trackfg.numerics.key_figures import KeyFigures
from trackfg.numerics.spans import median_interval
from trackfg.recording.description import RecordingDescription
from trackfg.recording.findings import Finding

if TYPE_CHECKING:
    from trackfg.recording.known_line import KnownLine

IMU_COLUMNS = ("t_s", "wx_radps", "wy_radps", "wz_radps", "fx_mps2", "fy_mps2", "fz_mps2")
TACH_COLUMNS = ("t_s", "distance_m")
FIX_COLUMNS = ("t_s", "chainage_m", "chainage_sd_m")
BALISE_COLUMNS = ("t_s", "id", "chainage_m", "chainage_sd_m")
GNSS_COLUMNS = ("t_s", "east_m", "north_m", "up_m", "east_sd_m", "north_sd_m", "up_sd_m")
LASER_COLUMNS = ("t_s", "displacement_m")

SPEED_COLUMNS = ("t_s", "speed_mps")
GNSS_SPEED_COLUMNS = ("t_s", "speed_mps", "speed_sd_mps")

GNSS_SPEED_TABLE = "gnss_speed"
"""The table of a satellite receiver's speeds, among the others."""

LASER_TABLE = "laser/"
"""The table of a laser is called so, and by the laser's name."""

_DIGESTED_ROWS = 8192
"""Rows of a table that are digested at once: their 0.5 MB stay in the processor's cache."""

_SINGLE = ("tach", "fixes", "gnss")


@dataclass(frozen=True, repr=False)
class Recording(KeyFigures):
    """A run: what was measured, and how the sensors sit in the vehicle.

    Examples
    --------
    >>> import trackfg
    >>> recording = trackfg.read_recording("run1")
    >>> recording.gyro.shape, recording.description.imu.rigid
    ((12000, 3), True)
    >>> list(recording.tables)
    ['imu', 'tach']
    """

    description: RecordingDescription
    """What ``recording.toml`` says."""
    imu: pd.DataFrame
    """Samples of the IMU: ``t_s`` in s, angular rate in rad/s, specific force in m/s^2."""
    tach: pd.DataFrame | None = None
    """Readings of the tachometer."""
    fixes: pd.DataFrame | None = None
    """Passages of places whose chainage is known, m."""
    gnss: pd.DataFrame | None = None
    """Positions east, north and up of ``gnss_origin``, m, with their sigmas."""
    lasers: dict[str, pd.DataFrame] = field(default_factory=dict)
    """Readings of displacement sensors by name, m."""
    gnss_origin: Array | None = None
    """Latitude and longitude in degrees and height in m; None where GNSS is local or absent."""
    folder: Path | None = None
    """Where it was read from."""
    findings: tuple[Finding, ...] = ()
    """What reading the files noticed about the quality of the data; it goes into the result's summary."""
    others: dict[str, pd.DataFrame] = field(default_factory=dict)
    """Tables of further sensors by name."""
    balises: pd.DataFrame | None = None
    """Passages of what has an id: text, and therefore no table among the others."""
    known_line: KnownLine | None = None
    """Tracks that the run may be on, of ``[known_line]``."""
    files_sha256: str | None = None
    """Digest of the files that it was read from (:mod:`trackfg.io.content`)."""

    @property
    def tables(self) -> dict[str, pd.DataFrame]:
        """The tables that there are, by name: ``imu``, ``tach``, ``fixes``, ``gnss``, ``laser/NAME``, others."""
        single = {"imu": self.imu, "tach": self.tach, "fixes": self.fixes, "gnss": self.gnss}
        lasers = {f"{LASER_TABLE}{name}": table for name, table in self.lasers.items()}
        return {name: table for name, table in single.items() if table is not None} | self.others | lasers

    @classmethod
    def of_tables(cls, description: RecordingDescription, tables: Mapping[str, pd.DataFrame]) -> Recording:
        """Make a recording from what :attr:`tables` gives."""
        lasers = {name.removeprefix(LASER_TABLE): t for name, t in tables.items() if name.startswith(LASER_TABLE)}
        tach, fixes, gnss = (tables.get(name) for name in _SINGLE)
        others = {n: t for n, t in tables.items() if n not in ("imu", *_SINGLE) and not n.startswith(LASER_TABLE)}
        return cls(description, tables["imu"], tach, fixes, gnss, lasers, others=others)

    def with_tables(self, tables: Mapping[str, pd.DataFrame]) -> Recording:
        """Return the recording with what :attr:`tables` gives for its own, by name; others stay."""
        new = Recording.of_tables(self.description, {**self.tables, **tables})
        return replace(
            self, imu=new.imu, tach=new.tach, fixes=new.fixes, gnss=new.gnss, lasers=new.lasers, others=new.others
        )

    def key_figures(self) -> dict[str, str]:
        """Return the length, each table's rows and rate, and how much was found in the files."""
        t = self.imu["t_s"].to_numpy()
        figures = {"recording": self.description.id, "length": f"{np.ptp(t) if t.size else 0.0:.1f} s"}
        for name, table in self.tables.items():
            if name.startswith(LASER_TABLE):
                continue
            step = median_interval(table["t_s"].to_numpy())
            rate = f" at {1.0 / step:.4g} Hz" if step > 0.0 and name not in ("fixes", "tach") else ""
            figures[name] = f"{name} {len(table)} rows{rate}"
        if self.lasers:
            figures["lasers"] = f"{len(self.lasers)} lasers"
        if self.findings:
            figures["findings"] = f"{len(self.findings)} findings"
        return figures

    @property
    def gyro(self) -> Array:
        """Angular rate in body axes, rad/s, shape (n, 3)."""
        return np.column_stack([self.imu[name] for name in IMU_COLUMNS[1:4]])

    @property
    def accel(self) -> Array:
        """Specific force in body axes, m/s^2, shape (n, 3)."""
        return np.column_stack([self.imu[name] for name in IMU_COLUMNS[4:7]])

    def content_sha256(self) -> str:
        """Return a digest of the inertial and the wheel's measurements, whatever the run is called."""
        digest = hashlib.sha256()
        for table in (self.imu, self.tach):
            if table is not None:
                for begin in range(0, len(table), _DIGESTED_ROWS):  # a copy of a day's samples would be 1 GB
                    digest.update(table.iloc[begin : begin + _DIGESTED_ROWS].to_numpy(dtype="<f8").ravel().data)
        return digest.hexdigest()


def refuse_other_than_recording(given: object, function: str) -> None:
    """Raise ``TypeError`` for anything but a recording in the call of a ``function``: for a path, or a simulation."""
    if not isinstance(given, Recording):
        what = f"{function} takes a recording, as trackfg.read_recording(folder) gives, not {type(given).__name__}"
        raise TypeError(what)
