"""Geographic formats: GeoJSON, GPX, GeoPackage, GeoParquet: WGS 84, longitude first, ellipsoidal heights."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from trackfg.files.libraries import library
from trackfg.interchange.exporting.located_tables import (
    GEODETIC_COLUMNS,
    located_trajectory,
    start_of,
    table_of,
    travelled_m,
)
from trackfg.interchange.exporting.result_format import ExportOptions, ResultFormat
from trackfg.numerics.arrays import Array
from trackfg.numerics.geometry_blob import line_wkb, point_wkb
from trackfg.results.official_places import line_kilometrage
from trackfg.results.result import Result

_GDAL_UTC = 100
"""GDAL's number of the zone of a date that is UTC (``OGR_TZFLAG_UTC``)."""
_GPX = "http://www.topografix.com/GPX/1/1"


class GeoJson(ResultFormat):
    """The path as one line, and the events as points (RFC 7946)."""

    key = "geojson"
    suffix = ".geojson"
    title = "GeoJSON: the path as a line, events as points"
    takes = frozenset({"step_m", "km"})
    needs_place = True

    def write(self, result: Result, path: Path, options: ExportOptions) -> None:
        """Write the features, vertices ``step_m`` apart."""
        track = located_trajectory(result)
        coordinates = np.round(_lon_lat_height(_vertices(track, options.step_m)), 9).tolist()
        line = {"type": "LineString", "coordinates": coordinates}
        about = {"kind": "path", **_about(result, options)}
        features: list[dict[str, Any]] = [{"type": "Feature", "geometry": line, "properties": about}]
        for event, place in _placed_events(result, track, options):
            point = None if place is None else {"type": "Point", "coordinates": np.round(place, 9).tolist()}
            features.append({"type": "Feature", "geometry": point, "properties": event})
        collection = {"type": "FeatureCollection", "features": features}
        path.write_text(json.dumps(collection, allow_nan=False, default=_iso), encoding="utf-8")


class Gpx(ResultFormat):
    """The path as one track with times (GPX 1.1); times need a recording whose start is known."""

    key = "gpx"
    suffix = ".gpx"
    title = "GPX 1.1: the path as a track"
    takes = frozenset({"step_m"})
    needs_place = True

    def write(self, result: Result, path: Path, options: ExportOptions) -> None:
        """Write the track, points ``step_m`` apart."""
        track = _vertices(located_trajectory(result), options.step_m)
        etree = library("lxml.etree", "xml")
        root = etree.Element(f"{{{_GPX}}}gpx", nsmap={None: _GPX}, version="1.1", creator="trackfg")
        trk = etree.SubElement(root, f"{{{_GPX}}}trk")
        etree.SubElement(trk, f"{{{_GPX}}}name").text = result.summary.recording_id
        segment = etree.SubElement(trk, f"{{{_GPX}}}trkseg")
        start = start_of(result)
        times = None if start is None else start.tz_localize(None) + pd.to_timedelta(track["t_s"], unit="s")
        for i, (longitude, latitude, height) in enumerate(_lon_lat_height(track)):
            point = etree.SubElement(segment, f"{{{_GPX}}}trkpt", lat=f"{latitude:.9f}", lon=f"{longitude:.9f}")
            etree.SubElement(point, f"{{{_GPX}}}ele").text = f"{height:.4f}"
            if times is not None:
                etree.SubElement(point, f"{{{_GPX}}}time").text = _iso(times.iloc[i])
        etree.ElementTree(root).write(str(path), xml_declaration=True, encoding="utf-8", pretty_print=True)


class GeoPackage(ResultFormat):
    """Layers ``geometry`` (a point each 0.25 m with all columns), ``path`` (a line) and ``events``, for QGIS."""

    key = "gpkg"
    suffix = ".gpkg"
    title = "GeoPackage: points of the geometry, the path, events"
    takes = frozenset({"step_m", "km"})
    needs_place = True

    def write(self, result: Result, path: Path, options: ExportOptions) -> None:
        """Write the layers, in EPSG:4979's axes as GIS use them, EPSG:4326."""
        raw = library("pyogrio.raw", "gis")
        points = table_of(result, "geometry", km=options.km).dropna(subset=list(GEODETIC_COLUMNS))
        if len(points):
            fields = points.drop(columns=list(GEODETIC_COLUMNS))
            _layer(raw, path, "geometry", ("Point Z", _points(points)), fields)
        track = located_trajectory(result)
        line = pd.DataFrame([_about(result, options)])
        _layer(raw, path, "path", ("LineString Z", [line_wkb(_lon_lat_height(_vertices(track, options.step_m)))]), line)
        placed = [(event, place) for event, place in _placed_events(result, track, options) if place is not None]
        if placed:
            numbers = result.events.select_dtypes("float").columns  # also where no event has one
            fields = pd.DataFrame([event for event, _ in placed]).astype(dict.fromkeys(numbers, "float64"))
            _layer(raw, path, "events", ("Point Z", [point_wkb(place) for _, place in placed]), fields)


