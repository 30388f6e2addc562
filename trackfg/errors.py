"""The errors a user can meet, and texts for their messages.

Everything trackfg raises on purpose derives from :class:`TrackfgError`.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class TrackfgError(Exception):
    """Something the user can act on: the message alone says what and where.

    Examples
    --------
    >>> import trackfg
    >>> try:
    ...     trackfg.read_recording("no-such-run")
    ... except trackfg.TrackfgError as error:
    ...     print(error)
    no-such-run: no such folder; expected a folder with recording.toml
    """


class BadInputError(TrackfgError):
    """Input that cannot be used. The message names file, column, row and what was expected.

    Examples
    --------
    >>> import trackfg
    >>> try:
    ...     trackfg.SmoothConfig.from_toml("no-such-settings.toml")
    ... except trackfg.BadInputError as error:
    ...     print(error)
    no-such-settings.toml: cannot be read: No such file or directory
    """


class UnsolvableError(TrackfgError):
    """A recording that is well-formed but does not determine what was asked for; the message says why.

    Examples
    --------
    >>> from dataclasses import replace
    >>> import trackfg
    >>> recording = trackfg.read_recording("run1")
    >>> try:
    ...     trackfg.smooth(replace(recording, imu=recording.imu.head(20)))
    ... except trackfg.UnsolvableError as error:
    ...     print(error)
    the IMU record has 20 samples over 0.1 s: at least 10 samples and 0.5 s are needed
    """


class MissingLibraryError(TrackfgError):
    """A library of an extra is not installed; the message has the command that installs it."""


class OutputError(TrackfgError):
    """Output that cannot be written: a full disk, a closed pipe, no permission. What was written before is whole."""


def printable(text: str) -> str:
    """Return a text of a file with its control characters escaped, as ``\\x1b``, so that none reaches a terminal."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


def first_line(error: BaseException) -> str:
    """Return the first line of an error's text, or its type where it has none: 200 characters at most."""
    return (str(error).splitlines() or [type(error).__name__])[0][:200]


def did_you_mean(name: str, known: Iterable[str]) -> str | None:
    """Return ``did you mean 'x'?`` for the known name nearest to ``name``; None where none is near."""
    folded, by_folded = name.strip().casefold(), {candidate.strip().casefold(): candidate for candidate in known}
    if len(folded) > 3 * max(map(len, by_folded), default=0):
        return None  # not half of its letters can be theirs
    near = difflib.get_close_matches(folded, by_folded, n=1, cutoff=0.6)
    return f"did you mean {by_folded[near[0]]!r}?" if near else None


def expected_one_of(known: Iterable[str], name: str) -> str:
    """Return ``expected one of a, b. Hint: did you mean 'a'?``, the end of a message about a name that is not known."""
    names = list(known)
    near = did_you_mean(name, names)
    return f"expected one of {', '.join(names)}" + (f". Hint: {near}" if near else "")


def counted(number: int, noun: str) -> str:
    """Return a number with its noun: ``1 run``, ``2 runs``."""
    return f"{number} {noun}{'' if number == 1 else 's'}"
