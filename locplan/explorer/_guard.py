"""The door of the server: who may come in, and what browsers may do with what they get."""

from __future__ import annotations

import hmac
from collections.abc import Awaitable, Callable, MutableMapping
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Any]]
Send = Callable[[Any], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]
LOCAL = ("127.0.0.1", "localhost")
"""Names of this machine for itself."""
CLOSED = 1008
"""Code of a socket that is closed since it breaks the rules."""


@dataclass(frozen=True)
class Guard:
    """Let in only those who know the token, from pages of this server, by its own name.

    The token comes once in the address, and is a cookie from then on. In a notebook, whose frames
    get no cookies, it is the first part of every path instead.
    """

    app: App
    """The server's own routes."""
    port: int
    """Port of the server, which every name must have."""
    token: str
    """The secret."""
    framed: bool = False
    """True lets pages of this machine, as notebooks are, show the page in a frame."""

    @property
    def cookie(self) -> str:
        """Name of the cookie; servers on other ports have others."""
        return f"locplan-{self.port}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on a request that is allowed, and refuse any other."""
        kind = scope["type"]
        if kind == "lifespan":
            await self.app(scope, receive, send)
            return
        headers = [(name.lower(), value.decode("latin-1")) for name, value in scope["headers"]]
        refusal = self._refusal(kind, scope, headers)
        if refusal:
            await self._refuse(kind, refusal, send)
            return
        if kind == "http" and self._is_token(self._asked(scope)) and not self.framed:
            await self._enter(send)
            return
        inner = self._unframed(scope)
        if inner is None and not self._has_cookie(headers):
            await self._refuse(kind, (403, "open the address that locplan has printed"), send)
            return
        await self.app(inner or scope, receive, self._sealed(send))

    def _refusal(
        self, kind: str, scope: Scope, headers: list[tuple[bytes, str]]
    ) -> tuple[int, str] | None:
        """The status and the reason why a request is refused whoever sends it, if it is."""
        hosts = [value for name, value in headers if name == b"host"]
        if len(hosts) != 1 or hosts[0] not in {f"{name}:{self.port}" for name in LOCAL}:
            return 400, "this server answers to 127.0.0.1 only"
        origins = [value for name, value in headers if name == b"origin"]
        own = {f"http://{name}:{self.port}" for name in LOCAL}
        if origins and (len(origins) > 1 or origins[0] not in own):
            return 403, "this server answers its own page only"
        if kind == "websocket" and not origins:
            return 403, "this server answers its own page only"
        if kind == "http" and scope["method"] not in ("GET", "HEAD"):
            return 405, "this server is only read from"
        return None

    def _asked(self, scope: Scope) -> str:
        """The token in an address of the page itself, or an empty text."""
        if scope["path"] != "/":
            return ""
        query = parse_qs(scope["query_string"].decode("latin-1"))
        return str(query.get("token", [""])[0])

    def _is_token(self, given: str) -> bool:
        return hmac.compare_digest(given.encode("utf-8", "replace"), self.token.encode())

    def _has_cookie(self, headers: list[tuple[bytes, str]]) -> bool:
        for text in (value for name, value in headers if name == b"cookie"):
            for each in text.split(";"):
                try:
                    found = SimpleCookie(each.strip()).get(self.cookie)
                except CookieError:  # another server's on this machine, perhaps
                    continue
                if found is not None and self._is_token(found.value):
                    return True
        return False

    def _unframed(self, scope: Scope) -> Scope | None:
        """The request without the token that its path begins with; None without it."""
        first, slash, rest = scope["path"].removeprefix("/").partition("/")
        if not (self.framed and slash and self._is_token(first)):
            return None
        return {**scope, "path": f"/{rest}", "raw_path": f"/{rest}".encode()}

    async def _enter(self, send: Send) -> None:
        """Turn the token in the address into a cookie, and lead to the address without it."""
        cookie = f"{self.cookie}={self.token}; HttpOnly; SameSite=Strict; Path=/"
        headers = [(b"location", b"/"), (b"set-cookie", cookie.encode())]
        await self._answer(send, 303, headers, b"")

    async def _refuse(self, kind: str, refusal: tuple[int, str], send: Send) -> None:
        status, why = refusal
        if kind == "websocket":
            await send({"type": "websocket.close", "code": CLOSED, "reason": why})
            return
        page = f"<!doctype html><title>locplan</title><p>locplan: {why}.</p>\n".encode()
        headers = [(b"content-type", b"text/html; charset=utf-8")]
        headers += [(b"allow", b"GET, HEAD")] if status == 405 else []
        await self._answer(send, status, headers, page)

    async def _answer(
        self, send: Send, status: int, headers: list[tuple[bytes, bytes]], body: bytes
    ) -> None:
        length = (b"content-length", str(len(body)).encode())
        sealed = self._sealed(send)
        start = {"type": "http.response.start", "status": status, "headers": [*headers, length]}
        await sealed(start)
        await send({"type": "http.response.body", "body": body})

    def _sealed(self, send: Send) -> Send:
        """Add to every response what browsers are told not to do."""

        async def sealed(message: Any) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", []), *self._rules]
            await send(message)

        return sealed

    @property
    def _rules(self) -> list[tuple[bytes, bytes]]:
        sockets = " ".join(f"ws://{name}:{self.port}" for name in LOCAL)
        frames = " ".join(f"http://{name}:*" for name in LOCAL) if self.framed else "'none'"
        policy = (
            "default-src 'none'; script-src 'self'; style-src 'self'; font-src 'self';"
            f" img-src 'self' data: blob:; connect-src 'self' {sockets};"
            f" base-uri 'none'; form-action 'none'; frame-ancestors {frames}"
        )
        return [
            (b"content-security-policy", policy.encode()),
            (b"x-content-type-options", b"nosniff"),
            (b"referrer-policy", b"no-referrer"),
            (b"cross-origin-resource-policy", b"same-origin"),
        ]
