"""Protection of the studio: authentication, limits of size and time, and security headers."""

from __future__ import annotations

import asyncio
import hmac
import json
import secrets
from collections.abc import Awaitable, Callable, MutableMapping
from http.cookies import CookieError, SimpleCookie
from typing import Any, ClassVar
from urllib.parse import parse_qs

from uvicorn.protocols.http.h11_impl import H11Protocol

Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
Application = Callable[[MutableMapping[str, Any], Receive, Send], Awaitable[None]]

LARGEST_BODY = 2 * 2**20
"""Maximum size of the body of a request, except an upload, in bytes."""

LARGEST_UPLOAD = 512 * 2**20
"""Maximum size of an uploaded file, in bytes."""

SLOWEST = 10.0
"""Maximum time in seconds between two pieces of a request's body. A new connection must send a
request within `SLOWEST` seconds.
"""

LEAST_DRAINED = 16 * 2**20
"""Number of bytes of a refused body that the server still reads, at least.

A client that is still sending when the connection closes gets a reset instead of the answer.
"""

DRAINED_AFTER = 1.0
"""Time in seconds without a new piece after which the server stops reading a refused body."""

MOST_CONNECTIONS = 200
MOST_SOCKETS = 16

_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:;"
    " connect-src 'self' ws://{host}; frame-src 'self'; frame-ancestors 'self'; base-uri 'none';"
    " form-action 'none'"
)
_KEPT_PRIVATE = {
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-store",
}


class _RefusedError(Exception):
    """Raised to refuse a request. The error contains the HTTP status and a sentence for
    the user.
    """

    def __init__(self, status: int, sentence: str) -> None:
        super().__init__(sentence)
        self.status, self.sentence = status, sentence


class Guard:
    """The protection of the studio: an ASGI middleware that checks every request.

    Parameters
    ----------
    application : callable
        The ASGI application that the middleware protects.
    port : int
        Port of the server. The middleware refuses requests for another host or another port, and
        requests from pages of other websites.

    Attributes
    ----------
    token : str
        Secret text in the first address that the browser opens. In exchange for the secret text,
        the server sets a cookie.
    """

    def __init__(self, application: Application, port: int) -> None:
        self.application = application
        self.hosts = (f"127.0.0.1:{port}", f"localhost:{port}")
        self.token = secrets.token_urlsafe(32)
        self._secret = secrets.token_urlsafe(32)
        self._cookie = f"shoal_studio_{port}"
        self._sockets = 0

    async def __call__(self, scope: MutableMapping[str, Any], receive: Receive, send: Send) -> None:
        """Answer one request, or refuse it."""
        if scope["type"] == "lifespan":
            await self.application(scope, receive, send)
            return
        headers = _headers(scope)
        try:
            self._check_sender(scope, headers)
            if scope["type"] == "websocket":
                await self._socket(scope, receive, send)
            elif self._has_token(scope):
                await _answer(send, 303, "", {"location": "/", "set-cookie": self._entry})
            else:
                self._check_cookie(headers)
                await self._limited(scope, headers, receive, send)
        except _RefusedError as refused:
            if scope["type"] == "websocket":
                await receive()
                await send({"type": "websocket.close", "code": 1008})
            else:
                await _refuse(receive, send, refused, _most(scope))

    async def _limited(
        self,
        scope: MutableMapping[str, Any],
        headers: dict[bytes, bytes],
        receive: Receive,
        send: Send,
    ) -> None:
        """Let the application answer a request, or raise `_RefusedError` if the body is too large
        or arrives too slowly.

        The application gets the refusal as an exception, and may answer the exception itself
        (Starlette sends the status 500). The client gets the refusal in place of that answer.
        """
        body = _Body(_most(scope), headers, receive)
        private = _private(send, headers[b"host"].decode())
        begun = False

        async def answer(message: Message) -> None:
            nonlocal begun
            if begun or body.refusal is None:
                begun = True
                await private(message)

        try:
            await self.application(scope, body.receive, answer)
        except Exception:
            if body.refusal is None or begun:
                raise
        if body.refusal is not None and not begun:
            raise body.refusal

    @property
    def _entry(self) -> str:
        return f"{self._cookie}={self._secret}; HttpOnly; SameSite=Strict; Path=/"

    def _check_sender(self, scope: MutableMapping[str, Any], headers: dict[bytes, bytes]) -> None:
        host, origin = (headers.get(name, b"").decode("latin-1") for name in (b"host", b"origin"))
        if host not in self.hosts:  # another host name that leads to this server
            raise _RefusedError(421, f"expected the host {self.hosts[0]}")
        if (origin and origin != f"http://{host}") or (scope["type"] == "websocket" and not origin):
            raise _RefusedError(403, "expected a request of the studio's own page")
        if headers.get(b"sec-fetch-site", b"none") not in (b"none", b"same-origin"):
            raise _RefusedError(403, "expected a request of the studio's own page")
        if scope["type"] == "websocket":
            self._check_cookie(headers)

    def _check_cookie(self, headers: dict[bytes, bytes]) -> None:
        try:
            cookie = SimpleCookie(headers.get(b"cookie", b"").decode("latin-1")).get(self._cookie)
        except CookieError:
            cookie = None
        if cookie is None or not hmac.compare_digest(cookie.value.encode(), self._secret.encode()):
            raise _RefusedError(
                401, "expected the address that the command shoal studio printed: open that address"
            )

    def _has_token(self, scope: MutableMapping[str, Any]) -> bool:
        if scope["path"] != "/" or scope["method"] != "GET":
            return False
        given = parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])[0]
        return hmac.compare_digest(given.encode(), self.token.encode())

    async def _socket(self, scope: MutableMapping[str, Any], receive: Receive, send: Send) -> None:
        if self._sockets >= MOST_SOCKETS:
            raise _RefusedError(503, f"expected at most {MOST_SOCKETS} open pages of the studio")
        self._sockets += 1
        try:
            await self.application(scope, receive, send)
        finally:
            self._sockets -= 1


