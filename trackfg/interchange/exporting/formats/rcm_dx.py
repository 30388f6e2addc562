"""RCM-DX 2.0 (OpenRailAssociation/rcm-dx, specification of 2026-03-24): the exchange format of recording cars, in HDF5.

The file has one platform and one session. The run's positions are ``POSITION``; the geometry is the system ``TGMS``,
with one channel a quantity and one for its sigma (``..._SD``), by distance; the events are comments. Names are the
specification's, without the prefixes of particular cars.
"""

from __future__ import annotations

import uuid
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

import numpy as np

from trackfg import __version__
from trackfg.errors import BadInputError
from trackfg.files.libraries import library
from trackfg.interchange.exporting.located_tables import direction_of, located_geometry, start_of, travelled_m
from trackfg.interchange.exporting.result_format import ExportOptions, ResultFormat
from trackfg.numerics.arrays import Array
from trackfg.recording.line_kilometrage import LineKilometrage
from trackfg.results.official_places import line_kilometrage
from trackfg.results.result import Result

VERSION = (2, 0, 4)
"""Major, minor and feature version of the specification that is followed."""

_UNITS = {"1pm": "1/m", "permille": "permille", "mm": "mm", "mps": "m/s"}
_UNKNOWN_ID = -1
"""Line and track are not determined (specification, position channel)."""
_REST_SIGMAS = 3.0
"""A speed of fewer sigmas counts as rest: noise alone exceeds them 1 time in 370."""


class RcmDx(ResultFormat):
    """Needs a recording with a date, since every time in the file is one."""

    key = "rcm-dx"
    suffix = ".rcmdx"
    title = "RCM-DX 2.0 (HDF5): positions, geometry with sigmas, events"
    takes = frozenset({"km"})
    needs_trajectory = True

    def write(self, result: Result, path: Path, options: ExportOptions) -> None:
        """Write the file. Raises :class:`BadInputError` where the recording's start is not known."""
        h5py = library("h5py", "hdf5")
        zero = start_of(result)
        if zero is None:
            raise BadInputError(
                f"{result.summary.recording_id}: its recording has no date; expected one, since all times in rcm-dx "
                "are dates. Hint: set start in recording.toml and smooth again"
            )
        zero_ns = zero.value
        with h5py.File(path, "w") as file:
            root = _group(file, "RCMDX", "Root")
            root.attrs.update({name: np.int16(value) for name, value in zip(_VERSION_NAMES, VERSION, strict=True)})
            _group(root, "FILE", "File").attrs["StructureVersion"] = f"trackfg {__version__}"
            platform = _group(root, "TRACKFG", "Platform")
            platform.attrs["VehicleNumber"] = "-"  # a recording does not know it
            name = zero.strftime("%Y%m%d_%H%M%S.%f")[:-3]
            session = _group(platform, name, "Session")
            stamps = _stamps(result.trajectory["t_s"].to_numpy(), zero_ns)
            session.attrs["StartTime"], session.attrs["EndTime"] = stamps[0], stamps[-1]
            session.attrs["SessionAlias"] = result.summary.recording_id
            session.attrs["PositionAlgoVersion"] = f"trackfg {__version__}"
            _group(session, "CONFIGURATION", "Configuration")
            _sections(session, result, stamps)
            _position(session, result, stamps, options)
            _geometry(session, result, zero_ns)
            _events(session, result, zero_ns)


_COMMENT = "http://www.sbb.ch/RCMDX/Events/Comment"
_VERSION_NAMES = ("Major", "Minor", "Feature")


def _group(parent: Any, name: str, element: str) -> Any:
    group = parent.create_group(name)
    group.attrs["Element"] = element
    return group


def _stamps(t: Array, zero_ns: int) -> np.ndarray:
    return np.asarray(zero_ns + np.round(t * 1e9).astype(np.int64)).astype(np.uint64)


def _texts(group: Any, name: str, values: list[str]) -> None:
    dtype = library("h5py", "hdf5").string_dtype("utf-8")
    group.create_dataset(name, data=np.array(values, dtype=object), dtype=dtype)


def _sections(session: Any, result: Result, stamps: np.ndarray) -> None:
    """Write one section: the whole run, on a track whose id is not known."""
    group = _group(session, "SECTIONS", "Sections")
    travelled = travelled_m(result.trajectory)
    chainage = result.trajectory["chainage_m"].to_numpy()
    direction = direction_of(result)
    _texts(group, "direction", ["FORWARD"])
    _texts(group, "trackKilometrage", ["ASCENDING" if direction == 1 else "DESCENDING"])
    for name, value in (
        ("startTimestamp", stamps[0]),
        ("endTimestamp", stamps[-1]),
        ("trackStartTimestamp", stamps[0]),
        ("trackEndTimestamp", stamps[-1]),
    ):
        group[name] = np.array([value], dtype=np.uint64)
    for name, number in (
        ("firstTrackOffset", chainage[0]),
        ("lastTrackOffset", chainage[-1]),
        ("trackInfoOffset", 1.0),
        ("trackStartCoveredDistance", travelled[0]),
        ("trackEndCoveredDistance", travelled[-1]),
    ):
        group[name] = np.array([number], dtype=np.float64)
    group["trackId"] = np.array([_UNKNOWN_ID], dtype=np.int32)