class GeoParquet(ResultFormat):
    """The geometry's rows with a column ``geometry`` (GeoParquet 1.1: well-known binary, WGS 84)."""

    key = "geoparquet"
    suffix = ".parquet"
    title = "GeoParquet 1.1: points of the geometry with all columns"
    takes = frozenset({"km"})
    needs_place = True

    def write(self, result: Result, path: Path, options: ExportOptions) -> None:
        """Write the rows that have a place."""
        points = table_of(result, "geometry", km=options.km).dropna(subset=list(GEODETIC_COLUMNS))
        table = pa.Table.from_pandas(points, preserve_index=False)
        table = table.append_column("geometry", pa.array(_points(points), pa.binary()))
        column = {"encoding": "WKB", "geometry_types": ["Point Z"]}  # without crs: longitude, latitude of WGS 84
        geo = {"version": "1.1.0", "primary_column": "geometry", "columns": {"geometry": column}}
        pq.write_table(table.replace_schema_metadata({"geo": json.dumps(geo)}), path)


def _iso(date: pd.Timestamp) -> str:
    """Return a date in UTC as text."""
    return f"{date.isoformat()}Z"


def _about(result: Result, options: ExportOptions) -> dict[str, Any]:
    """Return the recording of a path, its start where that is known, and with official places its line and track."""
    about: dict[str, Any] = {"recording": result.summary.recording_id}
    start = start_of(result)
    if start is not None:
        about["start_utc"] = start.tz_localize(None)
    if options.km:
        line = line_kilometrage(result)
        about |= {"line": line.line, "track": line.track}
    return about


def _vertices(track: pd.DataFrame, step_m: float) -> pd.DataFrame:
    """Return the rows of a trajectory that are at least ``step_m`` of travel apart."""
    cell = np.floor(travelled_m(track) / step_m)
    kept = np.concatenate([[True], cell[1:] > cell[:-1]])
    kept[-1] = True
    return track[kept]


def _lon_lat_height(table: pd.DataFrame) -> Array:
    return table[["longitude_deg", "latitude_deg", "height_m"]].to_numpy()


def _placed_events(
    result: Result, track: pd.DataFrame, options: ExportOptions
) -> list[tuple[dict[str, Any], Array | None]]:
    """Return each event with its columns, and where on the located ``track`` the vehicle was when it began."""
    events = table_of(result, "events", km=options.km)
    times, places = track["t_s"].to_numpy(), _lon_lat_height(track)
    values = events.astype(object).where(events.notna(), None).to_numpy().tolist()
    rows = [dict(zip(map(str, events.columns), row, strict=True)) for row in values]
    out: list[tuple[dict[str, Any], Array | None]] = []
    for row in rows:
        t = row["start_s"]
        inside = t is not None and times[0] <= t <= times[-1]
        out.append((row, np.array([np.interp(t, times, column) for column in places.T]) if inside else None))
    return out


def _points(table: pd.DataFrame) -> list[bytes]:
    return [point_wkb(place) for place in _lon_lat_height(table)]


def _layer(raw: Any, path: Path, name: str, shape: tuple[str, list[bytes]], fields: pd.DataFrame) -> None:
    kind, blobs = shape
    data = [fields[column].to_numpy() for column in fields.columns]
    types = {"i": "float64", "u": "float64", "f": "float64", "M": "datetime64[ms]"}
    columns = [values.astype(types.get(values.dtype.kind, object)) for values in data]
    dates = [name for name, values in zip(fields.columns, columns, strict=True) if values.dtype.kind == "M"]
    raw.write(
        path,
        np.array(blobs, dtype=object),
        columns,
        np.array(fields.columns, dtype=object),
        layer=name,
        driver="GPKG",
        geometry_type=kind,
        crs="EPSG:4326",
        gdal_tz_offsets={name: np.full(len(fields), _GDAL_UTC) for name in dates},
        append=path.exists(),
    )
