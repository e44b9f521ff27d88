"""Server of the page: its addresses, its thread, and its access rules."""

from __future__ import annotations

import gzip
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
from typing import get_args

import numpy as np
import uvicorn
from starlette.applications import Starlette
from starlette.requests import HTTPConnection, Request
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket

from locplan._support.kernels.arrays import Octets
from locplan.app.explorer.layers import make_cell_classes
from locplan.app.explorer.messages import MAX_MESSAGE
from locplan.app.explorer.questions import Lane
from locplan.app.explorer.session import PageDownload, Session
from locplan.app.explorer.socket import PageSocket
from locplan.app.explorer.state import describe_session
from locplan.errors import ConfigError

PAGE = Path(__file__).parent / "page" / "dist"
"""Folder with the files of the page."""
FILE_TYPES = {
    "index.html": "text/html; charset=utf-8",
    "page.js": "text/javascript; charset=utf-8",
    "page.css": "text/css; charset=utf-8",
    "icon.svg": "image/svg+xml",
}
"""Types of these files; the system's table may have wrong ones for scripts."""
GZIP = {"content-encoding": "gzip"}


@dataclass(frozen=True)
class RequestGuard:
    """Filter that allows only requests with the secret, from pages of this server.

    The secret is the first part of every path. Unlike a cookie, it is not sent to other ports of
    this machine, and it works in a notebook's frame.
    """

    app: ASGIApp
    """Application that answers allowed requests."""
    port: int
    """Port of the server, part of every allowed host name."""
    secret: str
    """The secret."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on a request that is allowed, and answer any other."""
        response, inner = self._find_refusal(HTTPConnection(scope)), self._remove_secret(scope)
        if response is None and inner is None:
            response = _make_refusal(403, "open the address that locplan printed")

        async def send_with_security_headers(message: Message) -> None:
            """Add the security headers to a response."""
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", []), *self._security_headers]
            await send(message)

        if response is not None and scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})  # policy violation
        else:
            await (response or self.app)(inner or scope, receive, send_with_security_headers)

    @property
    def _host_names(self) -> list[str]:
        """Host names of this machine, with the port."""
        return [f"127.0.0.1:{self.port}", f"localhost:{self.port}"]

    def _find_refusal(self, link: HTTPConnection) -> Response | None:
        """Return the answer to a request that is refused even with the secret; None if allowed."""
        hosts, origins = link.headers.getlist("host"), link.headers.getlist("origin")
        if len(hosts) != 1 or hosts[0] not in self._host_names:
            return _make_refusal(400, "this server answers only at 127.0.0.1")
        pages = [[f"http://{name}"] for name in self._host_names]
        if origins not in (pages if link.scope["type"] == "websocket" else [[], *pages]):
            return _make_refusal(403, "this server answers only its own page")
        if link.scope.get("method", "GET") not in ("GET", "HEAD"):
            return _make_refusal(405, "this server only allows reading", {"allow": "GET, HEAD"})
        return None

    def _remove_secret(self, scope: Scope) -> Scope | None:
        """Return a request without the secret in its path; None if the secret is wrong."""
        first, slash, rest = scope["path"].removeprefix("/").partition("/")
        is_secret = hmac.compare_digest(first.encode("utf-8", "replace"), self.secret.encode())
        if not (slash and is_secret):
            return None
        return {**scope, "path": f"/{rest}", "raw_path": f"/{rest}".encode()}

    @property
    def _security_headers(self) -> list[tuple[bytes, bytes]]:
        sockets = " ".join(f"ws://{name}" for name in self._host_names)
        policy = (
            "default-src 'none'; script-src 'self'; style-src 'self'; font-src 'self';"
            f" img-src 'self' data: blob:; connect-src 'self' {sockets};"
            " base-uri 'none'; form-action 'none';"
            " frame-ancestors http://127.0.0.1:* http://localhost:*"  # notebooks
        )
        return [
            (b"content-security-policy", policy.encode()),
            (b"x-content-type-options", b"nosniff"),
            (b"referrer-policy", b"no-referrer"),
            (b"cross-origin-resource-policy", b"same-origin"),
        ]