def _headers(scope: MutableMapping[str, Any]) -> dict[bytes, bytes]:
    """Return the headers of a request by name. A header that occurs twice with different values
    gets an invalid value.
    """
    headers: dict[bytes, bytes] = {}
    for name, value in scope["headers"]:
        headers[name] = value if headers.get(name, value) == value else b"\x00"
    return headers


def _most(scope: MutableMapping[str, Any]) -> int:
    """Return the maximum size of the body of a request, in bytes."""
    return LARGEST_UPLOAD if scope["method"] == "PUT" else LARGEST_BODY


class _Body:
    """The body of a request. `receive` refuses a body that is too large or arrives too slowly, and
    keeps the refusal.
    """

    def __init__(self, most: int, headers: dict[bytes, bytes], receive: Receive) -> None:
        self.most, self._receive = most, receive
        self.refusal: _RefusedError | None = None
        self._came, self._whole = 0, False
        length = headers.get(b"content-length", b"0")
        if not length.isdigit() or len(length) > 20 or int(length) > most:
            raise self._too_large()

    def _too_large(self) -> _RefusedError:
        size = f"{self.most // 2**20} MiB" if self.most >= 2**20 else f"{self.most} bytes"
        return _RefusedError(413, f"body: expected at most {size}, got more")

    async def receive(self) -> Message:
        if self._whole:  # only the end of the connection can follow
            return await self._receive()
        if self.refusal is None:
            try:
                message = await asyncio.wait_for(self._receive(), SLOWEST)
            except TimeoutError:
                self.refusal = _RefusedError(
                    408, f"body: expected the next piece within {SLOWEST:g} s, got none"
                )
            else:
                self._came += len(message.get("body", b""))
                self._whole = not message.get("more_body", False)
                if self._came <= self.most:
                    return message
                self.refusal = self._too_large()
        raise self.refusal


