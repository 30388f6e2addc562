"""A plan says of each run whether its result is fresh, or why it is to be computed."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from trackfg.config import SmoothConfig
from trackfg.files.small_file import json_of
from trackfg.fleet.catalogue import UNKNOWN_LINE, Run
from trackfg.fleet.freshness import (
    Inputs,
    algorithm,
    changed_settings,
    changes,
    newest_map,
    settings_sha256,
)
from trackfg.fleet.known_content import KnownContent, Sight, sight
from trackfg.fleet.places import PlaceError, content_of, is_file, joined, local_recording, read
from trackfg.fleet.store import Store
from trackfg.io.content import content_files, files_sha256, line_sha256
from trackfg.results.result import RESULT_FOLDER

_COLUMNS = ("run", "status", "reason", "recording", "tags", *Inputs._fields)
"""Columns of the store's catalogue that a plan looks at."""


@dataclass(frozen=True)
class PlannedRun:
    """A run and why it is to be computed; ``why`` is empty where its result is fresh.

    ``listed``: the store's catalogue has the row of that result as it is. ``lost_line``: the line under which it lists
    the run, where the run names none now; empty otherwise.
    """

    run: Run
    settings: SmoothConfig
    why: str
    listed: bool = False
    lost_line: str = ""

    @property
    def fresh(self) -> bool:
        """Return whether the result is there as it would be computed."""
        return not self.why


def plan(runs: Sequence[Run], store: Store, known: KnownContent) -> list[PlannedRun]:
    """Return the runs in their order, each with what is to be done.

    Raises :class:`~trackfg.errors.BadInputError` for settings, a map or a known line that cannot be read.
    """
    settings = {path: SmoothConfig.from_toml(path) if path else SmoothConfig() for path in _distinct(runs, "settings")}
    digests = {path: settings_sha256(values) for path, values in settings.items()}
    maps = {place: _newest_map(place) if place else "" for place in _distinct(runs, "map")}
    lines = {place: line_sha256(Path(place)) if place else "" for place in _distinct(runs, "known_line")}
    software = algorithm()
    listed = {row["run"]: row for row in store.read(_COLUMNS)}
    with_result = store.names()
    runs_with_result = [run for run in runs if run.name in with_result]
    old_inputs = {run.name: _inputs(store.result(run.name), known) for run in runs_with_result}
    contents = _contents([run.recording for run in runs_with_result if old_inputs[run.name] is not None], known)
    known.save()
    planned = []
    for run in runs:
        row, inputs = listed.get(run.name), old_inputs.get(run.name)
        lost_line = row["line"] if row is not None and row["line"] != run.line == UNKNOWN_LINE else ""
        if inputs is None:
            planned.append(PlannedRun(run, settings[run.settings], _no_result(row), lost_line=lost_line))
            continue
        now = Inputs(contents[run.recording], digests[run.settings], maps[run.map], software, lines[run.known_line])
        reasons = list(changes(inputs, now))
        if inputs.settings_sha256 != now.settings_sha256:
            page = _page(store.result(run.name)) or {}
            reasons.append(changed_settings(page, settings[run.settings]))
        as_it_is = row is not None and _is_listed(row, run, inputs)
        planned.append(PlannedRun(run, settings[run.settings], "; ".join(reasons), as_it_is, lost_line))
    return planned


def _newest_map(place: str) -> str:
    from trackfg.maps import read_versions  # its database takes a third of the time that planning without maps does

    return newest_map(read_versions(place))


def _distinct(runs: Iterable[Run], field: str) -> list[str | None]:
    return list(dict.fromkeys(getattr(run, field) for run in runs))


def _no_result(row: Mapping[str, Any] | None) -> str:
    return f"failed before: {row['reason']}" if row is not None and row["status"] == "failed" else "no result yet"


def _is_listed(row: Mapping[str, Any], run: Run, inputs: Inputs) -> bool:
    as_now = (row["status"], row["line"], row["recording"], row["tags"]) == ("done", run.line, run.recording, run.tags)
    return as_now and Inputs(*(row[name] for name in Inputs._fields)) == inputs


def _page(result: str) -> dict[str, Any] | None:
    """Return the summary of a result as JSON; None where there is none."""
    try:
        page = json_of(read(joined(result, RESULT_FOLDER.head)))
    except (OSError, ValueError, PlaceError):
        return None
    return page if isinstance(page, dict) else None


def _inputs(result: str, cache: KnownContent) -> Inputs | None:
    """Return what a result was computed from; None where a file is missing or its summary cannot be read."""
    if (text := cache.recall(result)) is not None:
        return Inputs(*json.loads(text))
    state = sight(result, result, RESULT_FOLDER.files)
    if not all(is_file(joined(result, name)) for name in RESULT_FOLDER.files):
        return None
    try:
        page = _page(result)
        inputs = None if page is None else Inputs.of_summary(page)
    except (AttributeError, KeyError, TypeError):
        return None
    if inputs is not None:
        cache.remember(state, json.dumps(inputs))
    return inputs


def _contents(recordings: Sequence[str], cache: KnownContent) -> dict[str, str]:
    """Return the digest of each recording's files, several at a time; an empty text where they cannot be read."""
    contents = {place: cache.recall(place) or "" for place in recordings}
    unknown = [place for place, digest in contents.items() if not digest]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for state, digest in filter(None, pool.map(_content, unknown)):
            cache.remember(state, digest)
            contents[state.place] = digest
    return contents


def _content(recording: str) -> tuple[Sight, str] | None:
    """Return what a recording's files look like and their digest; None where they cannot be read."""
    try:
        state = sight(recording, *content_of(recording))
        with local_recording(recording) as folder:
            digest = files_sha256(*content_files(folder))
    except PlaceError:
        return None
    return None if digest is None else (state, digest)
