"""A warning about a key of a recording's description names the file and the key."""

from __future__ import annotations

from trackfg.recording.findings import Finding

TOML = "recording.toml"
"""The file that the description is in."""


def description_warning(
    code: str, message: str, column: str, expected: str | None = None, hint: str | None = None
) -> Finding:
    """Return a warning about a key of the description."""
    return Finding("warning", code, message, file=TOML, column=column, expected=expected, hint=hint)