async def _refuse(receive: Receive, send: Send, refused: _RefusedError, most: int) -> None:
    """Answer a refused request, and read the rest of its body for a while, so that the client reads
    the answer.
    """
    await _answer(send, refused.status, refused.sentence, {}, more=True)
    if refused.status != 408:
        came, enough = 0, max(most, LEAST_DRAINED) if refused.status == 413 else LEAST_DRAINED
        while came < enough:
            try:
                message = await asyncio.wait_for(receive(), DRAINED_AFTER)
            except TimeoutError:
                break
            came += len(message.get("body", b""))
            if not message.get("more_body", False):
                break
    await send({"type": "http.response.body", "body": b""})


def _private(send: Send, host: str) -> Send:
    """Return a function ``send`` that adds the security headers to every answer."""

    async def private(message: Message) -> None:
        if message["type"] == "http.response.start":
            message["headers"] = [
                *message.get("headers", []),
                *_encode_headers({"content-security-policy": _POLICY.format(host=host)}),
            ]
        await send(message)

    return private


def _encode_headers(more: dict[str, str]) -> list[tuple[bytes, bytes]]:
    return [(name.encode(), value.encode()) for name, value in (_KEPT_PRIVATE | more).items()]


async def _answer(
    send: Send, status: int, sentence: str, more_headers: dict[str, str], *, more: bool = False
) -> None:
    """Send an answer of the guard. An error is a JSON object with one sentence; with ``more``, the
    answer stays open.
    """
    body = json.dumps({"error": sentence}).encode() if sentence else b""
    headers = {
        "content-type": "application/json",
        "content-length": str(len(body)),
        "connection": "close",
        "content-security-policy": "default-src 'none'",
    }
    await send(
        {
            "type": "http.response.start",
            "status": status,
            "headers": _encode_headers(headers | more_headers),
        }
    )
    await send({"type": "http.response.body", "body": body, "more_body": more})


class LimitedConnection(H11Protocol):
    """A server connection with limits on the number of connections and on idle time.

    If too many connections are open, the server closes the oldest connection that has not yet sent
    a request. If all connections have sent requests, the server closes the newest connection.
    """

    open_now = 0
    silent: ClassVar[dict[LimitedConnection, None]] = {}  # oldest first

    def connection_made(self, transport: Any) -> None:
        """Accept a new connection. If the number of connections exceeds the maximum, close one
        connection.
        """
        LimitedConnection.open_now += 1
        self.counted = True
        super().connection_made(transport)
        self.silent[self] = None
        self.patience = asyncio.get_running_loop().call_later(SLOWEST, self._give_up)
        if LimitedConnection.open_now > MOST_CONNECTIONS:
            last = next((one for one in self.silent if one.scope is None), self)
            last.transport.abort()
            last._left()

    def _give_up(self) -> None:
        if self.scope is not None or self.transport.is_closing():
            return
        if self.conn.trailing_data[0]:  # a part of a request has come
            body = json.dumps(
                {"error": f"request: expected all its headers within {SLOWEST:g} s, got a part"}
            ).encode()
            head = (
                "HTTP/1.1 408 Request Timeout\r\ncontent-type: application/json\r\nconnection:"
                " close\r\ncontent-length: "
            )
            self.transport.write(head.encode() + str(len(body)).encode() + b"\r\n\r\n" + body)
            self.transport.close()
        else:
            self.transport.abort()

    def handle_websocket_upgrade(self, event: Any) -> None:
        """Stop counting a connection that becomes a websocket. The class `Guard` counts
        websockets.
        """
        self._left()
        super().handle_websocket_upgrade(event)

    def connection_lost(self, error: Exception | None) -> None:
        """Stop counting a connection that has ended."""
        self._left()
        super().connection_lost(error)

    def _left(self) -> None:
        if self.counted:
            self.counted = False
            LimitedConnection.open_now -= 1
            self.silent.pop(self, None)
            self.patience.cancel()
