"""MCAP with Foxglove's JSON schemas: the pose, the place on the Earth, and the sigmas, for viewers of research."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from trackfg.files.libraries import library
from trackfg.interchange.exporting.located_tables import located_trajectory, quaternions_of, start_of
from trackfg.interchange.exporting.result_format import ExportOptions, ResultFormat
from trackfg.results.result import Result

_OBJECT = {"type": "object"}
_TIME = {"type": "object", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}}
_SCHEMAS = {
    "foxglove.PoseInFrame": {"timestamp": _TIME, "frame_id": {"type": "string"}, "pose": _OBJECT},
    "foxglove.LocationFix": {
        "timestamp": _TIME,
        **{name: {"type": "number"} for name in ("latitude", "longitude", "altitude")},
    },
    "trackfg.State": {"timestamp": _TIME},
}


class Mcap(ResultFormat):
    """Topics ``/pose``, ``/state`` (all columns with sigmas) and, with GNSS, ``/location``."""

    key = "mcap"
    suffix = ".mcap"
    title = "MCAP with Foxglove's schemas: pose, place, states with sigmas"
    takes = frozenset[str]()
    needs_trajectory = True

    def write(self, result: Result, path: Path, options: ExportOptions) -> None:
        """Write one message a topic and instant; times count from the recording's start where that is known."""
        writer_of = library("mcap.writer", "mcap")
        track = located_trajectory(result)
        start = start_of(result)
        zero = 0 if start is None else start.value
        stamps = zero + np.round(track["t_s"].to_numpy() * 1e9).astype(np.int64)
        with path.open("wb") as stream:
            writer = writer_of.Writer(stream)
            writer.start()
            topics = {"/pose": "foxglove.PoseInFrame", "/state": "trackfg.State"}
            if "latitude_deg" in track:
                topics["/location"] = "foxglove.LocationFix"
            channels = {topic: _channel(writer, topic, schema) for topic, schema in topics.items()}
            rows = [dict(zip(track.columns, values, strict=True)) for values in track.to_numpy().tolist()]
            for stamp, row, quaternion in zip(stamps.tolist(), rows, quaternions_of(track), strict=True):
                time = {"sec": stamp // 1_000_000_000, "nsec": stamp % 1_000_000_000}
                messages: dict[str, dict[str, Any]] = {
                    "/pose": {"frame_id": "enu", "pose": _pose(row, quaternion)},
                    "/state": row,
                }
                if "/location" in topics:
                    messages["/location"] = _location(row)
                for topic, message in messages.items():
                    data = json.dumps({"timestamp": time, **message}).encode()
                    writer.add_message(channels[topic], stamp, data, stamp)
            writer.finish()


def _channel(writer: Any, topic: str, schema: str) -> int:
    text = json.dumps({"title": schema, "type": "object", "properties": _SCHEMAS[schema]}).encode()
    number = writer.register_schema(name=schema, encoding="jsonschema", data=text)
    return int(writer.register_channel(topic=topic, message_encoding="json", schema_id=number))


def _pose(row: dict[str, Any], quaternion: np.ndarray) -> dict[str, Any]:
    position = {axis: row[name] for axis, name in zip("xyz", ("east_m", "north_m", "up_m"), strict=True)}
    return {"position": position, "orientation": dict(zip("xyzw", map(float, quaternion), strict=True))}


def _location(row: dict[str, Any]) -> dict[str, Any]:
    variances = [row[f"{name}_sd"] ** 2 for name in ("east_m", "north_m", "up_m")]
    covariance = np.diag(variances).ravel().tolist()
    return {
        "frame_id": "vehicle",
        "latitude": row["latitude_deg"],
        "longitude": row["longitude_deg"],
        "altitude": row["height_m"],
        "position_covariance": covariance,
        "position_covariance_type": 2,
    }
