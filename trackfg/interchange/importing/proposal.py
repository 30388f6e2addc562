"""A mapping is proposed from the data, with a question for each thing that they cannot say.

Names and units show what the columns are (:mod:`trackfg.interchange.importing.columns.column_meaning`); then the
recording that the proposal makes is examined as ``trackfg check`` does, which finds axes and units.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import tomli_w

from trackfg.checks.sizes import GAUGE_M
from trackfg.errors import BadInputError
from trackfg.interchange.importing.columns.calendar_columns import COMPOSED, parts_of_dates
from trackfg.interchange.importing.columns.column_meaning import first_of, kind_in
from trackfg.interchange.importing.columns.plan_columns import (
    are_projected,
    plan_columns,
    sigma_columns,
    stated_system,
    system_of,
)
from trackfg.interchange.importing.columns.receiver_state import (
    RANGE_SD_M,
    UNKNOWN_HEIGHT_SD_M,
    dilution_column,
    quality_column,
    state_column,
    without_position,
)
from trackfg.interchange.importing.columns.time_columns import states_no_zone, time_columns, times_in
from trackfg.interchange.importing.columns.written_units import factor_of, unit_in
from trackfg.interchange.importing.mapping import FORMAT
from trackfg.interchange.importing.proposals.clock_start import clocks_of, propose_start
from trackfg.interchange.importing.proposals.evident_by_force import settle_by_force
from trackfg.interchange.importing.proposals.inertial_proposal import propose_imu
from trackfg.interchange.importing.proposals.position_unit import RAW_DEGREES, unit_of_position
from trackfg.interchange.importing.proposals.questions import (
    Ask,
    Proposal,
    Question,
    asked,
    asked_number,
    sensors_in,
)
from trackfg.interchange.importing.proposals.receiver_speed_proposal import propose_receiver_speed
from trackfg.interchange.importing.proposals.tach_proposal import propose_speeds_over_ground, propose_tach
from trackfg.interchange.importing.sensors.balise_places import COLUMNS
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.interchange.importing.stations import bare_unit, place_columns
from trackfg.interchange.importing.times.zones import is_zone
from trackfg.io.features import LOCAL
from trackfg.numerics.chainage.km_notation import metres_of

FIX_SD_M = 1.0
"""Proposed for balises and posts without a sigma: a post is read off to about a metre."""

GNSS_SD_M = (RANGE_SD_M, RANGE_SD_M, 2.0 * RANGE_SD_M)
"""Proposed for positions without a sigma, east, north and up: that of a range horizontally, twice as much in height."""

_COMPUTED_S, _COMPUTED_ROWS = 1.0, 100
"""Steady intervals of places up to this, s, and rows that show it, are of a computed place."""
_LOCAL_M = 20_000.0
"""Easting and northing below this are of a frame of one's own: no grid has a railway so near to its origin."""
_NUMBERS = ("gyro", "accel", "free_accel", "count", "distance", "speed", "latitude", "longitude", "easting", "northing")
"""Kinds of columns that are lost where a cell is text."""


def propose(tables: Sequence[SourceTable], ask: Ask, given: dict[str, Any] | None = None) -> Proposal:
    """Propose a mapping of ``tables``; ``given`` are the sections of a format that says itself what its columns are.

    Raises :class:`BadInputError` where gyro or accelerometer are not found, where gravity was removed, or where the
    recording would not be usable.
    """
    proposal = propose_columns(tables, ask, given)
    settle_by_force(proposal, tables, ask)
    return proposal


def propose_columns(tables: Sequence[SourceTable], ask: Ask, given: dict[str, Any] | None = None) -> Proposal:
    """Propose what the columns are, as :func:`propose` does, before anything is read from their values."""
    proposal = Proposal({"format": FORMAT, **(given or {})})
    for table in tables if given is None else ():
        for name in table.columns:
            if kind_in(table, name) in _NUMBERS:
                table.refuse_stray_text(name)
    if "imu" not in proposal.sections:
        propose_imu(proposal, tables, ask)
    if "tach" not in proposal.sections:
        propose_tach(proposal, tables, ask)
        propose_speeds_over_ground(proposal, tables)
    if "gnss" not in proposal.sections:
        _gnss(proposal, tables, ask)
    if "gnss_speed" not in proposal.sections:
        propose_receiver_speed(proposal, tables)
    if "balises" not in proposal.sections:
        _balises(proposal, tables)
    if "fixes" not in proposal.sections:
        _fixes(proposal, tables)
    _time_zone(proposal, tables, ask)
    propose_start(proposal, tables, ask)
    _vehicle(proposal, ask)
    _start(proposal, ask)
    return proposal


