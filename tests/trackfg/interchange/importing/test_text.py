"""Text of any kind: dialects, times, places; and the vendor's log that once took an hour."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trackfg.errors import BadInputError
from trackfg.interchange.importing.columns.column_meaning import has_gravity, triples
from trackfg.interchange.importing.columns.column_names import meaning, parts_of
from trackfg.interchange.importing.columns.time_columns import time_unit
from trackfg.interchange.importing.columns.written_units import Quantity, factor_of, unit_in
from trackfg.interchange.importing.conversion import Imported
from trackfg.interchange.importing.delimited.data_rows import first_data_row
from trackfg.interchange.importing.delimited.dialect import DialectOptions, dialect_of
from trackfg.interchange.importing.delimited.text_table import read_text
from trackfg.interchange.importing.sensors.sample_stamps import spread_stamps
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.interchange.importing.stations import read_stations
from trackfg.interchange.importing.times.counters import unwrapped
from trackfg.interchange.importing.times.notation import TimeNotation
from trackfg.interchange.importing.times.reading import read_times

sys.path.insert(0, str(Path(__file__).parents[4] / "tools"))

from interchange.foreign_forms import Drive


def _write(folder: Path, text: str, encoding: str = "utf-8") -> Path:
    path = folder / "log.csv"
    path.write_bytes(text.encode(encoding))
    return path


def test_a_row_with_few_cells_is_one_of_values_unless_the_names_follow():
    names = ["row", "place [m]", "level [mm]", "twist [mm]", "alignment [mm]", "gauge [mm]"]
    values = [[str(i), str(0.25 * i), "1.5", "-0.2", "0.7", "1435.1"] for i in range(4)]
    assert first_data_row([names, ["0", "0.0", "", "", "", ""], *values], len(names)) == 1
    assert first_data_row([["rate", "100", "", "", "", ""], names, *values], len(names)) == 2


@pytest.mark.parametrize("delimiter", [";", "\t", ",", "|", "  "])
@pytest.mark.parametrize("decimal", [".", ","])
@pytest.mark.parametrize("remarks", [0, 3])
def test_delimiter_decimal_sign_and_header_are_found(tmp_path, delimiter, decimal, remarks):
    if delimiter == decimal:
        pytest.skip("no such file can be read")
    values = np.random.default_rng(1).normal(size=(30, 4)).round(6)
    rows = [delimiter.join(f"{v:.6f}".replace(".", decimal) for v in row) for row in values]
    head = [f"remark {i}: measured by crew {i}" for i in range(remarks)]
    names = ["time", "gyro_x", "gyro_y", "gyro_z"]

    table = read_text(_write(tmp_path, "\n".join([*head, delimiter.join(names), *rows]) + "\n"))

    assert table.columns == names
    assert table.first_row == remarks + 2
    np.testing.assert_array_equal(table.frame.to_numpy(), values)


@pytest.mark.parametrize("delimiter", [";", ",", "\t", "|"])
@pytest.mark.parametrize("clock", ["03:12:00.{:03d}", "03:12:00.{:03d}Z", "03:12:00.{:03d}+02:00"])
def test_a_date_with_a_blank_beside_a_column_of_text_does_not_part_rows_at_blanks(tmp_path, delimiter, clock):
    rows = [delimiter.join([f"2026-05-01 {clock.format(i)}", f"{i / 7:.4f}", "-0.5", "OK"]) for i in range(60)]
    names = ["time", "gyro_x", "gyro_y", "status"]

    table = read_text(_write(tmp_path, "\n".join([delimiter.join(names), *rows]) + "\n"))

    assert table.columns == names
    assert set(table.frame["status"]) == {"OK"}


def test_units_are_taken_from_brackets_or_from_a_row_of_their_own(tmp_path):
    in_names = read_text(_write(tmp_path, "Zeit [s];Drehrate x (°/s)\n0,00;1,5\n0,01;1,6\n", "cp1252"))
    own_row = read_text(_write(tmp_path, "Zeit;Drehrate x\n[s];[°/s]\n0,00;1,5\n0,01;1,6\n", "cp1252"))

    for table in (in_names, own_row):
        assert table.columns == ["Zeit", "Drehrate x"]
        assert table.units == {"Zeit": "s", "Drehrate x": "°/s"}
        assert table.frame["Drehrate x"].tolist() == [1.5, 1.6]


@pytest.mark.parametrize(
    ("clock", "cells", "values"),
    [
        ("03:12:00,{:03d}", ["998.998", "999.123", "1.000.004"], [998998.0, 999123.0, 1000004.0]),
        ("03:12:00,{:03d}", ["998.998", "999.123", "1000.004"], [998.998, 999.123, 1000.004]),
        ("03:12:00.{:03d}", ["998.998", "999.123", "999.700"], [998.998, 999.123, 999.7]),
        ("03:12:00,{:03d}", ["0.998", "1.123", "1.700"], [0.998, 1.123, 1.7]),
    ],
)
def test_a_decimal_comma_of_the_time_makes_points_those_of_groups(tmp_path, clock, cells, values):
    """Where all numbers of a table may be either, as a count of pulses in a file of its own."""
    rows = [f"01.05.2026 {clock.format(i)};{cell}" for i, cell in enumerate(cells)]

    table = read_text(_write(tmp_path, "\n".join(["Zeit;Impulse", *rows]) + "\n"))

    assert table.frame["Impulse"].tolist() == values


@pytest.mark.parametrize(("delimiter", "decimal"), [(";", ","), ("\t", "."), (",", ".")])
def test_a_minus_of_typesetters_is_one(tmp_path, delimiter, decimal):
    rows = [delimiter.join((f"0.0{i}", f"\u22120.5{i}", f"\u22121{i}")).replace(".", decimal) for i in range(9)]

    table = read_text(_write(tmp_path, "\n".join([delimiter.join("txn"), *rows]) + "\n"))

    assert table.frame["x"].tolist() == [-float(f"0.5{i}") for i in range(9)]
    assert table.frame["n"].tolist() == [-10 - i for i in range(9)]


def test_names_may_have_line_breaks(tmp_path):
    """As cells of a spreadsheet have them."""
    text = 'Crew: A\n"Time\n[s]","Gyro X\n[deg/s]",Count\n' + "".join(f"{i},{i}.5,{7 * i}\n" for i in range(9))

    table = read_text(_write(tmp_path, text))

    assert table.columns == ["Time", "Gyro X", "Count"]
    assert table.units == {"Time": "s", "Gyro X": "deg/s"}
    assert table.first_row == 5
    assert table.frame["Count"].tolist() == [7 * i for i in range(9)]


def test_a_mark_of_inches_above_a_table_opens_no_cell(tmp_path):
    table = read_text(_write(tmp_path, 'wheel; 36"\ncrew; "A\nt;x\n' + "".join(f"{i};{i}.5\n" for i in range(9))))

    assert table.columns == ["t", "x"]
    assert len(table.frame) == 9


def test_names_that_come_again_may_begin_with_an_empty_one(tmp_path):
    """InfluxDB writes its header above each series."""
    head = "#datatype,string,long,dateTime:RFC3339,double,string\n,result,table,_time,_value,_field\n"
    parts = [
        head + "".join(f",,{k},2026-05-01T03:12:0{i}Z,{k + i / 10},{name}\n" for i in range(9)) + "\n"
        for k, name in enumerate(("gyro_x", "gyro_y"))
    ]

    table = read_text(_write(tmp_path, "".join(parts)))

    assert table.frame["_value"].tolist() == [k + i / 10 for k in range(2) for i in range(9)]
    assert table.notes == ("log.csv: 1 row that has the names or units of the columns again: left out",)


def test_what_the_mapping_states_is_not_guessed(tmp_path):
    path = _write(tmp_path, "1;2\n3;4\n5;6\n")

    table = read_text(path, DialectOptions(header_row=0, first_row=2))

    assert table.columns == ["c1", "c2"]
    assert table.frame.to_numpy().tolist() == [[3, 4], [5, 6]]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "empty"),
        ("\n\n", "empty"),
        ("hello world\nthis is prose\n", "no rows of numbers"),
        ("a;b\n1;2\n3;4\n5;6;7\n8;9\n", "row 4 has 3 cells; expected 2"),
        ("a;b\n1;2\n3\n5;6\n", "row 3 has 1 cell; expected 2, as in the others$"),
        (
            "a;b\n1;2\n3;4\n5",
            "row 4 has 1 cell; expected 2, as in the others. Hint: it is the last row: where the file",
        ),
        ("a,b\n\x00\x01", "null bytes"),
        ("a,b\n1,2\n" * 30_000 + "\x00" * 5_000, "ends in null bytes: it was not written whole"),
    ],
)
def test_text_that_is_no_table_is_refused_with_its_row(tmp_path, text, message):
    with pytest.raises(BadInputError, match=message):
        read_text(_write(tmp_path, text))


def test_a_cell_that_is_no_number_is_named_with_its_row_in_the_file(tmp_path):
    table = read_text(_write(tmp_path, "remark\nt;x\n0;1\n1;1e\n2;3\n"))

    with pytest.raises(BadInputError, match=r"log.csv: column 'x', row 4: '1e' is not a number"):
        table.numbers("x")
    with pytest.raises(BadInputError, match="no column 'y'"):
        table.numbers("y")


@pytest.mark.parametrize(("time", "numeric"), [("25.10.2026 02:56:00,{:03d}", False), ("17,{:03d}", True)])
@pytest.mark.parametrize("end", ["", "\n", "\nAnzahl Zeilen: 60\n"])
def test_rows_that_sum_up_a_table_are_left_out_with_a_note(tmp_path, time, numeric, end):
    rows = [f"{time.format(i)};0,{i:03d};1" for i in range(60)]
    below = ["Mittelwert;0,013;", "Max;;72,0"]

    table = read_text(_write(tmp_path, "\n".join(["Zeit;Drehrate X;Status", *rows, *below]) + end))

    assert len(table.frame) == 60
    assert pd.api.types.is_numeric_dtype(table.frame["Zeit"]) == numeric
    assert pd.api.types.is_numeric_dtype(table.frame["Status"])
    message = "log.csv: rows below the data are left out: 2, the first of which is 'Mittelwert;0,013;'"
    assert table.notes == (message,)


def test_words_among_the_data_are_not_its_end(tmp_path):
    table = read_text(_write(tmp_path, "n;x\n1;0.5\n2;0.6\noverflow;0.7\n4;0.8\n"))

    assert len(table.frame) == 4
    assert not table.notes


def test_an_unknown_encoding_is_refused(tmp_path):
    with pytest.raises(BadInputError, match="unknown encoding"):
        dialect_of(_write(tmp_path, "a;b\n1;2\n"), DialectOptions(encoding="klingon"))


def _times(cells: list, **notation: object) -> np.ndarray:
    table = SourceTable("log.csv", pd.DataFrame({"t": pd.Series(cells)}))
    times = read_times(table, ("t",), TimeNotation(**notation))
    return times.since(None if times.ns is None else int(times.ns[0]))


@pytest.mark.parametrize(
    "cells",
    [
        ["2026-05-01T03:12:00.000Z", "2026-05-01T03:12:00.005Z"],
        ["2026-05-01 03:12:00,000", "2026-05-01 03:12:00,005"],
        ["01.05.2026 03:12:00,000", "01.05.2026 03:12:00,005"],
        ["01-05-2026 03:12:00.000", "01-05-2026 03:12:00.005"],
        ["01.05.26 03:12:00,000", "01.05.26 03:12:00,005"],
        ["03:12:00.000", "03:12:00.005"],
        ["03:12:00:000", "03:12:00:005"],
        ["03:12:00", "03:12:00.005"],
        ["01.05.2026 03:12:00", "01.05.2026 03:12:00.005"],
        ["5/1/2026 3:12:00 AM", "5/1/2026 3:12:00.005 AM"],
        ["0 days 00:00:00", "0 days 00:00:00.005000"],
        ["-1 days +23:59:59.998000", "0 days 00:00:00.003000"],
        ["1 day, 2:03:04", "1 day, 2:03:04.005000"],
        ["2026-05-01 03:12:00:000", "2026-05-01 03:12:00:005"],
        [1_777_605_120_000, 1_777_605_120_005],
        [1_777_605_120_000_000_000, 1_777_605_120_005_000_000],
        [0.0, 0.005],
        [1_777_605_120.000, 1_777_605_120.005],
    ],
    ids=[
        "ISO",
        "ISO with a blank",
        "German",
        "day first with dashes",
        "years of two digits",
        "time of day",
        "colon before ms",
        "time of day, whole seconds without decimals",
        "German, whole seconds without decimals",
        "AM and PM, whole seconds without decimals",
        "durations of pandas",
        "durations of pandas that begin before zero",
        "durations of Python",
        "ISO with a colon before ms",
        "Unix ms",
        "Unix ns",
        "seconds",
        "Unix s",
    ],
)
def test_times_in_any_notation_are_seconds(cells):
    read = _times(cells)
    np.testing.assert_allclose(read - read[0], [0.0, 0.005], atol=3e-7)  # a double has 2.4e-7 s of a Unix time


def test_a_time_zone_and_a_midnight_are_minded():
    summer = SourceTable("log.csv", pd.DataFrame({"t": ["2026-07-01T12:00:00"]}))

    times = read_times(summer, ("t",), TimeNotation(zone="Europe/Zurich"))

    assert times.ns[0] == pd.Timestamp("2026-07-01T10:00:00Z").value
    np.testing.assert_allclose(_times(["23:59:59.5", "00:00:00.5"]), [86399.5, 86400.5])


@pytest.mark.parametrize(
    ("cells", "start", "noted"),
    [
        (["05/04/2026 23:59:59.5", "05/05/2026 00:00:00.5"], "2026-05-04", False),
        (["04/05/2026 23:59:59.5", "05/05/2026 00:00:00.5"], "2026-05-04", False),
        (["31/05/2026 23:59:59.5", "01/06/2026 00:00:00.5"], "2026-05-31", False),
        (["05/31/2026 23:59:59", "06/01/2026 00:00:00"], "2026-05-31", False),
        (["05/04/2026 12:58:00", "05/04/2026 12:58:01"], "2026-04-05", True),
        (["05-04-2026 12:58:00", "05-04-2026 12:58:01"], "2026-04-05", True),
        (["05/05/2026 12:58:00", "05/05/2026 12:58:01"], "2026-05-05", False),
        (["01.05.26 12:58:00", "01.05.26 12:58:01"], "2026-05-01", True),
        (["26.04.30 23:59:59", "26.05.01 00:00:00"], "2026-04-30", False),
    ],
)
def test_dates_are_in_the_order_that_leaves_out_no_day_or_a_note_says_which(cells, start, noted):
    times = read_times(SourceTable("log.csv", pd.DataFrame({"t": cells})), ("t",), TimeNotation())

    assert str(times.ns[0].astype("datetime64[ns]"))[:10] == start
    assert times.ns[1] - times.ns[0] == 1_000_000_000
    assert len(times.notes) == noted
    assert all(f"is taken for {start}. Hint: if it is" in note for note in times.notes)


def test_a_format_that_is_stated_is_not_doubted():
    table = SourceTable("log.csv", pd.DataFrame({"t": ["05/04/2026 12:58:00", "05/04/2026 12:58:01"]}))
    noted = read_times(table, ("t",), TimeNotation()).notes[0]

    times = read_times(table, ("t",), TimeNotation(format=noted.split("'")[-2]))

    assert times.ns[0] == pd.Timestamp("2026-05-04T12:58:00Z").value
    assert not times.notes


@pytest.mark.parametrize(
    ("name", "count"),
    [
        ("FILETIME", 134_220_787_200_000_000 + 50_000 * np.arange(3)),
        ("Ticks", 639_132_019_200_000_000 + 50_000 * np.arange(3)),
        ("Ticks [s]", 639_132_019_200_000_000 + 50_000 * np.arange(3)),
        ("gps_time [s]", 1_461_640_338.0 + 0.005 * np.arange(3)),
        ("Time", 3_860_449_920.0 + 0.005 * np.arange(3)),
        ("MJD", 61_161.0 + 0.4 / 3.0 + 0.005 / 86_400.0 * np.arange(3)),
        ("datenum", 740_103.0 + 0.4 / 3.0 + 0.005 / 86_400.0 * np.arange(3)),
        ("JD", 2_461_161.5 + 0.4 / 3.0 + 0.005 / 86_400.0 * np.arange(3)),
        ("Time", ["01-May-2026 03:12:00.000", "01-May-2026 03:12:00.005", "01-May-2026 03:12:00.010"]),
        ("Time", ["2026:121:03:12:00.000", "2026:121:03:12:00.005", "2026:121:03:12:00.010"]),
    ],
)
def test_times_count_from_where_their_size_or_their_name_says(name, count):
    table = SourceTable("log.csv", pd.DataFrame({name: count}))
    unit = time_unit(table, (name,))

    times = read_times(table, (name,), TimeNotation(unit.get("time_unit"), tick_s=unit.get("tick_s")))

    since = (times.ns - pd.Timestamp("2026-05-01T03:12:00Z").value) / 1e9
    np.testing.assert_allclose(since, [0.0, 0.005, 0.010], atol=5e-5)


def test_a_unix_time_of_a_receiver_and_a_counter_of_whole_floats_are_what_they_were():
    unix = SourceTable("log.csv", pd.DataFrame({"gps_time": 1_777_605_120.0 + np.arange(3)}))

    assert time_unit(unix, ("gps_time",)) == {"time_unit": "s"}
    wrapped = (2.0**32 - 10_000.0 + 5_000.0 * np.arange(4)) % 2**32
    np.testing.assert_allclose(np.diff(_times(list(wrapped), unit="us")), 0.005)


@pytest.mark.parametrize(("scale", "unit"), [(1.0, "s"), (1e3, "ms"), (1e6, "us"), (1e9, "ns")])
def test_stamps_by_the_packet_are_of_the_unit_of_the_samples(scale, unit):
    row = np.arange(2000)
    stamps = (row // 10 + 1) * 0.05 + 3e-6 * (row % 10) + 5.0 * (row > 1500)  # a hole, too
    packets = SourceTable("log.csv", pd.DataFrame({"time": stamps * scale}))

    assert time_unit(packets, ("time",)) == {"time_unit": unit}


def test_gps_time_is_18_s_ahead_of_utc():
    gps = pd.Timestamp("2026-05-01T03:12:18Z") - pd.Timestamp("1980-01-06T00:00:00Z")
    table = SourceTable("log.csv", pd.DataFrame({"t": [gps.total_seconds()]}))

    times = read_times(table, ("t",), TimeNotation(unit="gps"))

    assert times.ns[0] == pd.Timestamp("2026-05-01T03:12:00Z").value


@pytest.mark.parametrize("cell", ["soon", "2026-13-01T00:00:00", "", None])
def test_a_cell_that_is_no_time_is_named_with_its_row(cell):
    with pytest.raises(BadInputError, match=r"log.csv: column 't', row 2"):
        _times(["2026-05-01T00:00:00", cell])


def test_the_row_to_blame_is_the_first_that_the_notation_of_the_others_does_not_read():
    with pytest.raises(BadInputError, match=r"row 3: '25.10.2026 soon' is no time"):
        _times(["25.10.2026 02:56:00.005", "25.10.2026 02:56:00.015", "25.10.2026 soon", "25.10.2026 02:56:00.035"])


@given(st.integers(8, 32), st.integers(1, 50), st.integers(0, 2**32))
@settings(max_examples=100, deadline=None)
def test_a_counter_that_starts_again_goes_on(bits, step, start):
    true = (start % 2**bits) + step * np.arange(3000, dtype=np.float64)

    read = unwrapped(true % 2**bits, 2.0**bits)

    if step < 2**bits:
        np.testing.assert_array_equal(read, true)


def test_the_end_of_a_counter_is_found_where_it_is_plain():
    true = np.arange(0.0, 200_000.0, 40.0)

    np.testing.assert_array_equal(unwrapped(true % 65536), true)
    falling = np.array([5.0, 4.0, 3.0])
    np.testing.assert_array_equal(unwrapped(falling), falling)


@pytest.mark.parametrize("turn", [360, 1250])
def test_a_counter_of_each_turn_goes_on(turn):
    speed = np.abs(np.sin(np.arange(20_000.0) / 3000.0)) * 9.0
    true = np.floor(np.cumsum(speed))

    np.testing.assert_allclose(np.diff(unwrapped(true % turn)), np.diff(true), atol=1.0)


def test_a_counter_that_is_set_to_zero_does_not_start_again():
    reset = np.concatenate([np.arange(0.0, 60_000.0, 7.0), np.arange(0.0, 30_000.0, 7.0)])

    np.testing.assert_array_equal(unwrapped(reset), reset)


@pytest.mark.parametrize("lowest", [0, -32768])
@pytest.mark.parametrize("start", [40, -40, 65_000])
def test_a_counter_that_runs_back_goes_on_at_both_ends_of_its_range(lowest, start):
    way = np.concatenate(
        [np.arange(0.0, 90_000.0, 20.0), np.arange(90_000.0, -100_000.0, -7.0), np.arange(-100_000.0, 0.0)]
    )
    true = start + way

    read = unwrapped((true - lowest) % 65536 + lowest)

    np.testing.assert_array_equal(np.diff(read), np.diff(true))


def test_a_counter_that_drops_out_or_turns_round_does_not_start_again():
    to_and_fro = 100.0 + 90.0 * np.sin(np.arange(500.0))  # as much in a row as half of what looks like its range
    dropped = np.concatenate([np.arange(30_000.0, 60_000.0, 20.0), [0.0], np.arange(60_000.0, 30_000.0, -20.0)])

    np.testing.assert_array_equal(unwrapped(to_and_fro), to_and_fro)
    np.testing.assert_array_equal(unwrapped(dropped), dropped)


@given(st.floats(50.0, 1000.0), st.sampled_from([0.001, 0.01]), st.integers(0, 10**6))
@settings(max_examples=60, deadline=None)
def test_stamps_that_repeat_are_spread_to_where_the_samples_were(rate_hz, quantum, seed):
    true = np.random.default_rng(seed).uniform(0.0, 1.0) + np.arange(5000) / rate_hz
    true[3000:] += 7.3  # a break

    read = spread_stamps(np.floor(true / quantum) * quantum)

    assert (np.diff(read) > 0).all()
    written = np.floor(true / quantum) * quantum
    if (np.diff(written) == 0).any():
        assert np.abs(read - true).max() <= 1.01 * quantum
        error = read - true
        assert np.std(error[100:2900]) < 0.1 * quantum + 1e-4


@pytest.mark.parametrize(("rate_hz", "quantum"), [(100.0, 1.0), (99.7, 1.0), (200.0, 1.0), (50.0, 0.1), (100.0, 60.0)])
def test_samples_of_a_clock_that_ticks_coarsely_are_regular_and_half_a_tick_early(rate_hz, quantum):
    true = 0.37 + np.arange(30_000) / rate_hz

    error = spread_stamps(np.floor(true / quantum) * quantum) - true

    assert np.ptp(error) < 0.5 / rate_hz
    assert abs(error.mean() + 0.5 * quantum) < 1.0 / rate_hz


def test_a_cell_that_is_no_place_is_named_with_its_row():
    table = SourceTable("posts.csv", pd.DataFrame({"km": ["12+345", "bridge"]}), first_row=3)

    with pytest.raises(BadInputError, match=r"posts.csv: column 'km', row 4: 'bridge' is no place"):
        read_stations(table, "km", "m")


@pytest.mark.parametrize(
    ("name", "kind", "axis"),
    [
        ("gyro_x", "gyro", "x"),
        ("GyrX", "gyro", "x"),
        ("wz", "gyro", "z"),
        ("AngularVelocity_Y", "gyro", "y"),
        ("Drehrate z", "gyro", "z"),
        ("acc.x", "accel", "x"),
        ("BeschlY", "accel", "y"),
        ("fz_mps2", "accel", "z"),
        ("Linear Acceleration x", "free_accel", "x"),
        ("userAccelerationY", "free_accel", "y"),
        ("ACC_Z", "accel", "z"),
        ("Gyro X", "gyro", "x"),
        ("GX", "gyro", "x"),
        ("Gy", "gyro", "y"),
        ("AZ", "accel", "z"),
        ("YawRate", "gyro", "z"),
        ("Nickrate", "gyro", "y"),
        ("AccLateral", "accel", "y"),
        ("Längsbeschleunigung", "accel", "x"),
        ("Roll", None, "x"),
        ("vertical accuracy", "sd_vertical", None),
        ("hdop", None, None),  # no metres
        ("Geschwindigkeit", "speed", None),
        ("Impulse", "count", None),
        ("wheel counts", "count", None),
        ("num_satellites_count", None, None),
        ("Frame_Counter", None, None),
        ("Station [m]", "station", None),
        ("ref_station_id", None, None),  # of a receiver's base
        ("stationary", None, None),
        ("latitude", "latitude", None),
        ("Zeit", "time", None),
        ("comment", None, None),
    ],
)
def test_names_show_what_columns_mean(name, kind, axis):
    assert meaning(name) == kind
    assert axis is None or parts_of(name).axis == axis


def test_a_cell_without_end_and_bytes_within_a_cell_are_one_line(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    rows = b"t,a\n" + b"1,x\n" * 500_000 + b"1,x\xff\n"
    for content, message in ((b"x" * 200_000, "larger than field limit"), (rows, r"byte \d+ is not utf-8")):
        path.write_bytes(content)
        with pytest.raises(BadInputError, match=message):
            read_text(path)


def test_a_unit_says_what_names_leave_open() -> None:
    names = (
        [f"Kanal {axis.upper()}" for axis in "xyz"] + [f"Sensor2 {axis}" for axis in "xyz"] + ["Roll", "Nick", "Gier"]
    )
    units = dict(zip(names, ["g"] * 3 + ["°/s"] * 3 + ["deg"] * 3, strict=True))
    table = SourceTable("log.csv", pd.DataFrame({name: [0.1, 1.0] for name in names}), units=units)
    (gyro,), (accel,) = triples(table, "gyro"), triples(table, "accel")
    assert (gyro.columns, gyro.unit) == (("Sensor2 x", "Sensor2 y", "Sensor2 z"), "deg/s")
    assert (accel.columns, accel.unit) == (("Kanal X", "Kanal Y", "Kanal Z"), "g")


def test_gravity_distinguishes_a_specific_force_from_an_acceleration_without_it() -> None:
    names = [f"field.linear_acceleration.{axis}" for axis in "xyz"]
    for up, expected in ((9.7, True), (0.1, False)):
        values = np.stack([np.full(50, 0.2), np.full(50, -0.1), np.full(50, up)], axis=1)
        (found,) = triples(SourceTable("imu.csv", pd.DataFrame(values, columns=names)), "free_accel")
        assert has_gravity(found) == expected


@pytest.mark.parametrize(
    ("names", "unit"), [("w{}_radps", "rad/s"), ("gyro_{}_dps", "deg/s"), ("gyro_{}_deg/s", "deg/s")]
)
def test_a_gyros_unit_is_that_of_its_columns_names(names: str, unit: str) -> None:
    columns = pd.DataFrame({names.format(axis): [0.01, 0.02] for axis in "xyz"})
    (triple,) = triples(SourceTable("log.csv", columns), "gyro")
    assert (triple.unit, triple.known) == (unit, True)


@pytest.mark.parametrize(
    ("written", "quantity", "factor"),
    [
        ("SpeedKnots", "speed", 1852.0 / 3600.0),
        ("SpeedKts", "speed", 1852.0 / 3600.0),
        ("rev/s", "angular rate", 2.0 * np.pi),
        ("{deg/s}", "angular rate", np.pi / 180.0),
        ("<º/s>", "angular rate", np.pi / 180.0),
    ],
)
def test_a_unit_is_known_at_the_end_of_a_name_and_in_other_brackets(
    written: str, quantity: Quantity, factor: float
) -> None:
    unit = unit_in(written, quantity)

    assert unit is not None
    assert factor_of(unit, quantity) == pytest.approx(factor)


@pytest.mark.parametrize(
    ("speed", "is_wheels"), [("Speed", False), ("Radgeschwindigkeit", True), ("wheel speed", True)]
)
def test_a_speed_beside_positions_is_the_receivers_unless_its_name_says_a_wheel(
    speed: str, is_wheels: bool, drive: Drive, imported: Callable[..., Imported], tmp_path: Path
) -> None:
    columns = {"Time [s]": drive.t}
    columns |= {f"{kind}{axis} [{unit}]": values[:, i] for kind, unit, values in (
        ("G", "rad/s", drive.gyro), ("A", "m/s^2", drive.accel)) for i, axis in enumerate("XYZ")}  # fmt: skip
    columns |= {"Lat": np.interp(drive.t, drive.gnss_t, drive.latitude), "Lon": 7.4 + 0 * drive.t, speed: drive.speed}
    pd.DataFrame(columns).to_csv(tmp_path / "log.csv", index=False)
    recording = imported(tmp_path / "log.csv").loaded.recording
    assert recording is not None
    assert (recording.tach is not None) == is_wheels
    assert recording.gnss is not None
    assert recording.description.imu.axes == "FLU"