def _position(session: Any, result: Result, stamps: np.ndarray, options: ExportOptions) -> None:
    track = result.trajectory
    source = _group(_group(session, "POSITION", "System"), "POSITION.SOURCE", "Datasource")
    source["timestamp"] = stamps
    data = _group(source, "POSITION.SOURCE.DATA", "Channel")
    chainage, rows = track["chainage_m"].to_numpy(), len(track)
    line = line_kilometrage(result) if options.km else LineKilometrage()
    kilometrage = line.kilometrage()
    data["covereddistance"] = travelled_m(track)
    data["trackoffset"] = chainage
    data["lineoffset"] = kilometrage.official_m(chainage) / 1000.0
    data["positionaccuracy"] = track["chainage_m_sd"].to_numpy(dtype=np.float32)
    data["track_id"] = np.full(rows, _number(line.track), dtype=np.int32)
    data["line_id"] = np.full(rows, _number(line.line), dtype=np.int32)
    # 0 is very good and 15 very poor: a step for each doubling of the sigma from 0.1 m on.
    quality = np.ceil(np.log2(np.maximum(track["chainage_m_sd"].to_numpy(), 0.05) / 0.05))
    data["positionquality"] = np.clip(quality, 0, 15).astype(np.int32)
    forward = _forward(track["speed_mps"].to_numpy(), track["speed_mps_sd"].to_numpy())
    _texts(data, "direction", ["FORWARD" if ahead else "BACKWARD" for ahead in forward])
    growing = forward == (kilometrage.ascends(chainage) == (direction_of(result) == 1))
    _texts(data, "kilometrage", ["INCREASING" if grows else "DECREASING" for grows in growing])


def _forward(speed_mps: Array, sd_mps: Array) -> np.ndarray:
    """Return whether the direction is forward (n,): at rest that of the motion before it, or else of the first one."""
    moving = np.flatnonzero(np.abs(speed_mps) > _REST_SIGMAS * sd_mps)
    if not len(moving):
        return np.ones(len(speed_mps), dtype=bool)
    last = np.searchsorted(moving, np.arange(len(speed_mps)), side="right") - 1
    return np.asarray(speed_mps[moving[np.maximum(last, 0)]] > 0.0)


def _number(name: str) -> int:
    """Return the id of a line or a track as the file has it, a number of 32 bits; unknown where it is none."""
    return int(name) if name.isdecimal() and int(name) < 2**31 else _UNKNOWN_ID


def _geometry(session: Any, result: Result, zero_ns: int) -> None:
    """Write the geometry in order of time, as its stamps have to ascend."""
    located = located_geometry(result).dropna(subset=["t_s"]).sort_values("t_s")
    if located.empty:
        return
    source = _group(_group(session, "TGMS", "System"), "GEOMETRY", "Datasource")
    source["timestamp"] = _stamps(located["t_s"].to_numpy(), zero_ns)
    columns = [name for name in result.geometry.columns if name not in ("chainage_m", "chainage_m_sd")]
    for name in ("chainage_m", "chainage_m_sd", *columns):
        quantity, _, unit = name.removesuffix("_sd").rpartition("_")
        channel = _group(source, f"{quantity}{'_SD' if name.endswith('_sd') else ''}".upper(), "Channel")
        side = "LEFT" if "left" in quantity else "RIGHT" if "right" in quantity else ""
        channel.attrs["ChannelBasis"] = f"MOVE_DIRECTION_VERTICAL_{side}" if side else "TOTAL"
        channel.attrs["TriggerMode"] = "DISTANCE"
        channel.attrs["CommonTriggerDistance"] = np.float32(result.summary.geometry.step_m)
        channel.attrs["CommonTriggerFrequency"] = np.float32(0.0)
        channel.attrs["MeasurementType"] = "MEASURED_VALUE"
        opposite = {"LEFT": "RIGHT", "RIGHT": "LEFT"}.get(side, "")
        channel.attrs["Neighbor"] = channel.name.rpartition("/")[2].replace(side, opposite) if side else ""
        channel.attrs["PositionOffset"] = np.float32(0.0)
        data = channel.create_dataset("data", data=located[name].to_numpy(dtype=np.float64), compression="gzip")
        data.attrs["Unit"] = _UNITS.get(unit, unit)


def _comment(text: str, name: str) -> str:
    """Return a comment as the specification's schema has it; its id is made from the run and the event's number."""
    number = uuid.uuid5(uuid.NAMESPACE_URL, f"trackfg:{name}")
    return f'<Comment xmlns="{_COMMENT}" Username="trackfg" ID="{number}">{escape(text)}</Comment>'


def _events(session: Any, result: Result, zero_ns: int) -> None:
    events = result.events
    if events.empty:
        return
    group = _group(session, "EVENTS", "Events")
    starts = _stamps(events["start_s"].to_numpy(), zero_ns)
    order = np.argsort(starts, kind="stable")
    group["timestamp"] = starts[order]
    group["duration"] = np.round((events["end_s"] - events["start_s"]).to_numpy() * 1e9).astype(np.int64)[order]
    texts = [f"{kind}. {detail}".strip(". ") for kind, detail in zip(events["kind"], events["detail"], strict=True)]
    _texts(group, "data", [_comment(texts[i], f"{result.summary.recording_id}/{i}") for i in order])
    _texts(group, "eventtype", ["Comment"] * len(events))
    _texts(group, "systemref", ["POSITION"] * len(events))
