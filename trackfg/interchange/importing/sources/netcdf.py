"""Classic netCDF (.nc of the kinds CDF-1 and CDF-2), as models, data loggers and MATLAB write it."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from trackfg.interchange.importing.shapes.array_tables import names_rate, tables_of_arrays
from trackfg.interchange.importing.shapes.dates_since import with_dates
from trackfg.interchange.importing.shapes.packed_values import unit_in, unpacked
from trackfg.interchange.importing.shapes.usual_shape import in_usual_shape_of_types
from trackfg.interchange.importing.source_format import DialectFor, SourceFormat, readable, refuse_empty, starts_with
from trackfg.interchange.importing.source_table import SourceTable


class ClassicNetCdf(SourceFormat):
    """Variables of one length are a table, with their units, packed or not; netCDF-4 is HDF5."""

    key = "netcdf"
    title = "classic netCDF (.nc)"

    def recognises(self, path: Path) -> bool:
        """Return whether the file begins as one of classic netCDF does, but for CDF-5."""
        return starts_with(path, b"CDF\x01", b"CDF\x02")

    def tables(self, path: Path, dialect_for: DialectFor) -> Sequence[SourceTable]:
        """Read the variables of numbers."""
        library: Any = importlib.import_module("scipy.io")
        arrays, units = dict[str, np.ndarray](), dict[str, str]()
        with readable(path, "a file of classic netCDF"), library.netcdf_file(path, "r", mmap=False) as file:
            for name, variable in file.variables.items():
                attributes = {key.casefold(): value for key, value in variable._attributes.items()}
                values = np.asarray(variable.data)
                if values.dtype.kind not in "iuf":
                    continue
                arrays[name] = unpacked(values.astype(values.dtype.newbyteorder("=")), attributes)
                if (unit := unit_in(attributes)) is not None:
                    units[name] = unit
            rates = {key: np.asarray(value) for key, value in file._attributes.items() if names_rate(key)}
        tables = [with_dates(table) for table in tables_of_arrays({**arrays, **rates}, path.name, units)]
        return refuse_empty(in_usual_shape_of_types(tables), path, "variables of numbers")