def _gnss(proposal: Proposal, tables: Sequence[SourceTable], ask: Ask) -> None:
    for table in tables:
        if (plan := plan_columns(table)) is None:
            continue
        height = first_of(table, "height")
        across, up = first_of(table, "sd_horizontal"), first_of(table, "sd_vertical")
        by_axis = zip(sigma_columns(table), (across, across, up), GNSS_SD_M, strict=True)
        sd: list[Any] = [name or shared or assumed for name, shared, assumed in by_axis]
        if isinstance(sd[0], float) or isinstance(sd[1], float):
            proposal.reasons["gnss.sd"] = "m, east, north, up: assumed, since the source has none"
        if height is None and (down := first_of(table, "down")) is not None:
            height = down
        if height is None:
            proposal.reasons["gnss.position"] = "the source has no heights: 0, with a sigma of 1 km"
            sd[2] = UNKNOWN_HEIGHT_SD_M
        position = [*plan, height or 0.0]
        section = {"file": table.name, **proposal.times_of(table), "position": position, "sd": sd}
        unit = _system if are_projected(table, plan) else unit_of_position
        section |= unit(proposal, table, plan, ask)
        if (
            section.get("position_unit") == RAW_DEGREES
            and height is not None
            and unit_in(table.units.get(height) or height, "length") is None
        ):
            section["height_unit"] = "mm"  # as in messages of u-blox, whose sigmas are in mm, too
            section["sd"] = list(GNSS_SD_M)
            proposal.reasons["gnss.sd"] = "m, east, north, up: assumed, since the source states no unit of its own"
        stated_height = unit_in(table.units.get(height) or height, "length") if height is not None else None
        if stated_height is not None and factor_of(stated_height, "length") != 1.0:
            section["height_unit"] = stated_height
        if height is not None and kind_in(table, height) == "down":
            section["height_unit"] = f"-1 {stated_height or 'm'}"
        section |= _validity(proposal, table, plan[0])
        if "gnss.sd" in proposal.reasons:
            section |= _precision(proposal, table)
        proposal.sections["gnss"] = section
        return


def _precision(proposal: Proposal, table: SourceTable) -> dict[str, str]:
    """Return the keys of the columns that say how good the positions are, whose sigmas are assumed."""
    columns = {"dop": dilution_column(table), "quality": quality_column(table)}
    keys = {key: name for key, name in columns.items() if name is not None}
    by = {"dop": "times {}", "quality": "by {}"}
    assumed = ", ".join(by[key].format(name) for key, name in keys.items())
    proposal.reasons["gnss.sd"] += f", {assumed}" if assumed else ""
    return keys


def _validity(proposal: Proposal, table: SourceTable, latitude: str) -> dict[str, Any]:
    """Return the key of the column that says where the receiver has no position, if it says so of some rows."""
    name = state_column(table)
    if name is None:
        return {}
    lost = without_position(table.column(name)[table.column(latitude).notna()])
    if not 0 < np.count_nonzero(lost) < len(lost):
        return {}
    proposal.reasons["gnss.valid"] = f"{np.count_nonzero(lost)} rows without a position are left out"
    return {"valid": name}


def _system(proposal: Proposal, table: SourceTable, plan: tuple[str, str], ask: Ask) -> dict[str, str]:
    """Return the key of the reference system of easting and northing, which is asked where the table states none."""
    if (system := stated_system(table, plan)) is not None:
        proposal.reasons["gnss.crs"] = "the table states it"
        return {"crs": system}
    text = f"Reference system of {' and '.join(plan)}, such as EPSG:25832 or UTM 32N; local: east and north in metres"
    expected = "an EPSG code such as EPSG:25832, a zone such as UTM 32N, or local"
    near = max(np.nanmax(np.abs(table.numbers(name)), initial=0.0) for name in plan) < _LOCAL_M
    default = LOCAL if near else ""
    question = Question("gnss.crs", text, default, accepts=lambda name: bool(_system_named(name)), expected=expected)
    system = _system_named(asked(ask, question))
    return {"frame": LOCAL} if system is None or system == LOCAL else {"crs": system}


