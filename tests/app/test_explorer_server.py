"""Who the explorer's server lets in, and what it lets out."""

from __future__ import annotations

import dataclasses
import gzip
import re
import socket
from pathlib import Path

import numpy as np
import pytest
from support.explorer_server import Page, connect_socket, fetch, format_cookie, serve
from support.maps import random_rooms
from websockets.exceptions import ConnectionClosed, InvalidStatus

import locplan
from locplan.app.explorer.explorer import opened
from locplan.app.explorer.scene import Limits, Opening
from locplan.errors import LocplanError
from locplan.field import FieldConfig
from locplan.maps import OccupancyGrid

STATIC = Path(locplan.app.explorer.__file__).parent / "static"
CONFIG = FieldConfig(locplan.Sad(range=1.0), stride=0.4)
GRID = OccupancyGrid(random_rooms((30, 40), 2), 0.1, (0.0, 0.0, 0.2), "room")


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    with serve(GRID, CONFIG, cache_dir=tmp_path_factory.mktemp("cache")) as server:
        yield server


@pytest.fixture(scope="module")
def framed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cache")
    with serve(GRID, CONFIG, cache_dir=folder, framed=True) as server:
        yield server


def test_the_server_listens_on_this_machine_alone(server):
    with socket.create_connection(("127.0.0.1", server.port)):
        pass
    with pytest.raises(OSError):  # noqa: PT011  # another address of this machine
        socket.create_connection(("127.0.0.2", server.port), timeout=5)
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        with pytest.raises(LocplanError, match="cannot be used") as told:
            opened(GRID, Opening(CONFIG), port=other.getsockname()[1])
    assert "\n" not in str(told.value)


def test_the_token_becomes_a_cookie_and_leaves_the_address(server):
    status, headers, _ = fetch(server, f"/?token={server.token}", cookie=False)
    assert (status, headers["location"]) == (303, "/")
    name, value, *rules = (
        headers["set-cookie"].split("; ")[0].split("=") + headers["set-cookie"].split("; ")[1:]
    )
    assert (name, value) == (f"locplan-{server.port}", server.token)
    assert set(rules) == {"HttpOnly", "SameSite=Strict", "Path=/"}
    assert headers["referrer-policy"] == "no-referrer"
    assert fetch(server, "/about", cookie=f"{name}={value}")[0] == 200
    assert server.address == f"http://127.0.0.1:{server.port}/?token={server.token}"
    assert len(server.token) >= 40


@pytest.mark.parametrize("path", ["/", "/about", "/static/index.html", "/nothing", "/data/cells/0"])
def test_nobody_comes_in_without_the_token(server, path):
    token, port = server.token, server.port
    wrong = (
        *("", token[:-1], f"{token}x", token.swapcase(), "é"),
        *(f"{token}, {token}", " ", "0"),
    )
    cookies = [False, *(f"locplan-{port}={each}" for each in wrong)]
    cookies += [f"locplan-{port + 1}={token}", f"locplan={token}", token, "=;=;;"]
    for cookie in cookies:
        cookie = cookie.encode("utf-8").decode("latin-1") if cookie else cookie
        assert fetch(server, path, cookie=cookie)[0] == 403, cookie
    for query in wrong[:5]:
        address = f"/?token={query}".encode("ascii", "replace").decode().replace(" ", "%20")
        assert fetch(server, address, cookie=False)[0] == 403
    assert fetch(server, f"/about?token={token}", cookie=False)[0] == 403


@pytest.mark.parametrize(
    "host", ["evil.example", "127.0.0.1", "127.0.0.1:1", "localhost", "", "[::1]"]
)
def test_other_hosts_are_refused(server, host):
    for path in ("/", f"/?token={server.token}"):
        named = host if ":" in host or not host else f"{host}"
        assert fetch(server, path, Host=named)[0] == 400
        assert fetch(server, path, Host=f"{host}.evil.example:{server.port}")[0] == 400
    assert fetch(server, "/", Host=None)[0] == 400
    assert fetch(server, "/", Host=f"localhost:{server.port}")[0] == 200


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "", "https://127.0.0.1:{}", "http://127.0.0.1:1"]
)
def test_other_origins_are_refused(server, origin):
    origin = origin.format(server.port)
    assert fetch(server, "/about", Origin=origin)[0] == 403
    with pytest.raises(InvalidStatus, match="403"):
        connect_socket(server, origin=origin)
    assert fetch(server, "/about", Origin=f"http://localhost:{server.port}")[0] == 200


