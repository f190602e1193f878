"""Attacks on the studio's server: each is refused, and the server is well afterwards."""

from __future__ import annotations

import http.client
import selectors
import socket
import threading
import time
from contextlib import closing, suppress

import pytest
import uvicorn
import websockets.exceptions
from starlette.applications import Starlette
from starlette.responses import PlainTextResponse
from starlette.routing import Route, WebSocketRoute
from websockets.sync.client import connect

from shoal.studio import guard as guard_module
from shoal.studio.guard import MOST_CONNECTIONS, Guard, LimitedConnection
from shoal.studio.server import listening


async def count_bytes(request):
    return PlainTextResponse(str(sum([len(piece) async for piece in request.stream()])))


async def echo(socket):
    await socket.accept()
    await socket.send_text(await socket.receive_text())
    await socket.close()


class Served:
    def __init__(self, application=None):
        routes = [
            Route("/", count_bytes),
            Route("/put", count_bytes, methods=["PUT", "POST"]),
            WebSocketRoute("/live", echo),
        ]
        self.socket = listening(None)
        self.port = self.socket.getsockname()[1]
        self.guard = Guard(application or Starlette(routes=routes), self.port)
        config = uvicorn.Config(
            self.guard,
            http=LimitedConnection,
            ws="websockets-sansio",
            log_level="critical",
            lifespan="off",
            proxy_headers=False,
        )
        self.server = uvicorn.Server(config)
        self.thread = threading.Thread(
            target=self.server.run, kwargs={"sockets": [self.socket]}, daemon=True
        )
        self.thread.start()
        status, headers, _ = self.ask("GET", f"/?token={self.guard.token}", cookie=None)
        assert (status, headers["location"]) == (303, "/")
        self.entry = headers["set-cookie"]
        self.cookie = self.entry.partition(";")[0]

    def ask(self, method="GET", path="/", body=None, cookie="ours", **headers):
        given = {name.replace("_", "-"): value for name, value in headers.items()}
        if cookie is not None:
            given["cookie"] = self.cookie if cookie == "ours" else cookie
        with closing(http.client.HTTPConnection("127.0.0.1", self.port, timeout=5)) as connection:
            connection.request(method, path, body, given)
            answer = connection.getresponse()
            return (
                answer.status,
                {name.lower(): value for name, value in answer.getheaders()},
                answer.read(),
            )

    def well(self):
        return self.ask()[0] == 200

    def raw(self):
        return socket.create_connection(("127.0.0.1", self.port), timeout=5)


@pytest.fixture(scope="module")
def served():
    made = Served()
    yield made
    made.server.should_exit = True
    made.thread.join(5)


def test_listens_to_this_machine_only(served):
    assert served.socket.getsockname()[0] == "127.0.0.1"


def test_answers_wait_for_nothing(served, monkeypatch):
    told = []

    def made(connection, transport):
        told.append(
            transport.get_extra_info("socket").getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
        )
        begin(connection, transport)

    begin = LimitedConnection.connection_made
    monkeypatch.setattr(LimitedConnection, "connection_made", made)
    assert served.well()
    assert told == [1]


def test_the_cookie_is_for_the_browser_alone(served):
    assert "HttpOnly" in served.entry
    assert "SameSite=Strict" in served.entry


def test_pages_may_run_nothing_that_is_not_the_studios(served):
    status, headers, _ = served.ask()
    assert status == 200
    policy = headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert "http:" not in policy
    assert headers["x-content-type-options"] == "nosniff"


@pytest.mark.parametrize(
    ("status", "given"),
    [
        (421, {"host": "evil.example"}),
        (421, {"host": "127.0.0.1"}),
        (403, {"origin": "http://evil.example"}),
        (403, {"origin": "null"}),
        (403, {"sec_fetch_site": "cross-site"}),
        (403, {"sec_fetch_site": "same-site"}),
        (401, {"cookie": None}),
        (401, {"cookie": "shoal_studio_1=x"}),
        (401, {"path": "/?token=guessed", "cookie": None}),
        (401, {"path": "/?token=", "cookie": None}),
    ],
)
def test_strangers_are_refused(served, status, given):
    assert served.ask(**given)[0] == status
    assert served.well()


