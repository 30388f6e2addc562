"""Columns of Parquet files, read one at a time."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet

from trackfg.interchange.importing.sources.columnar import read_arrow


def test_of_columns_of_one_name_the_last_is_read_and_structures_are_left_out(tmp_path: Path) -> None:
    columns = [[1.0], [2.0], [{"x": 5.0}], [3.0]]
    table = pa.Table.from_arrays([pa.array(values) for values in columns], names=["a", "a", "b", "b.x"])
    pa.parquet.write_table(table, tmp_path / "log.parquet")
    (read,) = read_arrow(tmp_path / "log.parquet")
    assert read.frame.to_dict("list") == {"a": [2.0], "b.x": [3.0]}
