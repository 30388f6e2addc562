"""Text in whose lines each value stands after its name: ``t=0.005 gx=0.1``, ``gx:0.1,gy:0.2``, ``{TimeUS : 5, ...}``.

So write programs that log for people, serial monitors of microcontrollers, and databases of time series. A date, a time
of day or a number may stand before the first pair or after the last one, and a word before it: the kind of the line.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

from trackfg.interchange.importing.columns.written_units import number_and_unit
from trackfg.interchange.importing.shapes.record_table import table_of_records
from trackfg.interchange.importing.source_table import SourceTable

_CLOCK = r"\d{1,2}(?::\d{1,2}){1,2}(?:[.,]\d+)?(?:Z|[+-]\d\d:?\d\d)?"
_DATE = r"\d{1,4}[-./]\d{1,2}[-./]\d{1,4}"
_UNIT = r"(?:\s(?:[°%]|[^\W\d_])[^\s,;|{}()=:]*(?=\s*(?:[,;|})]|$)))?"
_PAIR = re.compile(
    r"(?<![\w.])[\"']?(?P<name>[^\W\d][\w.\[\]/]*(?: [XYZxyz])?)[\"']?\s*[=:](?![=:])\s*"
    rf"(?P<value>\"[^\"]*\"|'[^']*'|{_DATE}[ T]{_CLOCK}|[^\s,;|{{}}()=]++(?!=){_UNIT})"
)
"""A name, which may have its axis apart, and a value, behind which a unit may stand where a delimiter ends it."""
_STAMP = re.compile(rf"[\[({{\s]*(?:\d\d[-./]\d\d )?({_DATE}[ T]{_CLOCK}|{_CLOCK}|{_DATE}|\d+(?:\.\d+)?)\b")
"""What begins a line with the time at which it was written, perhaps behind a day without a year."""
_WORD = re.compile(r"[^\W\d]\w*")
_LAST = re.compile(r"\s(\d+(?:\.\d+)?)\s*$")
_TIME, _KIND = "time", "kind"
"""Names of columns for what stands outside of pairs."""
_HEAD_BYTES = 200_000
_SHARE = 0.8
"""Share of the lines that have pairs."""
_AXES, _SHARE_OF_AXES = 3, 0.25
"""Pairs of a line of gyro or accelerometer, and the share of such lines: those of other sensors may have fewer."""
_NEW_NAMES = 0.1
"""Share of the pairs whose names come for the first time: names come again in each line, unlike words of a prose."""
_MARKS = "%#/!"


def has_pairs(path: Path) -> bool:
    """Return whether most lines of a text hold pairs of names and values, many of them three or more."""
    with path.open("rb") as stream:
        head = stream.read(_HEAD_BYTES)
    lines = [] if b"\0" in head else head.decode("utf-8", "replace").splitlines()
    lines = lines[:-1] if len(head) == _HEAD_BYTES else lines  # the last one may be cut off
    lines = [line for line in lines if _says_something(line)]
    names = [_record(line).keys() for line in lines]
    with_pairs, with_axes = (sum(len(of_line) >= fewest for of_line in names) for fewest in (1, _AXES))
    repeated = len(set[str]().union(*names)) <= _NEW_NAMES * sum(map(len, names))
    return bool(names) and with_pairs >= _SHARE * len(names) and with_axes >= _SHARE_OF_AXES * len(names) and repeated


def read_pairs(path: Path) -> SourceTable:
    """Return the table of a text of pairs, with a column for each name; on lines that are left out is a note."""
    records, first_row, left_out = list[dict[str, str]](), 0, 0
    with path.open(encoding="utf-8-sig", errors="replace") as stream:
        for number, line in enumerate(stream, start=1):
            if record := _record(line):
                records.append(record)
                first_row = first_row or number
            elif _says_something(line):
                left_out += 1
    table = table_of_records(records, path.name)
    notes = (f"{path.name}: lines without names and values are left out: {left_out}",) if left_out else ()
    return replace(table, first_row=first_row, notes=notes)


def _says_something(line: str) -> bool:
    """Return whether a line is no remark and has more than the time at which it was written."""
    return bool(line.strip()) and line[0] not in _MARKS and _WORD.search(_STAMP.sub("", line, count=1)) is not None


def _with_whole_names(pairs: dict[str, str]) -> dict[str, str]:
    """Return pairs of which bare axes have the name before that of the first one, and the unit behind the last one, as
    ``Acceleration X: 0.1, Y: 0.2, Z: 9.8 m/s^2`` means them.
    """
    names = list(pairs)
    stem, _, axis = names[0].rpartition(" ")
    if not stem or "".join([axis, *names[1:]]).casefold() != "xyz":
        return pairs
    last = number_and_unit(pairs[names[-1]])
    alone = last is not None and all(number_and_unit(pairs[name]) is None for name in names[:-1])
    unit = f" {last[1]}" if last is not None and alone else ""
    whole = {f"{stem} {name[-1:]}": f"{pairs[name]}{unit}" for name in names[:-1]}
    return whole | {f"{stem} {names[-1]}": pairs[names[-1]]}


def _record(line: str) -> dict[str, str]:
    """Return the values of a line by their names; nothing where it has none, or a name twice."""
    matches = list(_PAIR.finditer(line))
    pairs = {match["name"]: match["value"].strip("\"'") for match in matches}
    if not pairs or len(pairs) < len(matches):
        return {}
    beginning, end = line[: matches[0].start()], line[matches[-1].end() :]
    stamp = _STAMP.match(beginning)
    words = _WORD.findall(beginning[stamp.end() :] if stamp else beginning)
    alone = {_KIND: words[0]} if len(words) == 1 else {}
    if (last := _LAST.search(end)) is not None:
        alone[_TIME] = last[1]
    elif stamp is not None:
        alone[_TIME] = stamp[1]
    return alone | _with_whole_names(pairs)
