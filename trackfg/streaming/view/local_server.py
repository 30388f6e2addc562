"""Pages are served on this machine alone, for a browser on it, while a block of code runs.

The server listens at 127.0.0.1 and answers nothing but GET, and only where the request names this host: a page of
another site that is open in the same browser cannot read it (DNS rebinding).
"""

from __future__ import annotations

import errno
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from socketserver import TCPServer
from typing import ClassVar

from trackfg.errors import OutputError
from trackfg.files.open_files import files_in_reserve

ADDRESS = "127.0.0.1"
_MOST_THREADS = 100
"""Threads of the process, one for each open connection, beyond which no further one is served; a browser opens six."""
_FILES_OF_A_REQUEST = 4
"""Open files without which nothing is served: the connection, and what is read for the answer, by trackfg, Python and
Arrow at the same time."""


class LocalHandler(BaseHTTPRequestHandler):
    """Answers one request. ``policy`` is the content security policy that is sent with every answer."""

    policy: ClassVar[str] = "frame-ancestors 'none'"
    timeout = 30.0
    server_version, sys_version = "trackfg", ""

    def answer(self) -> None:
        """Answer a request for ``path`` by :meth:`send_content` or :meth:`send_error`."""
        raise NotImplementedError

    def do_GET(self) -> None:
        """Answer, unless the request names another host."""
        if self.headers.get("Host", "").partition(":")[0] not in (ADDRESS, "localhost"):
            self.send_error(403, "asked for by another name")
            return
        with suppress(ConnectionError):  # the page was closed
            self.answer()

    def send_content(self, content: bytes, kind: str, status: int = 200) -> None:
        """Send content of a media type."""
        self.send_head(f"{kind}; charset=utf-8", len(content), status)
        self.wfile.write(content)

    def send_head(self, kind: str, length: int | None = None, status: int = 200) -> None:
        """Send the head of an answer; ``length`` None where its end is not known yet."""
        self.send_response(status)
        self.send_header("Content-Type", kind)
        if length is not None:
            self.send_header("Content-Length", str(length))
        for name, text in {
            "Cache-Control": "no-store",
            "Content-Security-Policy": self.policy,
            "Referrer-Policy": "no-referrer",
            "X-Content-Type-Options": "nosniff",
        }.items():
            self.send_header(name, text)
        self.end_headers()

    def log_message(self, format: str, *values: object) -> None:
        """Keep requests off the terminal, which shows what the command prints."""


class _LocalServer(ThreadingHTTPServer):
    """The server keeps what browsers do to their connections off the terminal."""

    daemon_threads = True
    request_queue_size = _MOST_THREADS

    def server_bind(self) -> None:
        """Listen, without asking a name server for this machine's name as ``HTTPServer`` does.

        Raises ``OSError`` where no connection could be accepted: a browser would wait for ever.
        """
        TCPServer.server_bind(self)
        with files_in_reserve(_FILES_OF_A_REQUEST):
            pass
        self.server_name, self.server_port = ADDRESS, int(self.server_address[1])

    def verify_request(self, request: object, client_address: object) -> bool:
        """Refuse a connection beyond the most that are served at a time: each has a thread."""
        return threading.active_count() <= _MOST_THREADS

    def handle_error(self, request: object, client_address: object) -> None:
        """Say nothing where a connection breaks off; anything else is an error of trackfg."""
        if not isinstance(sys.exc_info()[1], OSError):
            super().handle_error(request, client_address)  # type: ignore[arg-type]


@contextmanager
def serving_locally(handler: type[LocalHandler], port: int) -> Iterator[str]:
    """Answer requests by a handler while the block runs, and yield the address. ``port`` 0: any that is free.

    Raises :class:`OutputError` where the port is taken, and where too few files may be opened.
    """
    try:
        server = _LocalServer((ADDRESS, port), handler)
    except OSError as error:
        hint = "allow more open files" if error.errno in (errno.EMFILE, errno.ENFILE) else "another port, by --port"
        raise OutputError(f"{ADDRESS}:{port}: cannot be listened at ({error.strerror}). Hint: {hint}") from error
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.1}, daemon=True)
    thread.start()
    try:
        yield f"http://{ADDRESS}:{server.server_port}/"
    finally:
        server.shutdown()
        server.server_close()
