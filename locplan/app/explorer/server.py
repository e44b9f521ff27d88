"""The server of the page: its addresses, its thread, and who may come in."""

from __future__ import annotations

import gzip
import hashlib
import hmac
import logging
import os
import re
import secrets
import socket
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, get_args

import numpy as np
from starlette.applications import Starlette
from starlette.requests import HTTPConnection, Request
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket

from locplan.app.explorer.questions import Lane
from locplan.app.explorer.requests import MAX_MESSAGE
from locplan.app.explorer.session import Session
from locplan.app.explorer.socket import Link
from locplan.app.explorer.state import cells_of
from locplan.errors import ConfigError

if TYPE_CHECKING:
    import uvicorn

KINDS = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".svg": "image/svg+xml",
}
"""Kinds of the files that the page is made of; the system's own table may call scripts text."""


@dataclass(frozen=True)
class Guard:
    """Let in only those who know the token, from pages of this server, by its own name.

    The token comes once in the address, and is a cookie from then on. In a notebook, whose frames
    get no cookies, it is the first part of every path instead.
    """

    app: ASGIApp
    """The server's own routes."""
    port: int
    """Port of the server, which every name must have."""
    token: str
    """The secret."""
    framed: bool = False
    """True lets pages of this machine, as notebooks are, show the page in a frame."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on a request that is allowed, and answer any other."""
        link, inner = HTTPConnection(scope), self._unframed(scope)
        # A server on another port of this machine has a cookie of another name.
        known = inner is not None or self._is_token(link.cookies.get(f"locplan-{self.port}", ""))
        response = self._refusal(link) or self._entry(link)
        if response is None and not known:
            response = _refused(403, "open the address that locplan has printed")

        async def sealed(message: Message) -> None:
            """Add to every response what browsers are not to do."""
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", []), *self._rules]
            await send(message)

        if response is not None and scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})  # it breaks the rules
        else:
            await (response or self.app)(inner or scope, receive, sealed)

    @property
    def _names(self) -> list[str]:
        """Names of this machine for itself, with the port."""
        return [f"127.0.0.1:{self.port}", f"localhost:{self.port}"]

    def _refusal(self, link: HTTPConnection) -> Response | None:
        """The answer to a request that is refused whoever sends it; None for others."""
        hosts, origins = link.headers.getlist("host"), link.headers.getlist("origin")
        if len(hosts) != 1 or hosts[0] not in self._names:
            return _refused(400, "this server answers to 127.0.0.1 only")
        own = [[f"http://{name}"] for name in self._names]
        if origins not in (own if link.scope["type"] == "websocket" else [[], *own]):
            return _refused(403, "this server answers its own page only")
        if link.scope.get("method", "GET") not in ("GET", "HEAD"):
            return _refused(405, "this server is only read from", {"allow": "GET, HEAD"})
        return None

    def _entry(self, link: HTTPConnection) -> Response | None:
        """Turn the token in the address into a cookie, and lead to the address without it."""
        scope, given = link.scope, link.query_params.get("token", "")
        if self.framed or (scope["type"], scope["path"]) != ("http", "/"):
            return None
        if not self._is_token(given):
            return None
        cookie = f"locplan-{self.port}={self.token}; HttpOnly; SameSite=Strict; Path=/"
        return Response(status_code=303, headers={"location": "/", "set-cookie": cookie})

    def _is_token(self, given: str) -> bool:
        return hmac.compare_digest(given.encode("utf-8", "replace"), self.token.encode())

    def _unframed(self, scope: Scope) -> Scope | None:
        """The request without the token that its path begins with; None without it."""
        first, slash, rest = scope["path"].removeprefix("/").partition("/")
        if not (self.framed and slash and self._is_token(first)):
            return None
        return {**scope, "path": f"/{rest}", "raw_path": f"/{rest}".encode()}

    @property
    def _rules(self) -> list[tuple[bytes, bytes]]:
        sockets = " ".join(f"ws://{name}" for name in self._names)
        frames = "http://127.0.0.1:* http://localhost:*" if self.framed else "'none'"
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