def test_a_socket_needs_an_origin_and_the_cookie(server):
    for headers in (
        {"origin": None},
        {"cookie": None},
        {"cookie": f"locplan-{server.port}=wrong"},
        {"path": "/about"},
        {"path": "/socket/x"},
    ):
        with pytest.raises(InvalidStatus):
            connect_socket(server, **headers)
    with connect_socket(server, origin=f"http://localhost:{server.port}") as link:
        assert Page(link).state["event"] == "state"


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH", "OPTIONS", "TRACE", "X"])
def test_the_server_is_only_read_from(server, method):
    for path in ("/", "/about", f"/?token={server.token}"):
        status, headers, _ = fetch(server, path, method)
        assert status == 405
        assert headers["allow"] == "GET, HEAD"
        assert "set-cookie" not in headers


@pytest.mark.parametrize(
    "path",
    [
        *("/static/../_server.py", "/static/..%2f_server.py", "/static/%2e%2e/_guard.py"),
        *("/static/..", "/static/", "/static/.hidden", "/static//etc/passwd", "/static/%00"),
        *(
            "/static/x/../../_server.py",
            "//etc/passwd",
            "/static/_server.py",
            "/static/index.html/",
        ),
        *(
            "/download/../about",
            "/download/x",
            "/data/cells/../../about",
            "/data/cells/" + "0" * 64,
        ),
        *(
            "/data/layer/x/sigma",
            "/data/drive/0",
            "/data/drive/-1",
            "/data/drive/" + "9" * 5000,
        ),
        *("/static/" + "a" * 3000, "/static/\\..\\_server.py", "/socket"),
    ],
)
def test_nothing_but_its_own_files_is_found(server, path):
    status, _, content = fetch(server, path)
    assert status in (400, 404)
    assert b"import" not in content
    assert b"root:" not in content


def test_every_answer_tells_browsers_what_not_to_do(server):
    for path, cookie in (("/", True), ("/about", True), ("/x", True), ("/", False)):
        _, headers, _ = fetch(server, path, cookie=cookie)
        policy = headers["content-security-policy"]
        assert "default-src 'none'" in policy
        assert "frame-ancestors 'none'" in policy
        assert "unsafe" not in policy
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["referrer-policy"] == "no-referrer"
        assert "server" not in headers
    assert fetch(server, "/x", Host="evil.example")[1]["x-content-type-options"] == "nosniff"


def test_the_page_has_nothing_that_the_policy_forbids(server):
    _, _, page = fetch(server, "/")
    text = page.decode()
    assert not re.search(r"<script(?![^>]*\ssrc=)", text)
    assert not re.search(r"\sstyle=|<style|\son[a-z]+=|javascript:", text)
    for address in re.findall(r"(?:src|href)=\"([^\"]+)\"", text):
        assert not address.startswith(("http", "/", "//")), address
        assert fetch(server, f"/{address}")[0] == 200


def test_files_of_the_page_are_sent_once(server):
    _, headers, content = fetch(server, "/static/index.html")
    status, _, again = fetch(server, "/static/index.html", If_None_Match=headers["etag"])
    assert (status, again) == (304, b"")
    assert fetch(server, "/static/index.html", If_None_Match='"other"')[2] == content
    assert headers["content-type"].startswith("text/html")


@pytest.mark.parametrize("accepted", ["gzip", "br, GZIP;q=0.5", "deflate, gzip; q=1.0"])
def test_files_are_packed_where_the_browser_takes_that(server, accepted):
    _, plain, content = fetch(server, "/static/main.js")
    _, headers, packed = fetch(server, "/static/main.js", Accept_Encoding=accepted)
    assert headers["content-encoding"] == "gzip"
    assert gzip.decompress(packed) == content
    assert "content-encoding" not in plain
    assert headers["content-type"] == plain["content-type"]
    assert (headers["etag"], headers["vary"]) == (plain["etag"], "accept-encoding")
    tag = {"If_None_Match": headers["etag"], "Accept_Encoding": accepted}
    status, again, nothing = fetch(server, "/static/main.js", **tag)
    assert (status, nothing, again["vary"]) == (304, b"", "accept-encoding")