class ExplorerServer:
    """Server of a session on this machine, in a separate thread."""

    def __init__(self, session: Session, port: int = 0) -> None:
        self.session = session
        self.lanes = {name: ThreadPoolExecutor(1, f"explorer-{name}") for name in get_args(Lane)}
        self._listener = _open_listener(port)
        self.port = int(self._listener.getsockname()[1])
        self.secret = secrets.token_urlsafe(32)
        self._server = self._configure(RequestGuard(self._make_routes(), self.port, self.secret))
        self._thread = threading.Thread(
            target=self._server.run, args=([self._listener],), name="explorer", daemon=True
        )

    @property
    def address(self) -> str:
        """Address of the page, with the secret."""
        return f"http://127.0.0.1:{self.port}/{self.secret}/"

    def start(self) -> None:
        """Start to answer. The socket listens already, so no request is lost."""
        logging.getLogger("uvicorn.error").setLevel(logging.CRITICAL)
        self._thread.start()

    def wait(self) -> None:
        """Wait until the server ends."""
        while self._thread.is_alive():
            self._thread.join(0.5)  # in parts, so that Ctrl-C gets through on every system

    def stop(self) -> None:
        """Stop the server."""
        self.session.close()
        for lane in self.lanes.values():  # the waiting questions are dropped
            lane.shutdown(wait=False, cancel_futures=True)
        self._server.should_exit = True
        self._thread.join(2.0)
        self._listener.close()

    def _configure(self, app: ASGIApp) -> uvicorn.Server:
        config = uvicorn.Config(
            app,
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
        return uvicorn.Server(config)

    def _make_routes(self) -> Starlette:
        app = Starlette(
            routes=[
                Route("/", self._answer_file),
                Route("/about", self._answer_description),
                Route("/cells/{digest}", self._answer_cells),
                Route("/layers/{digest}/{name}", self._answer_layer),
                Route("/download/{key}", self._answer_download),
                WebSocketRoute("/socket", self._answer_socket),
                Route("/{name}", self._answer_file),
            ]
        )
        app.router.redirect_slashes = False
        return app

    async def _answer_file(self, request: Request) -> Response:
        """Answer with a file of the page."""
        name = request.path_params.get("name", "index.html")
        if name not in FILE_TYPES:
            return _answer_missing()
        headers = {"cache-control": "private, no-cache"}
        if name == "index.html":  # small, and not only browsers read it
            return Response(
                (PAGE / name).read_bytes(), headers=headers, media_type=FILE_TYPES[name]
            )
        return Response(
            _compress_file(PAGE / name), headers=headers | GZIP, media_type=FILE_TYPES[name]
        )

    def _answer_description(self, request: Request) -> Response:
        return JSONResponse(describe_session(self.session))

    def _answer_cells(self, request: Request) -> Response:
        digest, grid = request.path_params["digest"], self.session.grid
        cells = make_cell_classes(grid.cells) if digest == grid.digest else None
        return self._answer_array(("cells", digest), cells)

    def _answer_layer(self, request: Request) -> Response:
        digest, name = request.path_params["digest"], request.path_params["name"]
        layer = self.session.find_layers(digest).get(name)
        return self._answer_array(("layer", digest, name), layer.texels if layer else None)

    def _answer_array(self, key: tuple[str, ...], octets: Octets | None) -> Response:
        """Answer with an array that never changes; compress it only once."""
        packed: bytes | None = self.session.files.get(key)
        if packed is None:
            if octets is None:  # a newer one is on its way; browsers note each 404 as an error
                return Response(status_code=204)
            packed = gzip.compress(np.ascontiguousarray(octets).tobytes(), 3, mtime=0)
            self.session.files.put(key, packed, len(packed))
        headers = {"cache-control": "private, max-age=31536000, immutable", **GZIP}
        return Response(packed, headers=headers, media_type="application/octet-stream")

    async def _answer_download(self, request: Request) -> Response:
        download: PageDownload | None = self.session.files.get(
            ("download", request.path_params["key"])
        )
        if download is None:
            return _answer_missing()
        name = re.sub(r"[^A-Za-z0-9._-]", "_", download.name)
        headers = {
            "content-disposition": f'attachment; filename="{name}"',
            "cache-control": "private, no-store",
        }
        return Response(download.content, headers=headers, media_type="text/html")

    async def _answer_socket(self, socket: WebSocket) -> None:
        await PageSocket(self.session, self.lanes, socket).run()


@lru_cache
def _compress_file(file: Path) -> bytes:
    """Compress a file of the page, once."""
    return gzip.compress(file.read_bytes(), 9, mtime=0)


def _open_listener(port: int) -> socket.socket:
    """Return a socket that listens on a local port, or on any free one for 0."""
    try:
        return socket.create_server(("127.0.0.1", port), backlog=64)
    except OSError as error:
        reason = os.strerror(error.errno) if error.errno else error
        raise ConfigError(f"port {port} cannot be used ({reason}); choose another port") from None


def _answer_missing() -> Response:
    return Response("not found\n", status_code=404, media_type="text/plain")


def _make_refusal(status: int, reason: str, headers: dict[str, str] | None = None) -> Response:
    page = f"<!doctype html><title>locplan</title><p>locplan: {reason}.</p>\n"
    return HTMLResponse(page, status, headers)
