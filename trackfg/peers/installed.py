"""Say whether the package behind a peer is there. None of them is needed for anything else."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Literal

from trackfg.errors import MissingLibraryError

Peer = Literal["python-ins", "vqf"]

_MODULES: dict[Peer, str] = {"python-ins": "pyins", "vqf": "vqf"}


NotInstalledError = MissingLibraryError
"""The name that this error had here before."""


def is_installed(peer: Peer) -> bool:
    """Return whether the distribution of that name can be imported. Nothing is imported to find out."""
    return find_spec(_MODULES[peer]) is not None


def require(peer: Peer) -> None:
    """Raise :class:`~trackfg.errors.MissingLibraryError` where ``peer`` is not installed."""
    if not is_installed(peer):
        raise MissingLibraryError(
            f'{peer} is not installed; expected it for this estimator: pip install "trackfg[peers]"'
        )
