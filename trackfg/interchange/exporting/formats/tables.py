"""Tables: CSV, spreadsheets, channel files."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.csv

from trackfg.errors import BadInputError
from trackfg.files.libraries import library
from trackfg.interchange.exporting.channels import channel_table, read_template
from trackfg.interchange.exporting.located_tables import origin_of, start_of, table_of
from trackfg.interchange.exporting.result_format import ExportOptions, ResultFormat
from trackfg.results.columns import BAND_COLUMNS
from trackfg.results.result import Result

_SHEET_ROWS = 1_048_576
"""Rows that a sheet of .xlsx may have (ECMA-376)."""
_DATE_WIDTH = 20
"""Width of a column with dates and seconds, in characters."""


class Csv(ResultFormat):
    """One table with commas, numbers to the last digit; positions beside the result's columns."""

    key = "csv"
    suffix = ".csv"
    title = "one table of the result as CSV, with times and positions"
    takes = frozenset({"table", "km", "bands"})

    def file_name(self, result_name: str, options: ExportOptions) -> str:
        """Return the result's name, followed by that of the table where it is not the geometry."""
        table = "" if options.table == "geometry" else f".{options.table}"
        return f"{result_name}{table}{self.suffix}"

    def write(self, result: Result, path: Path, options: ExportOptions) -> None:
        """Write the table that the options name. Raises where it is the geometry and there is none."""
        if options.bands and options.table != "geometry":
            raise BadInputError(f"--bands: {options.table} has none; expected --table geometry")
        if options.table == "geometry":
            result.geometry_for("csv (--table trajectory needs none)")
        _write_csv(table_of(result, options.table, km=options.km, bands=options.bands), path)


class Excel(ResultFormat):
    """All tables of the result, a sheet each."""

    key = "xlsx"
    suffix = ".xlsx"
    title = "all tables of the result as a spreadsheet"
    takes = frozenset({"km", "bands"})

    def write(self, result: Result, path: Path, options: ExportOptions) -> None:
        """Write the sheets geometry, trajectory and events, and balises if there are any.

        Raises where a table is longer than a sheet can be.
        """
        openpyxl = library("openpyxl", "excel")
        book = openpyxl.Workbook(write_only=True)
        for name in ("geometry", "trajectory", "events", *(("balises",) if len(result.balises) else ())):
            table = table_of(result, name, km=options.km, bands=options.bands)
            if len(table) >= _SHEET_ROWS:
                raise BadInputError(
                    f"{name} has {len(table)} rows; expected fewer than {_SHEET_ROWS} for .xlsx. Hint: csv"
                )
            sheet = book.create_sheet(name)
            sheet.freeze_panes = "B2"
            for i, column in enumerate(table.columns, start=1):
                width = max(len(column) + 2, _DATE_WIDTH if table[column].dtype.kind == "M" else 0)
                sheet.column_dimensions[openpyxl.utils.get_column_letter(i)].width = width
            sheet.append(list(table.columns))
            for row in table.astype(object).where(table.notna(), None).itertuples(index=False):
                sheet.append(list(row))
        book.properties.title = result.summary.recording_id
        book.properties.description = _about(result)
        book.save(path)


def _about(result: Result) -> str:
    """Return what a reader of the tables must know and no column says: the properties of the file show it."""
    start, origin = start_of(result), origin_of(result)
    zero = "the recording's start" if start is None else start.isoformat(sep=" ")
    place = "the recording's start" if origin is None else "{:.9f}, {:.9f}, {:.4f} m (WGS 84)".format(*origin)
    return (
        f"t_s counts from {zero}; east_m, north_m, up_m count from {place}. Names end in their unit; x_sd is the "
        "standard deviation of x, in its unit."
    )


class Channels(ResultFormat):
    """A channel file of a template, :mod:`trackfg.interchange.exporting.channels`."""

    key = "channels"
    suffix = ".channels.csv"
    title = "channels in the style of EN 13848, by a template"
    takes = frozenset({"channels", "km", "bands"})

    def write(self, result: Result, path: Path, options: ExportOptions) -> None:
        """Write the channels of the template, or of the built-in one. Raises where there is no geometry."""
        result.geometry_for("channels")
        channels = options.channels or read_template(None)
        bands = options.bands or any(channel.column in BAND_COLUMNS for channel in channels)
        _write_csv(channel_table(table_of(result, "geometry", km=options.km, bands=bands), channels), path)


def _write_csv(table: pd.DataFrame, path: Path) -> None:
    arrow = pa.Table.from_pandas(table, preserve_index=False)
    without_nan = [
        pa.compute.if_else(pa.compute.is_finite(column), column, None) if pa.types.is_floating(column.type) else column
        for column in arrow.columns
    ]
    pa.csv.write_csv(pa.table(without_nan, names=arrow.column_names), path)
