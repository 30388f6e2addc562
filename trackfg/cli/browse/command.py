"""``trackfg browse``: pages about the runs of a store, for a browser on this machine."""

from __future__ import annotations

import sys
import threading
from contextlib import suppress
from typing import Annotated

import typer

from trackfg.cli.options import PORT, Port


def browse(
    store: Annotated[str, typer.Argument(metavar="STORE", help="Folder or URL of a store.")],
    port: Port = PORT,
) -> None:
    """Serve pages about the runs of a store at 127.0.0.1, until interrupted (Ctrl-C).

    A list of runs to choose from, lines coloured by a quantity or its growth, the runs over a section laid over each
    other, each run's report, and how far running batches are. Nothing in the store is changed.
    """
    from trackfg.cli.browse.pages import StorePages, handler_of
    from trackfg.streaming.view.local_server import serving_locally

    pages = StorePages(store)
    with serving_locally(handler_of(pages), port) as address:
        print(f"browse: {address}", file=sys.stderr, flush=True)
        with suppress(KeyboardInterrupt):
            threading.Event().wait()
