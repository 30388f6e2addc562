"""The errors a user can meet. Everything trackfg raises on purpose derives from :class:`TrackfgError`."""


class TrackfgError(Exception):
    """Something the user can act on: the message alone says what and where."""


class BadInputError(TrackfgError):
    """Input that cannot be used. The message names file, column, row and what was expected."""


class UnsolvableError(TrackfgError):
    """A recording that is well-formed but does not determine what was asked for; the message says why."""


class OutputError(TrackfgError):
    """Output that cannot be written: a full disk, a closed pipe, no permission. What was written before is whole."""


def printable(text: str) -> str:
    """Return a text of a file with its control characters escaped, as ``\\x1b``, so that none reaches a terminal."""
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)