def test_a_guessed_cookie_is_refused(served):
    assert (
        served.ask(cookie=served.cookie[:-1] + ("a" if served.cookie[-1] != "a" else "b"))[0] == 401
    )


@pytest.mark.parametrize(
    ("origin", "cookie"),
    [
        ("http://evil.example", True),
        (None, True),
        ("ours", False),
        ("http://localhost.evil.example", True),
    ],
)
def test_sockets_of_other_pages_are_refused(served, origin, cookie):
    asked = f"http://127.0.0.1:{served.port}" if origin == "ours" else origin
    headers = {"cookie": served.cookie} if cookie else {}
    with (
        pytest.raises(websockets.exceptions.InvalidStatus),
        connect(f"ws://127.0.0.1:{served.port}/live", origin=asked, additional_headers=headers),
    ):
        pass
    assert served.well()


def test_the_page_of_the_studio_has_its_socket(served):
    address, origin = f"ws://127.0.0.1:{served.port}/live", f"http://127.0.0.1:{served.port}"
    with connect(address, origin=origin, additional_headers={"cookie": served.cookie}) as opened:
        opened.send("hello")
        assert opened.recv() == "hello"


def test_a_body_that_says_it_has_a_gigabyte_is_refused_before_it_comes(served):
    head = (
        f"PUT /put HTTP/1.1\r\nHost: 127.0.0.1:{served.port}\r\nCookie:"
        f" {served.cookie}\r\nContent-Length: {2**30}\r\n\r\n"
    )
    with closing(served.raw()) as line:
        line.sendall(head.encode())
        assert b" 413 " in line.recv(100)
    assert served.well()


def test_a_body_that_does_not_say_how_large_it_is_is_cut_off(served, monkeypatch):
    monkeypatch.setattr(guard_module, "LARGEST_BODY", 2**16)
    head = (
        f"POST /put HTTP/1.1\r\nHost: 127.0.0.1:{served.port}\r\nCookie:"
        f" {served.cookie}\r\nTransfer-Encoding: chunked\r\n\r\n"
    )
    piece, sent = b"4000\r\n" + b"x" * 0x4000 + b"\r\n", 0
    with closing(served.raw()) as line:
        line.sendall(head.encode())
        with suppress(OSError):
            while sent < 2**30:
                line.sendall(piece)
                sent += len(piece)
    assert sent < 2**27
    assert served.well()


@pytest.mark.parametrize(
    "came",
    [
        "",
        "GET / HTTP/1.1\r\nHost: x",
        "POST /put HTTP/1.1\r\nHost: {host}\r\nCookie: {cookie}\r\nContent-Length: 9\r\n\r\nx",
    ],
)
def test_slow_requests_are_not_waited_for(served, monkeypatch, came):
    monkeypatch.setattr(guard_module, "SLOWEST", 0.2)
    began = time.monotonic()
    with closing(served.raw()) as line:
        line.sendall(came.format(host=f"127.0.0.1:{served.port}", cookie=served.cookie).encode())
        with suppress(ConnectionResetError):
            while line.recv(1000):
                pass
    assert 0.1 < time.monotonic() - began < 3
    assert served.well()


def test_of_many_connections_those_that_say_nothing_make_room_for_one_that_asks(served):
    lines = []
    try:
        lines += [served.raw() for _ in range(MOST_CONNECTIONS + 100)]
        dropped, until = 0, time.monotonic() + 20
        with selectors.DefaultSelector() as waiting:
            for line in lines:
                waiting.register(line, selectors.EVENT_READ)
            while dropped < 90 and time.monotonic() < until:
                for key, _ in waiting.select(1):  # as nothing was asked, the line is closed
                    waiting.unregister(key.fileobj)
                    dropped += 1
        assert 90 <= dropped <= 110
        assert served.well()
    finally:
        for line in lines:
            line.close()
    until = time.monotonic() + 5
    while LimitedConnection.open_now > 1 and time.monotonic() < until:
        time.sleep(0.01)
    assert served.well()
