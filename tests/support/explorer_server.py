"""A server of the explorer for tests, and a client that speaks to it plainly."""

from __future__ import annotations

import http.client
import json
import re
from contextlib import contextmanager

from websockets.sync.client import ClientConnection, connect

from locplan.app.explorer.explorer import Explorer, opened
from locplan.app.explorer.scene import Opening
from support.machine import TIMEOUT


class Server:
    """A running explorer, with the parts of its address."""

    def __init__(self, explorer: Explorer) -> None:
        self.session, self.address = explorer.session, explorer.address
        found = re.fullmatch(r"http://127\.0\.0\.1:(\d+)/(?:\?token=)?([^/]+)/?", self.address)
        self.port, self.token = int(found.group(1)), found.group(2)


@contextmanager
def serve(grid, config, *, framed=False, **opening):
    """A server whose field is there."""
    with opened(grid, Opening(config, **opening), framed=framed) as explorer:
        explorer.session.latest.result()
        yield Server(explorer)


def fetch(server: Server, path: str, method: str = "GET", *, cookie=True, **headers):
    """Status, headers by lower-case name, and content of a response."""
    link = http.client.HTTPConnection("127.0.0.1", server.port, timeout=TIMEOUT)
    sent = {"Host": f"127.0.0.1:{server.port}"}
    if cookie:
        sent["Cookie"] = format_cookie(server) if cookie is True else cookie
    sent |= {name.replace("_", "-"): value for name, value in headers.items()}
    link.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
    for name, value in sent.items():
        if value is not None:
            link.putheader(name, value)
    link.endheaders()
    response = link.getresponse()
    content = response.read()
    link.close()
    found: dict[str, str] = {}
    for name, value in response.getheaders():
        found[name.lower()] = value
    return response.status, found, content


def format_cookie(server: Server) -> str:
    return f"other=1; locplan-{server.port}={server.token}; third=x"


def connect_socket(server: Server, path: str = "/socket", **headers) -> ClientConnection:
    """A socket of the page; a header of None is left out."""
    origin = headers.pop("origin", f"http://127.0.0.1:{server.port}")
    cookie = headers.pop("cookie", format_cookie(server))
    sent = {} if cookie is None else {"Cookie": cookie}
    host = headers.pop("host", None)
    address = f"ws://{host or '127.0.0.1'}:{server.port}{path}"
    return connect(
        address,
        origin=origin,
        additional_headers=sent,
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
        """The answer to a question; what comes before it is kept."""
        while True:
            told = self._read()
            if "re" in told and told["re"] == number:
                return told
            self.events.append(told)
            if told.get("event") == "state":
                self.state = told

    def ask(self, do: str, **values):
        return self.wait(self.send(do, **values))

    def state_when(self, true):
        """The first state that fulfils a condition."""
        while not true(self.state):
            told = self._read()
            if told.get("event") == "state":
                self.state = told
        return self.state