def _system_named(answer: str) -> str | None:
    """Return the reference system of an answer, also of the number of an EPSG code; None where it is none."""
    answer = answer.strip()
    return LOCAL if answer.casefold() == LOCAL else system_of(f"EPSG:{answer}" if answer.isdecimal() else answer)


def _balises(proposal: Proposal, tables: Sequence[SourceTable]) -> None:
    """Propose the table of ids with times, and where it has no places a table of places with the same ids."""
    named = _with_ids(proposal, tables)
    passages = next(((table, name) for table, name in named if first_of(table, "time") is not None), None)
    if passages is None:
        return
    table, name = passages
    section = {"file": table.name, **proposal.times_of(table, beside=proposal.clock_of_imu(tables)), "id": name}
    for places in (table, *(other for other, same in named if other is not table and same == name)):
        if first_of(places, "station") is not None:
            section |= {} if places is table else {"places": places.name}
            section |= _places(proposal, places, "balises")
            break
    proposal.sections["balises"] = section


def _with_ids(proposal: Proposal, tables: Sequence[SourceTable]) -> list[tuple[SourceTable, str]]:
    """Return the tables with ids of balises, and the columns of these.

    A column ``id``, as a recording calls it, is one beside places, and in tables of passages of these places.
    """
    named = [(table, name) for table in tables if (name := first_of(table, "balise")) is not None]
    if named:
        return named
    taken = _files_of(proposal, "imu") | _files_of(proposal, "tach") | _files_of(proposal, "gnss")
    plain = [table for table in tables if COLUMNS.id in table.columns and table.name not in taken]
    return [(table, COLUMNS.id) for table in plain] if any(first_of(table, "station") for table in plain) else []


def _files_of(proposal: Proposal, section: str) -> set[str]:
    """Return the names of the tables of a section; none where there is no such section."""
    file = proposal.sections.get(section, {}).get("file", [])
    return {file} if isinstance(file, str) else set(file)


def _fixes(proposal: Proposal, tables: Sequence[SourceTable]) -> None:
    taken = _files_of(proposal, "imu") | _files_of(proposal, "balises")
    taken.add(proposal.sections.get("balises", {}).get("places"))
    for table in tables:
        if table.name in taken or first_of(table, "station") is None:
            continue
        if _are_computed(table):
            proposal.reasons["fixes"] = f"the places of {table.name}, at a steady rate, are computed: no fixes"
            continue
        time = proposal.times_of(table, beside=proposal.clock_of_imu(tables))
        proposal.sections["fixes"] = {"file": table.name, **time, **_places(proposal, table, "fixes")}
        return


def _are_computed(table: SourceTable) -> bool:
    """Return whether places come at a steady rate of one a second or more: another system has computed them.

    Balises and posts are passed at irregular times, and more seldom.
    """
    columns = time_columns(table)
    if columns is None or len(columns) != 1 or len(table.frame) < _COMPUTED_ROWS:
        return False
    try:
        t = times_in(table, columns)
    except BadInputError:
        return False
    steps = np.diff(t.since(t.first_ns))
    usual = float(np.median(steps))
    return 0.0 < usual <= _COMPUTED_S and bool(np.mean(np.abs(steps - usual) < 0.2 * usual) > 0.9)


def _places(proposal: Proposal, table: SourceTable, section: str) -> dict[str, Any]:
    """Return the columns of places along the line and of their sigma, which is assumed where the table has none."""
    name = first_of(table, "station")
    assert name is not None
    sd = next((column for column in table.columns if column.casefold().startswith("sd")), FIX_SD_M)
    if sd is FIX_SD_M:
        proposal.reasons[f"{section}.sd"] = "m, assumed, since the source has none"
    if (pair := place_columns(table)) is not None and name in pair[0]:
        return {"chainage": list(pair[0]), "sd": sd, "chainage_unit": pair[1]}
    unit = "m" if _written_places(table, name) else bare_unit(table, name)
    return {"chainage": name, "sd": sd, "chainage_unit": unit}


def _written_places(table: SourceTable, name: str) -> bool:
    try:
        table.numbers(name)
    except BadInputError:
        return True
    return False


