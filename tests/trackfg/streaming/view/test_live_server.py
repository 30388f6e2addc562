"""The server of a live page against requests of any kind: what is no request for the page gets nothing of it."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from urllib.parse import urlsplit

import numpy as np
import pytest

from trackfg.streaming.view.live_server import serving
from trackfg.streaming.view.live_state import LiveState

ASK = b"GET /live.css HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
PIECES = (
    b"GET", b"POST", b"HEAD", b"OPTIONS", b"/", b"/events", b"/../../etc/passwd", b"/%2e%2e/", b"//live.js", b"\0",
    b" ", b"\r\n", b"\n", b"Host: 127.0.0.1", b"Host: evil.example", b"Host:", b"HTTP/1.1", b"HTTP/9.9",
    b"HTTP/1.1\r\n", b"Content-Length: -1", b"Content-Length: 99999999999",
    b"Transfer-Encoding: chunked", b"Expect: 100-continue",
    b"X: " + b"y" * 70_000, b"X: y\r\n" * 300, b"\xff\xfe", b"<script>", b"?a=b#c",
)  # fmt: skip


@pytest.fixture
def port() -> Iterator[int]:
    with serving(LiveState("run", 10.0), port=0) as address:
        yield int(urlsplit(address).port or 0)


def answer(port: int, request: bytes, *, wait: bool = True) -> bytes:
    """What comes back; nothing where the connection is closed without waiting."""
    with socket.create_connection(("127.0.0.1", port)) as connection:
        try:
            connection.sendall(request)
            if not wait:
                return b""
            connection.shutdown(socket.SHUT_WR)
            parts = []
            while part := connection.recv(65536):
                parts.append(part)
                if b"text/event-stream" in part:
                    break  # which has no end
            return b"".join(parts)
        except OSError:  # a server that refuses may close before the request has ended
            return b""


def requests(seed: int) -> Iterator[bytes]:
    rng = np.random.default_rng(seed)
    for _ in range(60):
        damaged = bytearray(ASK)
        for at in rng.integers(len(damaged), size=int(rng.integers(1, 6))):
            damaged[at] ^= 1 << int(rng.integers(8))
        yield bytes(damaged)
        yield b"".join(PIECES[i] for i in rng.integers(len(PIECES), size=int(rng.integers(1, 12))))
        yield rng.bytes(int(rng.integers(1, 3000)))


def test_requests_of_any_kind_leave_the_page_as_it_is(port: int, capfd: pytest.CaptureFixture[str]) -> None:
    whole = answer(port, ASK)
    assert b" 200 " in whole.splitlines()[0]
    for number, request in enumerate(requests(seed=0)):
        got = answer(port, request, wait=number % 3 > 0)
        if b" 200 " in got.partition(b"\r\n")[0]:
            assert request.startswith(b"GET /")
            assert b"127.0.0.1" in request or b"localhost" in request
        assert b"<script>" not in got.partition(b"\r\n\r\n")[2]
    assert answer(port, ASK).partition(b"\r\n\r\n")[2] == whole.partition(b"\r\n\r\n")[2]
    assert capfd.readouterr().err == ""


def test_another_name_of_the_host_gets_nothing(port: int) -> None:
    for name in (b"evil.example", b"127.0.0.1.evil.example", b"", b"localhost@evil.example"):
        assert b" 403 " in answer(port, b"GET / HTTP/1.1\r\nHost: " + name + b"\r\n\r\n").splitlines()[0]
    assert b" 501 " in answer(port, b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n").splitlines()[0]


@pytest.mark.skipif(os.name != "posix", reason="limits are POSIX")
def test_nothing_is_served_where_no_connection_could_be_accepted() -> None:
    script = (
        "import os, resource\n"
        "from trackfg.errors import OutputError\n"
        "from trackfg.streaming.view.local_server import LocalHandler, serving_locally\n"
        "resource.setrlimit(resource.RLIMIT_NOFILE, (os.dup(0) + 2,) * 2)\n"
        "try:\n"
        "    with serving_locally(LocalHandler, 0) as address:\n"
        "        print(address)\n"
        "except OutputError as error:\n"
        "    print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert "cannot be listened at (Too many open files). Hint: allow more open files" in done.stdout


def test_more_connections_than_are_served_are_closed(port: int) -> None:
    held = [socket.create_connection(("127.0.0.1", port)) for _ in range(150)]
    try:
        held[-1].settimeout(None)
        assert held[-1].recv(1) == b""
    finally:
        for connection in held:
            connection.close()
    while not answer(port, ASK):  # the threads of those that were closed end one after another
        pass
