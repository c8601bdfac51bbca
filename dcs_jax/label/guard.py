"""Who may come in: the browser that was given the token, and no page of another site."""

import ipaddress
import secrets
import socket
from collections.abc import MutableMapping
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse, RedirectResponse
from starlette.types import ASGIApp, Receive, Scope, Send

_LOOPBACK = ("127.0.0.1", "localhost", "[::1]")
_FORBIDDEN = 4403  # code with which a web socket is closed


def policy(host: str) -> str:
    """What the page may load: what this server sends, and nothing from a network."""
    return (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
        f"connect-src 'self' ws://{host}; base-uri 'none'; form-action 'none'; "
        "frame-ancestors 'none'"
    )


def is_loopback(host: str) -> bool:
    """Whether only programs of this machine can reach an address."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


class Guard:
    """Middleware that refuses a request without the token, or with a foreign Host or Origin.

    The token comes in the address once, and is a cookie from then on. The cookie's name has the
    port in it: browsers do not tell the ports of a host apart.
    """

    def __init__(self, app: ASGIApp, token: str, host: str, port: int) -> None:
        """host, port: where the server listens."""
        self._app, self._token, self._port = app, token, port
        self._host = host
        self.cookie = f"dcs_label_{port}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        host = headers.get("host", "")
        problem = self._foreign(headers, host, scope["type"] == "websocket")
        if problem is not None:
            await _refuse(scope, receive, send, problem)
            return
        given = parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])[-1]
        if scope["type"] == "http" and scope["path"] == "/" and self._right(given):
            response = RedirectResponse("/", 303)
            response.set_cookie(self.cookie, self._token, httponly=True, samesite="strict")
            await response(scope, receive, _with_headers(send, host))
            return
        if not self._right(_cookie(headers, self.cookie)):
            await _refuse(scope, receive, send, "open the address that dcs-jax label has printed")
            return
        await self._app(scope, receive, _with_headers(send, host))

    def _foreign(self, headers: Headers, host: str, needs_origin: bool) -> str | None:
        if not self._known(host):
            return f"the host {host!r} is not this server"
        origin = headers.get("origin")
        if (origin is None and needs_origin) or (origin not in (None, f"http://{host}")):
            return f"the origin {origin!r} is another site"
        foreign = headers.get("sec-fetch-site", "none") not in ("none", "same-origin")
        # A link may lead here; without the cookie it leads no further.
        if foreign and headers.get("sec-fetch-mode") != "navigate":
            return "the request is another site's"
        return None

    def _known(self, host: str) -> bool:
        """Whether a Host header names this server."""
        name, _, port = host.rpartition(":")
        if not name or "]" in port:
            name, port = host, "80"
        if port != str(self._port):
            return False
        if is_loopback(self._host):
            return name in (*_LOOPBACK, self._host)
        if name in (*_LOOPBACK, self._host, socket.gethostname(), socket.getfqdn()):
            return True
        try:  # a name could be made to lead here, an address is one of this machine
            ipaddress.ip_address(name.strip("[]"))
        except ValueError:
            return False
        return True

    def _right(self, token: str) -> bool:
        return secrets.compare_digest(token.encode(), self._token.encode())


def _cookie(headers: Headers, name: str) -> str:
    try:
        found = SimpleCookie(headers.get("cookie", "")).get(name)
    except CookieError:
        return ""
    return "" if found is None else found.value


def _with_headers(send: Send, host: str) -> Send:
    async def sending(message: MutableMapping[str, Any]) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            headers["Content-Security-Policy"] = policy(host)
            headers["X-Content-Type-Options"] = "nosniff"
            headers["Referrer-Policy"] = "no-referrer"
            headers["Cross-Origin-Resource-Policy"] = "same-origin"
            headers["Cross-Origin-Opener-Policy"] = "same-origin"
            headers["Cache-Control"] = "no-store"
        await send(message)

    return sending


async def _refuse(scope: Scope, receive: Receive, send: Send, why: str) -> None:
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.close", "code": _FORBIDDEN, "reason": why[:120]})
        return
    response = PlainTextResponse(f"refused: {why}\n", 403)
    await response(scope, receive, _with_headers(send, "localhost"))
