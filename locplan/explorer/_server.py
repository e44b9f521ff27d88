"""The server of the page: its addresses, and the thread that it runs in."""

from __future__ import annotations

import gzip
import hashlib
import json
import logging
import secrets
import socket
import threading
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket

from locplan.errors import ConfigError, LocplanError
from locplan.explorer._guard import App, Guard
from locplan.explorer._session import Session
from locplan.explorer._socket import Lanes, Link
from locplan.explorer._textures import cells_of, packed
from locplan.explorer._wire import MAX_MESSAGE

if TYPE_CHECKING:
    import uvicorn

STATIC = Path(__file__).parent / "static"
KINDS = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".svg": "image/svg+xml",
}
"""Kinds of the files that the page is made of."""
MAX_PAGES = 20
"""Greatest number of pages that are open at once."""
FOREVER = "private, max-age=31536000, immutable"
PLACEHOLDER = "<!doctype html><title>locplan</title><p>The page is missing.</p>"


class Server:
    """A session's server on this machine. It runs in a thread of its own."""

    def __init__(self, session: Session, port: int = 0, *, framed: bool = False) -> None:
        self.session, self.lanes = session, Lanes()
        self._listening = _listening(port)
        self.port = int(self._listening.getsockname()[1])
        self.token = secrets.token_urlsafe(32)
        self.app: App = Guard(self._routes(), self.port, self.token, framed=framed)
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
        self.session.upkeep.close()
        self.lanes.close()
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
                Route("/", self._index),
                Route("/static/{name}", self._static),
                Route("/about", self._about),
                Route("/data/cells/{digest}", self._cells),
                Route("/data/layer/{digest}/{name}", self._layer),
                Route("/data/drive/{number}", self._drive),
                Route("/download/{key}", self._download),
                WebSocketRoute("/socket", self._socket),
            ]
        )
        app.router.redirect_slashes = False
        return app

    async def _index(self, request: Request) -> Response:
        return self._file(request, "index.html") or Response(PLACEHOLDER, media_type="text/html")

    async def _static(self, request: Request) -> Response:
        return self._file(request, request.path_params["name"]) or _missing()

    def _file(self, request: Request, name: str) -> Response | None:
        """A file of the page, as the browser may have it already; None if there is none."""
        files = {each.name: each for each in STATIC.glob("*") if each.suffix in KINDS}
        if name not in files:
            return None
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

    def _cells(self, request: Request) -> Response:
        digest = request.path_params["digest"]
        found: bytes | None = self.session.files.get(("cells", digest))
        if found is None:
            grid = self.session.grid
            if digest != grid.digest:
                return _missing()
            found = packed(cells_of(grid.cells))
            self.session.files.put(("cells", digest), found, len(found))
        return _data(found)

    def _layer(self, request: Request) -> Response:
        digest, name = request.path_params["digest"], request.path_params["name"]
        key = ("layer", digest, name)
        found: bytes | None = self.session.files.get(key)
        if found is None:
            textures = self.session.textures(digest)
            if textures is None or name not in textures:
                return _missing()
            found = packed(textures[name].texels)
            self.session.files.put(key, found, len(found))
        return _data(found)

    def _drive(self, request: Request) -> Response:
        numbers = [str(number) for number in range(len(self.session.drives))]
        if request.path_params["number"] not in numbers:
            return _missing()
        number = int(request.path_params["number"])
        from locplan.explorer._drives import drive_json

        try:
            shown: Any = drive_json(self.session, number)
        except LocplanError as error:
            return JSONResponse({"error": str(error)}, status_code=409)
        return Response(json.dumps(shown, allow_nan=False), media_type="application/json")

    async def _download(self, request: Request) -> Response:
        found = self.session.download(request.path_params["key"])
        if found is None:
            return _missing()
        plain = "".join(
            c if c.isascii() and (c.isalnum() or c in "-_.") else "_" for c in found.name
        )
        headers = {
            "content-disposition": f'attachment; filename="{plain}"',
            "cache-control": "private, no-store",
        }
        return Response(found.content, headers=headers, media_type=found.media_type)

    async def _socket(self, socket: WebSocket) -> None:
        if len(self.session.listeners) >= MAX_PAGES:
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
    made = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        made.bind(("127.0.0.1", port))
        made.listen(64)
    except (OSError, OverflowError) as error:
        made.close()
        reason = getattr(error, "strerror", None) or error
        raise ConfigError(f"port {port} cannot be used ({reason}); choose another one") from None
    return made


def _data(content: bytes) -> Response:
    headers = {"content-encoding": "gzip", "cache-control": FOREVER}
    return Response(content, headers=headers, media_type="application/octet-stream")


def _missing() -> Response:
    return Response("there is no such thing here\n", status_code=404, media_type="text/plain")