class Server:
    """A session's server on this machine. It runs in a thread of its own."""

    def __init__(self, session: Session, port: int = 0, *, framed: bool = False) -> None:
        self.session = session
        self.lanes = {name: ThreadPoolExecutor(1, f"explorer-{name}") for name in get_args(Lane)}
        self._listening = _listening(port)
        self.port = int(self._listening.getsockname()[1])
        self.token = secrets.token_urlsafe(32)
        self.app = Guard(self._routes(), self.port, self.token, framed=framed)
        self._server: uvicorn.Server | None = None
        self._thread = threading.Thread(target=self._serve, name="explorer", daemon=True)
        self.framed = framed

    @property
    def address(self) -> str:
        """Address to open, with the token."""
        begin = f"http://127.0.0.1:{self.port}"
        return f"{begin}/{self.token}/" if self.framed else f"{begin}/?token={self.token}"

    def start(self) -> None:
        """Begin to answer. Since the socket listens already, no request is lost."""
        import uvicorn

        config = uvicorn.Config(
            self.app,
            log_config=None,
            access_log=False,
            server_header=False,
            lifespan="off",
            ws="websockets-sansio",
            ws_max_size=MAX_MESSAGE,
            ws_per_message_deflate=False,
            timeout_graceful_shutdown=1,
            h11_max_incomplete_event_size=32_768,
        )
        logging.getLogger("uvicorn.error").setLevel(logging.CRITICAL)
        self._server = uvicorn.Server(config)
        self._thread.start()

    def wait(self) -> None:
        """Wait until the server ends."""
        while self._thread.is_alive():
            self._thread.join(0.5)  # in parts, so that Ctrl-C gets through on every system

    def stop(self) -> None:
        """End the server."""
        self.session.close()
        for lane in self.lanes.values():  # what waits is dropped
            lane.shutdown(wait=False, cancel_futures=True)
        if self._server is not None:
            self._server.should_exit = True
            self._thread.join(2.0)
        self._listening.close()

    def _serve(self) -> None:
        assert self._server is not None
        self._server.run(sockets=[self._listening])

    def _routes(self) -> Starlette:
        app = Starlette(
            routes=[
                Route("/", self._file),
                Route("/static/{name}", self._file),
                Route("/about", self._about),
                Route("/data/cells/{digest}", self._data),
                Route("/data/layer/{digest}/{name}", self._data),
                Route("/download/{key}", self._download),
                WebSocketRoute("/socket", self._socket),
            ]
        )
        app.router.redirect_slashes = False
        return app

    async def _file(self, request: Request) -> Response:
        """A file of the page, as the browser may have it already."""
        name = request.path_params.get("name", "index.html")
        files = {each.name: each for each in (Path(__file__).parent / "static").iterdir()}
        if name not in files or files[name].suffix not in KINDS:
            return _missing()
        content = files[name].read_bytes()
        tag = f'W/"{hashlib.sha256(content).hexdigest()[:32]}"'  # weak: packed or not, it is one
        headers = {"etag": tag, "cache-control": "private, no-cache", "vary": "accept-encoding"}
        if request.headers.get("if-none-match") == tag:
            return Response(status_code=304, headers=headers)
        if takes_gzip(request.headers.get("accept-encoding", "")):
            content = _packed_file(content)
            headers["content-encoding"] = "gzip"
        return Response(content, headers=headers, media_type=KINDS[files[name].suffix])

    def _about(self, request: Request) -> Response:
        return JSONResponse(self.session.about())

    def _data(self, request: Request) -> Response:
        """Bytes of an array that never changes, packed once: a map's cells, or a layer's steps."""
        digest, name = request.path_params["digest"], request.path_params.get("name", "")
        session, key = self.session, ("packed", digest, name)
        found: bytes | None = session.files.get(key)
        if found is None:
            grid, layer = session.grid, (session.textures(digest) or {}).get(name)
            made = layer and layer.texels
            if not name and digest == grid.digest:
                made = cells_of(grid.cells)
            if made is None:
                return _missing()
            found = gzip.compress(np.ascontiguousarray(made).tobytes(), 3, mtime=0)
            session.files.put(key, found, len(found))
        headers = {"cache-control": "private, max-age=31536000, immutable"}
        headers["content-encoding"] = "gzip"
        return Response(found, headers=headers, media_type="application/octet-stream")

    async def _download(self, request: Request) -> Response:
        found = self.session.download(request.path_params["key"])
        if found is None:
            return _missing()
        plain = re.sub(r"[^A-Za-z0-9._-]", "_", found.name)
        headers = {
            "content-disposition": f'attachment; filename="{plain}"',
            "cache-control": "private, no-store",
        }
        return Response(found.content, headers=headers, media_type=found.media_type)

    async def _socket(self, socket: WebSocket) -> None:
        if len(self.session.listeners) >= self.session.opening.limits.pages:
            await socket.close(1013, "too many pages are open")
            return
        await Link(self.session, self.lanes, socket).run()


def takes_gzip(accepted: str) -> bool:
    """Whether a browser's Accept-Encoding names gzip, and does not refuse it.

    Examples
    --------
    >>> takes_gzip("gzip, deflate, br"), takes_gzip("br"), takes_gzip("gzip;q=0")
    (True, False, False)
    """
    for each in accepted.lower().split(","):
        name, _, quality = each.replace(" ", "").partition(";q=")
        if name == "gzip":
            return quality.strip("0.") != "" or not quality
    return False


@lru_cache(maxsize=100)
def _packed_file(content: bytes) -> bytes:
    """A file of the page, compressed once."""
    return gzip.compress(content, 9, mtime=0)


def _listening(port: int) -> socket.socket:
    """A socket of this machine alone that listens on a port, or on any free one for 0."""
    try:
        return socket.create_server(("127.0.0.1", port), backlog=64)
    except OSError as error:
        reason = os.strerror(error.errno) if error.errno else error
        raise ConfigError(f"port {port} cannot be used ({reason}); choose another one") from None


def _missing() -> Response:
    return Response("there is no such thing here\n", status_code=404, media_type="text/plain")


def _refused(status: int, why: str, headers: dict[str, str] | None = None) -> Response:
    page = f"<!doctype html><title>locplan</title><p>locplan: {why}.</p>\n"
    return HTMLResponse(page, status, headers)