@pytest.mark.parametrize("accepted", [None, "", "br", "gzip;q=0", "gzip; q=0.000", "gzipped"])
def test_files_are_plain_where_the_browser_takes_nothing_else(server, accepted):
    _, headers, content = fetch(server, "/static/main.js", Accept_Encoding=accepted)
    assert "content-encoding" not in headers
    assert content == (STATIC / "main.js").read_bytes()
    assert headers["vary"] == "accept-encoding"


def test_the_page_is_small_on_the_wire(server):
    files = [each.name for each in STATIC.iterdir()]
    sent = [fetch(server, f"/static/{name}", Accept_Encoding="gzip")[2] for name in files]
    assert sum(map(len, sent)) <= 150_000


def test_cells_and_layers_are_the_sessions(server):
    with connect_socket(server) as link:
        state = Page(link).state
    status, headers, content = fetch(server, f"/data/cells/{state['map']['digest']}")
    assert status == 200
    assert "immutable" in headers["cache-control"]
    cells = np.frombuffer(gzip.decompress(content), np.uint8).reshape(GRID.shape)
    wanted = {0: 2, 127: 0, 254: 1}
    for row in range(GRID.shape[0]):
        for col in range(GRID.shape[1]):
            assert cells[GRID.shape[0] - 1 - row, col] == wanted[GRID.cells[row, col]]
    lattice, digest = state["lattice"], state["field"]["digest"]
    for layer in state["layers"]:
        _, _, content = fetch(server, f"/data/layer/{digest}/{layer['name']}")
        assert len(gzip.decompress(content)) == lattice["rows"] * lattice["cols"]
    assert fetch(server, f"/data/layer/{digest}/nothing")[0] == 404


def test_downloads_are_attachments_with_plain_names(server):
    key = server.session.add_download('x"\r\ny/ä.html', b"<b>hi</b>", "text/html")
    status, headers, content = fetch(server, f"/download/{key}")
    assert (status, content) == (200, b"<b>hi</b>")
    assert headers["content-disposition"] == 'attachment; filename="x___y__.html"'
    assert fetch(server, f"/download/{key[:-1]}")[0] == 404


def test_in_a_frame_the_token_is_in_the_path(framed):
    begin = f"/{framed.token}"
    status, headers, _ = fetch(framed, f"{begin}/", cookie=False)
    assert status == 200
    assert (
        "frame-ancestors http://127.0.0.1:* http://localhost:*"
        in (headers["content-security-policy"])
    )
    assert fetch(framed, f"{begin}/about", cookie=False)[0] == 200
    assert framed.address == f"http://127.0.0.1:{framed.port}{begin}/"
    with connect_socket(framed, path=f"{begin}/socket", cookie=None) as link:
        assert Page(link).state["event"] == "state"
    for path in ("/", "/about", f"{begin}x/about", f"{begin[:-1]}/about", f"/{begin}/about", begin):
        assert fetch(framed, path, cookie=False)[0] == 403, path
    assert fetch(framed, f"{begin}/about", Host="evil.example")[0] == 400
    assert fetch(framed, f"{begin}/about", Origin="http://localhost:8888")[0] == 403


def test_without_a_frame_the_path_is_no_key(server):
    assert fetch(server, f"/{server.token}/about", cookie=False)[0] == 403


def test_too_long_messages_close_the_socket(server):
    with connect_socket(server) as link:
        page = Page(link)
        link.send('{"do":"at","id":1,"x":0,"y":0,"z":"' + "x" * 199_000 + '"}')
        assert page.wait(1)["known"] in (True, False)
        link.send("x" * 200_001)
        with pytest.raises(ConnectionClosed):
            page.wait(2)
    assert format_cookie(server)
    with connect_socket(server) as link:
        assert "x" in Page(link).ask("at", x=1.0, y=1.0)


def test_pages_are_bounded(server, monkeypatch):
    limited = dataclasses.replace(server.session.opening, limits=Limits(pages=2))
    monkeypatch.setattr(server.session, "opening", limited)
    with connect_socket(server) as one, connect_socket(server) as other:
        Page(one), Page(other)
        with pytest.raises(InvalidStatus):
            connect_socket(server)
