"""Libraries of charts and of foreign formats are extras: a missing one is named with the command that installs it."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

from trackfg.errors import MissingLibraryError


def library(module: str, extra: str) -> ModuleType:
    """Import a library of an extra. Raises :class:`MissingLibraryError` with the command that installs it."""
    try:
        return import_module(module)
    except ImportError as error:
        name = module.partition(".")[0]
        raise MissingLibraryError(f"{name} is not installed. Hint: pip install 'trackfg[{extra}]'") from error
