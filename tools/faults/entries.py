"""The entries: every kind of input that trackfg reads, and the commands that read it."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass

from faults import server

DATABASE = "DATABASE"
"""Stands in a command for the URL of the map in the case's own database."""
_RESULT = ("result",)
_RECORDING = ("rec",)
_MAP = ("line.gpkg",)


@dataclass(frozen=True)
class Entry:
    """What is read: ``inputs`` are damaged, ``others`` are there too; both are paths below the case's folder.

    ``commands`` read them, each with all inputs. ``stdin`` is a file that a command reads as its standard input.
    ``needs`` is a library that the entry cannot be without, and ``database`` whether it is a map in PostgreSQL.
    ``requests`` are asked of the pages that its commands serve, which are then interrupted.
    """

    name: str
    inputs: tuple[str, ...]
    commands: tuple[str, ...]
    others: tuple[str, ...] = ()
    stdin: str | None = None
    needs: str | None = None
    database: bool = False
    requests: tuple[str, ...] = ()


def _imported(name: str, source: str, needs: str | None = None) -> Entry:
    commands = (f"import {source} -o out", f"init {source} -o out --yes")
    return Entry(f"import {name}", (source,), commands, needs=needs)


_ENTRIES = (
    Entry(
        "recording",
        _RECORDING,
        ("check rec", "smooth rec -o out", "baseline complementary rec -o out", "compare rec -o out"),
    ),
    Entry("recording as csv", ("csv",), ("smooth csv -o out", "check csv")),
    Entry("recording with all sensors", ("car",), ("smooth car -o out", "check car", "stream car -o out")),
    Entry(
        "balises",
        ("passed/balises.csv", "passed/places.csv", "passed/recording.toml"),
        ("smooth passed -o out", "check passed"),
        others=("passed",),
    ),
    Entry(
        "planned balises",
        ("planned.csv",),
        ("balises result other --planned planned.csv -o survey.csv", "balises result --planned planned.csv --json"),
        others=("result", "other"),
    ),
    Entry("stream", _RECORDING, ("stream rec -o out", "stream rec -o out --view --port 0")),
    Entry("json lines", ("rows.jsonl",), ("stream - -o out", "stream - -o -"), stdin="rows.jsonl"),
    Entry("mcap", ("rows.mcap",), ("stream rows.mcap -o out",), needs="mcap"),
    Entry("checkpoint", ("begun",), ("stream rec -o begun --resume",), others=_RECORDING),
    Entry(
        "result",
        _RESULT,
        (
            "report result -o page.html",
            "plot result -o chart.png",
            "limits result --limits cfr-213-class-4",
            "map build result -o new.gpkg",
            "map changes result line.gpkg",
            "statistics result --json",
            "overlay other result -o laid",
            "balises result other",
            "export result --to csv -o table.csv",
            "export result --to geojson -o shape.geojson",
            "export result --to landxml -o plan.xml",
        ),
        others=("other", "line.gpkg"),
    ),
    Entry("comparison", ("compared",), ("report compared -o page.html",)),
    Entry("trends", ("grown",), ("report grown -o page.html",)),
    Entry(
        "map",
        _MAP,
        (
            "map show line.gpkg",
            "map build other -o line.gpkg",
            "map diff line.gpkg line.gpkg",
            "map changes other line.gpkg",
            "map trends line.gpkg result other third",
        ),
        others=("result", "other", "third"),
    ),
    Entry(
        "map in a database",
        (),
        (
            "map show DATABASE",
            "map build other -o DATABASE",
            "map diff DATABASE",
            "map trends DATABASE result other third",
        ),
        others=("result", "other", "third"),
        needs="psycopg",
        database=True,
    ),
    Entry(
        "map for a run",
        _MAP,
        (
            "smooth rec -o out --map line.gpkg --config coarse.toml",
            "stream rec -o out --map line.gpkg --config coarse.toml",
        ),
        others=(*_RECORDING, "coarse.toml"),
    ),
    Entry(
        "landxml",
        ("line.xml",),
        (
            "simulate trolley --duration 20 --line line.xml -o out",
            "smooth gnss -o out --line line.xml --line-crs local",
        ),
        others=("gnss",),
    ),
    Entry("line", ("line.toml",), ("simulate trolley --duration 20 --line line.toml -o out",)),
    Entry("tracks as geojson", ("known.geojson",), ("smooth gnss -o out --line known.geojson",), others=("gnss",)),
    Entry(
        "tracks as gpkg",
        ("known.gpkg",),
        ("smooth gnss -o out --line known.gpkg", "report result -o page.html --background known.gpkg"),
        others=("gnss", "result"),
        needs="pyogrio",
    ),
    Entry("background", ("known.geojson",), ("report result -o page.html --background known.geojson",), others=_RESULT),
    Entry(
        "settings",
        ("settings.toml",),
        ("smooth rec -o out --config settings.toml", "stream rec -o out --config settings.toml"),
        others=_RECORDING,
    ),
    Entry(
        "limits",
        ("limits.toml",),
        (
            "limits result --limits limits.toml",
            "statistics result --limits limits.toml",
            "plot result -o chart.svg --limits limits.toml",
            "map trends line.gpkg result other third --limits limits.toml",
        ),
        others=("result", "other", "third", "line.gpkg"),
    ),
    Entry("template", ("channels.toml",), ("export result --to channels --template channels.toml -o c.csv",), _RESULT),
    Entry(
        "catalogue of runs",
        ("runs.csv",),
        ("batch runs.csv -o store --dry-run", "batch runs.csv -o half --jobs 1"),
        others=("half", "rec", "gnss", "settings.toml"),
    ),
    Entry(
        "store",
        ("store",),
        (
            "map build store -o new.gpkg",
            "batch runs.csv -o store --dry-run",
            "batch runs.csv -o store --jobs 1",
        ),
        others=("runs.csv", "line.gpkg", "rec", "gnss", "settings.toml"),
    ),
    Entry(
        "store in a browser",
        ("store",),
        ("browse store --port 0",),
        requests=(
            "/",
            "/?state=failed&page=9&since=2026-13&text=%1b[31m",
            "/line?line=7",
            "/section?line=7&from=0",
            "/section?line=7&from=nan&runs=all",
            "/section?line=7&from=1e308",
            "/run?run=a",
            "/run?run=..%2f..%2frec",
            "/progress?seen=%00",
            "/store/../../etc/passwd",
            "//[",
        ),
    ),
    Entry("noise log", ("rest.csv",), ("noise rest.csv -o allan.csv", "noise rest.csv --json")),
    Entry("import", ("log.csv",), ("import log.csv -o out", "init log.csv -o out --yes")),
    Entry("mapping", ("log.mapping.toml",), ("import log.csv -o out --mapping log.mapping.toml",), others=("log.csv",)),
    Entry(
        "import channels",
        ("channels.csv",),
        ("import channels.csv -o out", "overlay channels.csv result -o laid"),
        _RESULT,
    ),
    _imported("sensor-logger", "walk.zip"),
    _imported("phyphox", "phyphox.zip"),
    _imported("ros", "bag", "rosbags"),
    _imported("rcm-dx", "run.rcmdx", "h5py"),
    _imported("hdf5", "journeys.h5", "h5py"),
    _imported("mdf", "run.mf4", "asammdf"),
    _imported("tdms", "run.tdms", "nptdms"),
    _imported("gnss", "receiver"),
)


def _is_possible(entry: Entry) -> bool:
    if entry.needs is not None and importlib.util.find_spec(entry.needs) is None:
        return False
    return not entry.database or server.programs() is not None


ENTRIES = tuple(entry for entry in _ENTRIES if _is_possible(entry))
"""Those whose libraries and servers are installed."""
