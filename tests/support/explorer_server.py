"""A server of the explorer for tests, and a client that speaks to it plainly."""

from __future__ import annotations

import http.client
import json
import re
from contextlib import contextmanager

from websockets.sync.client import ClientConnection, connect

from locplan.app.explorer.explorer import Explorer, open_explorer
from locplan.app.explorer.scene import StartSettings
from support.machine import TIMEOUT


class Server:
    """A running explorer, with the parts of its address."""

    def __init__(self, explorer: Explorer) -> None:
        self.session, self.address = explorer.session, explorer.address
        parts = re.fullmatch(r"http://127\.0\.0\.1:(\d+)/([^/]+)/", self.address)
        self.port, self.secret = int(parts.group(1)), parts.group(2)


@contextmanager
def serve(grid, config, **opening):
    """Yield a server whose field is there."""
    with open_explorer(grid, StartSettings(config, **opening)) as explorer:
        explorer.session.wait()
        yield Server(explorer)


def fetch(server: Server, path: str, method: str = "GET", *, secret: str | None = None, **headers):
    """Return status, headers by lower-case name, and content of a response below the secret."""
    link = http.client.HTTPConnection("127.0.0.1", server.port, timeout=TIMEOUT)
    sent = {"Host": f"127.0.0.1:{server.port}"}
    sent |= {name.replace("_", "-"): value for name, value in headers.items()}
    begin = server.secret if secret is None else secret
    link.putrequest(
        method, f"/{begin}{path}" if begin else path, skip_host=True, skip_accept_encoding=True
    )
    for name, value in sent.items():
        if value is not None:
            link.putheader(name, value)
    link.endheaders()
    response = link.getresponse()
    content = response.read()
    link.close()
    return response.status, {k.lower(): v for k, v in response.getheaders()}, content


def connect_socket(
    server: Server, path: str = "/socket", *, secret: str | None = None, **headers
) -> ClientConnection:
    """Return a socket of the page; a header of None is left out."""
    origin = headers.pop("origin", f"http://127.0.0.1:{server.port}")
    begin = server.secret if secret is None else secret
    return connect(
        f"ws://127.0.0.1:{server.port}/{begin}{path}",
        origin=origin,
        compression=None,
        proxy=None,
        open_timeout=TIMEOUT,
        close_timeout=5,
        max_size=2**24,
    )


class Page:
    """A page that asks one question after the other."""

    def __init__(self, link: ClientConnection) -> None:
        self.link, self.number, self.events = link, 0, []
        self.state = self._read()

    def _read(self):
        return json.loads(self.link.recv(timeout=TIMEOUT))

    def send(self, do: str, **values) -> int:
        self.number += 1
        self.link.send(json.dumps({"do": do, "id": self.number, **values}))
        return self.number

    def wait(self, number: int | None):
        """Return the answer to a question; messages before it are stored."""
        while True:
            message = self._read()
            if "re" in message and message["re"] == number:
                return message
            self.events.append(message)
            if message.get("event") == "state":
                self.state = message

    def ask(self, do: str, **values):
        return self.wait(self.send(do, **values))

    def state_when(self, is_right):
        """Return the first state that fulfils a condition."""
        while not is_right(self.state):
            message = self._read()
            self.events.append(message)
            if message.get("event") == "state":
                self.state = message
        return self.state