def _time_zone(proposal: Proposal, tables: Sequence[SourceTable], ask: Ask) -> None:
    """Ask for the zone of dates that state none, and of times of day beside dates."""
    named = {table.name: table for table in tables}
    sections = [part for part in proposal.sensors if "time" in part]
    without = []
    for part in sections:
        file = part["file"] if isinstance(part["file"], str) else part["file"][0]
        if file in named and states_no_zone(named[file], part["time"], part.get("time_unit")):
            without.append(part)
    if any("time_zone" in part for part in without):
        return
    dated, of_day = clocks_of(proposal, tables)
    without += [part for part in of_day if part not in without] if dated else []
    if not without:
        return
    text = "Time zone of dates and times of day that state none (UTC, Europe/Zurich, ...; GPS: 18 s ahead of UTC)"
    expected = "a zone such as Europe/Zurich, or GPS"
    zone = asked(ask, Question("time_zone", text, "UTC", accepts=is_zone, expected=expected))
    for part in without:
        part["time_zone"] = zone
    key = f"{next((name for name, part in proposal.sections.items() if part is without[0]), 'imu')}.time_zone"
    of_gps = next((name for part in without for name in np.atleast_1d(part["time"]) if "gps" in name.casefold()), None)
    if of_gps is not None and zone == "UTC":
        hint = f'{of_gps} may be that of GPS, 18 s ahead of UTC: state time_zone = "GPS" then'
        proposal.reasons[key] = f"the dates state none. Hint: {hint}"
    else:
        proposal.reasons[key] = "the dates state none" if without[0] in dated else "the times of day state none"


def _vehicle(proposal: Proposal, ask: Ask) -> None:
    imu = proposal.sections["imu"]
    if "rigid" not in imu:
        text = (
            "Does the sensor follow the track, as on an axle box, a wheelset or a trolley? If it is on springs (bogie, "
            "body), only displacement sensors give the track geometry"
        )
        imu["rigid"] = ask(Question("imu.rigid", text, "no", ("yes", "no"))) == "yes"
    if "track" not in proposal.sections:
        gauge = asked_number(ask, "track.gauge_m", "Track gauge, m", "1.435", GAUGE_M)
        proposal.sections["track"] = {"gauge_m": gauge, "cross_level_base_m": 1.5 if gauge >= 1.435 else gauge}


def _start(proposal: Proposal, ask: Ask) -> None:
    """Ask for the official place at which a run begins whose chainages no fix and no balise gives."""
    if {"fixes", "balises", "kilometrage"} & proposal.sections.keys():
        return
    text = "Official place where the run begins, as 12+345 (empty: not known)"
    km = ask(
        Question(
            "kilometrage.equation",
            text,
            "",
            accepts=lambda place: metres_of(place, "km") is not None,
            optional=True,
            expected="a place such as 12+345",
        )
    )
    if not km.strip():
        return
    section: dict[str, Any] = {"equation": [{"chainage_m": 0.0, "km": km.strip()}]}
    if ask(Question("kilometrage.direction", "Do the kilometres rise along the run?", "yes", ("yes", "no"))) == "no":
        section["direction"] = "descending"
    proposal.sections["kilometrage"] = section


def unused_columns(sections: dict[str, Any], tables: Sequence[SourceTable]) -> dict[str, list[str]]:
    """Return the columns with values that no section of a mapping uses, by the name of their table."""
    used: dict[str, set[str]] = {}
    for section in sensors_in(sections):
        values = [part for value in section.values() for part in (value if isinstance(value, list) else [value])]
        files = section["file"] if isinstance(section["file"], list) else [section["file"]]
        for file in (*files, *([section["places"]] if "places" in section else [])):
            used.setdefault(file, set()).update(str(value) for value in values)
    for table in tables:
        if COMPOSED in used.get(table.name, ()):
            used[table.name] |= parts_of_dates(table)
    unused = {
        table.name: [
            name
            for name in table.columns
            if name not in {COMPOSED, *used.get(table.name, ())} and table.frame[name].notna().any()
        ]
        for table in tables
    }
    return {name: columns for name, columns in unused.items() if columns}


def mapping_text(proposal: Proposal) -> str:
    """Return the proposal as the text of a mapping, with its reasons as comments."""
    lines, section = [], ""
    for line in tomli_w.dumps(proposal.sections).splitlines():
        if line.startswith("["):
            section = line.strip("[]") + "."
        reason = proposal.reasons.get(section + line.partition(" = ")[0])
        lines += [line] if reason is None else [f"# {reason}", line]
    return "\n".join(lines) + "\n"
