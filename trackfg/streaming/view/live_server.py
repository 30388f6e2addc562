"""A page of a running stream is served on this machine alone, and pushed what is new as server-sent events.

Server-sent events (HTML Living Standard, 9.2) come over one connection that stays open; a browser opens it again by
itself, and then receives everything anew.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.resources import files
from typing import ClassVar

from trackfg.streaming.view.live_state import LiveState
from trackfg.streaming.view.local_server import LocalHandler, serving_locally

_PAUSE_S = 0.3
"""Least time from one message to a page to the next, s: what changes faster cannot be read."""

_ALIVE_S = 5.0
"""A comment is sent after so long without news, s, so that either side notices a lost connection."""

_RETRY_MS = 1000
"""A page that lost its connection tries again after this time, ms."""

_LAST_S = 2.0
"""Longest time that the end of a stream waits until pages have received it, s."""

_PARTS = {
    "/": ("page.html", "text/html"),
    "/live.css": ("live.css", "text/css"),
    "/live.js": ("live.js", "text/javascript"),
}


@contextmanager
def serving(state: LiveState, port: int) -> Iterator[str]:
    """Serve the page of a stream while the block runs, and yield its address. ``port`` 0: any that is free.

    Raises :class:`OutputError` where the port is taken.
    """
    pages = _OpenPages()
    handler = type("Handler", (_Handler,), {"state": state, "open_pages": pages})
    with serving_locally(handler, port) as address:
        try:
            yield address
        finally:
            state.end()
            pages.wait_until_none(_LAST_S)


class _OpenPages:
    """Counts connections that stay open."""

    def __init__(self) -> None:
        self._changed, self._count = threading.Condition(), 0

    def change(self, by: int) -> None:
        with self._changed:
            self._count += by
            self._changed.notify_all()

    def wait_until_none(self, seconds: float) -> None:
        with self._changed:
            self._changed.wait_for(lambda: self._count == 0, seconds)


class _Handler(LocalHandler):
    state: ClassVar[LiveState]
    open_pages: ClassVar[_OpenPages]
    policy = (
        "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )

    def answer(self) -> None:
        if self.path == "/events":
            self._push()
        elif self.path in _PARTS:
            name, kind = _PARTS[self.path]
            self.send_content(files("trackfg.streaming.view").joinpath(name).read_bytes(), kind)
        else:
            self.send_error(404)

    def _push(self) -> None:
        self.send_head("text/event-stream")
        self.open_pages.change(1)
        try:
            self.wfile.write(f"retry: {_RETRY_MS}\n\n".encode())
            self._messages()
        except OSError:
            pass  # the page was closed
        finally:
            self.open_pages.change(-1)

    def _messages(self) -> None:
        count, whole = self.state.everything()
        self._send("whole", whole)
        while True:
            ended = self.state.ended
            news = self.state.since(count, 0.0 if ended else _ALIVE_S)
            if news is None:
                count, whole = self.state.everything()
                self._send("whole", whole)
                continue
            count, messages = news
            for message in messages:
                self._send("news", message)
            if ended and not messages:
                return
            if not messages:
                self.wfile.write(b": no news\n\n")
            time.sleep(0.0 if ended else _PAUSE_S)

    def _send(self, kind: str, message: str) -> None:
        self.wfile.write(f"event: {kind}\ndata: {message}\n\n".encode())
        self.wfile.flush()
