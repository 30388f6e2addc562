"""Tables: CSV, spreadsheets, channel files."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.csv

from trackfg.errors import BadInputError
from trackfg.files.libraries import library
from trackfg.interchange.exporting.channels import channel_table, read_template
from trackfg.interchange.exporting.located import table_of
from trackfg.interchange.exporting.result_format import ExportOptions, ResultFormat
from trackfg.results.columns import BAND_COLUMNS
from trackfg.results.result import Result

_SHEET_ROWS = 1_048_576
"""Rows that a sheet of .xlsx may have (ECMA-376)."""


class Csv(ResultFormat):
    """One table with commas, numbers to the last digit; positions beside the result's columns."""

    key = "csv"
    suffix = ".csv"
    title = "one table of the result as CSV, with times and positions"

    def file_name(self, result_name: str, options: ExportOptions) -> str:
        """Return the result's name, followed by that of the table where it is not the geometry."""
        table = "" if options.table == "geometry" else f".{options.table}"
        return f"{result_name}{table}{self.suffix}"

    def write(self, result: Result, path: Path, options: ExportOptions) -> None:
        """Write the table that the options name."""
        _write_csv(table_of(result, options.table, km=options.km, bands=options.bands), path)


class Excel(ResultFormat):
    """All tables of the result, a sheet each."""

    key = "xlsx"
    suffix = ".xlsx"
    title = "all tables of the result as a spreadsheet"

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
            sheet.append(list(table.columns))
            for row in table.astype(object).where(table.notna(), None).itertuples(index=False):
                sheet.append(list(row))
        book.save(path)


class Channels(ResultFormat):
    """A channel file of a template, :mod:`trackfg.interchange.exporting.channels`."""

    key = "channels"
    suffix = ".channels.csv"
    title = "channels in the style of EN 13848, by a template"

    def write(self, result: Result, path: Path, options: ExportOptions) -> None:
        """Write the channels of the template, or of the built-in one."""
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
