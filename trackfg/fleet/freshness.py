"""A result is fresh while all that it was computed from is as its summary says.

That is the content of the recording, the settings, the version of the map, the versions of what computes and the
content of a known line. Each is one text; two results with the same five are the same to the last bit.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import pandas as pd

from trackfg.config import SmoothConfig
from trackfg.results.flatten import leaves
from trackfg.results.summary import versions

_COMPUTING = ("trackfg", "gtsam", "numpy", "scipy")
"""Packages whose version is part of the algorithm's: the others read and write, which does not change a bit."""

_SHOWN_SETTINGS = 3
"""Settings that a reason names at most."""


class Inputs(NamedTuple):
    """The inputs of a result; an empty text where its summary does not say, for no map, and for no known line
    but the recording's own.
    """

    files_sha256: str
    settings_sha256: str
    map: str
    algorithm: str
    known_line: str = ""

    @classmethod
    def of_summary(cls, page: Mapping[str, Any]) -> Inputs:
        """Return what a summary, as JSON has it, says."""
        facts, settings, use = page.get("run") or {}, page.get("settings"), page.get("map")
        return cls(
            files_sha256=facts.get("files_sha256") or "",
            settings_sha256="" if settings is None else _digest(settings),
            map="" if use is None else _map(use["name"], use["version"], use.get("written_at")),
            algorithm=_algorithm(page.get("versions", {})),
            known_line=(page.get("line") or {}).get("content_sha256") or "",
        )


def settings_sha256(settings: SmoothConfig) -> str:
    """Return the digest of all settings, defaults included: a comment or the order of a file changes nothing."""
    return _digest(settings.model_dump(mode="json"))


def newest_map(read: pd.DataFrame) -> str:
    """Return the text for the newest of the versions of a map (:func:`trackfg.maps.read_versions`)."""
    newest = read.iloc[-1]
    return _map(newest["name"], newest["version"], newest["written_at"])


def algorithm() -> str:
    """Return the versions of what computes here."""
    return _algorithm(versions())


def changes(before: Inputs, now: Inputs) -> Iterator[str]:
    """Yield in words what is not as it was, but for the settings (:func:`changed_settings`)."""
    if before.files_sha256 != now.files_sha256:
        has_digests = before.files_sha256 and now.files_sha256
        yield "the recording changed" if has_digests else "the content of the recording is not known"
    if before.map != now.map:
        yield f"the map is {now.map or 'none'}, not {before.map or 'none'}"
    if before.known_line != now.known_line:
        both = before.known_line and now.known_line
        yield "the known line changed" if both else f"a known line is given {'now' if now.known_line else 'no more'}"
    if before.algorithm != now.algorithm:
        yield f"computed by {before.algorithm}, not {now.algorithm}"


def changed_settings(page: Mapping[str, Any], settings: SmoothConfig) -> str:
    """Return in words what is another setting than in a summary."""
    previous, now = page.get("settings"), settings.model_dump(mode="json")
    if previous is None:
        return "the summary has no settings"
    old, new = (dict(leaves(values)) for values in (previous, now))
    names = [name for name in {**new, **old} if old.get(name) != new.get(name)]
    shown = ", ".join(f"{name} is {new.get(name)}, not {old.get(name)}" for name in names[:_SHOWN_SETTINGS])
    more = len(names) - _SHOWN_SETTINGS
    return f"settings: {shown}" + (f", and {more} more" if more > 0 else "")


def _map(name: str, version: int | None, written_at: str | None) -> str:
    return f"{name} version {version} of {written_at}"


def _algorithm(versions: Mapping[str, str]) -> str:
    return ", ".join(f"{name} {versions.get(name, '?')}" for name in _COMPUTING)


def _digest(settings: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(settings, sort_keys=True).encode()).hexdigest()
