"""The explorer's server: who comes in, and what goes out."""

from __future__ import annotations

import gzip
import json
import re
import socket

import numpy as np
import pytest
from support.explorer_server import Page, connect_socket, fetch, serve
from support.maps import random_rooms
from websockets.exceptions import ConnectionClosed, InvalidStatus

import locplan
from locplan.app.explorer.explorer import open_explorer
from locplan.app.explorer.messages import MAX_MESSAGE
from locplan.app.explorer.scene import StartSettings
from locplan.app.explorer.server import PAGE
from locplan.errors import LocplanError
from locplan.field import FieldConfig
from locplan.maps import OccupancyGrid

CONFIG = FieldConfig(locplan.Sad(range=1.0), stride=0.4)
GRID = OccupancyGrid(random_rooms((30, 40), 2), 0.1, (0.0, 0.0, 0.2), "room")


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    with serve(GRID, CONFIG, cache_dir=tmp_path_factory.mktemp("cache")) as server:
        yield server


def test_server_listens_on_this_machine_alone(server):
    with socket.create_connection(("127.0.0.1", server.port)):
        pass
    with pytest.raises(OSError):  # noqa: PT011  # another address of this machine
        socket.create_connection(("127.0.0.2", server.port), timeout=5)
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        with pytest.raises(LocplanError, match="cannot be used") as error:
            open_explorer(GRID, StartSettings(CONFIG), port=other.getsockname()[1])
    assert "\n" not in str(error.value)


def test_secret_is_first_part_of_path(server):
    assert server.address == f"http://127.0.0.1:{server.port}/{server.secret}/"
    assert len(server.secret) >= 40
    status, headers, _ = fetch(server, "/about")
    assert status == 200
    assert "set-cookie" not in headers
    assert headers["referrer-policy"] == "no-referrer"


@pytest.mark.parametrize("path", ["/", "/about", "/page.js", "/nothing", "/cells/0"])
def test_wrong_secret_is_refused(server, path):
    secret = server.secret
    for wrong in ("", secret[:-1], f"{secret}x", secret.swapcase(), "%C3%A9", f"/{secret}", "0"):
        assert fetch(server, path, secret=wrong)[0] == 403, wrong
    assert fetch(server, f"{path}?token={secret}", secret="")[0] == 403
    assert fetch(server, path, secret="", Cookie=f"locplan-{server.port}={secret}")[0] == 403
    assert fetch(server, "", secret=secret)[0] == 403  # relative addresses need the slash


@pytest.mark.parametrize(
    "host", ["evil.example", "127.0.0.1", "127.0.0.1:1", "localhost", "", "[::1]"]
)
def test_other_hosts_are_refused(server, host):
    assert fetch(server, "/", Host=host)[0] == 400
    assert fetch(server, "/", Host=f"{host}.evil.example:{server.port}")[0] == 400
    assert fetch(server, "/", Host=None)[0] == 400
    assert fetch(server, "/about", Host=f"localhost:{server.port}")[0] == 200


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "", "https://127.0.0.1:{}", "http://127.0.0.1:1"]
)
def test_other_origins_are_refused(server, origin):
    origin = origin.format(server.port)
    assert fetch(server, "/about", Origin=origin)[0] == 403
    with pytest.raises(InvalidStatus, match="403"):
        connect_socket(server, origin=origin)
    assert fetch(server, "/about", Origin=f"http://localhost:{server.port}")[0] == 200


@pytest.mark.parametrize(
    "wrong", [{"origin": None}, {"secret": "x"}, {"path": "/about"}, {"path": "/socket/x"}]
)
def test_socket_needs_origin_and_secret(server, wrong):
    with pytest.raises(InvalidStatus):
        connect_socket(server, **wrong)
    with connect_socket(server, origin=f"http://localhost:{server.port}") as link:
        assert Page(link).state["event"] == "state"


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH", "OPTIONS", "TRACE", "X"])
def test_server_is_only_read_from(server, method):
    for path in ("/", "/about"):
        status, headers, _ = fetch(server, path, method)
        assert status == 405
        assert headers["allow"] == "GET, HEAD"


@pytest.mark.parametrize(
    "path",
    [
        *("/../server.py", "/..%2fserver.py", "/%2e%2e/session.py", "/..", "/.hidden"),
        *("//etc/passwd", "/%00", "/x/../../server.py", "/server.py", "/index.html/"),
        *("/build.mjs", "/package.json", "/src/main.js", "/dist/page.js"),
        *("/download/../about", "/download/x", "/cells/../../about"),
        *("/layers/x", "/" + "a" * 3000, "/\\..\\server.py", "/socket"),
    ],
)
def test_only_files_of_page_are_served(server, path):
    status, _, content = fetch(server, path)
    assert status in (400, 403, 404)
    assert b"import" not in content
    assert b"root:" not in content


def test_all_answers_have_rules_for_browsers(server):
    for path, secret in (("/", None), ("/about", None), ("/x", None), ("/", "wrong")):
        _, headers, _ = fetch(server, path, secret=secret)
        policy = headers["content-security-policy"]
        assert "default-src 'none'" in policy
        assert "frame-ancestors http://127.0.0.1:* http://localhost:*" in policy
        assert "unsafe" not in policy
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["referrer-policy"] == "no-referrer"
        assert "server" not in headers
    assert fetch(server, "/x", Host="evil.example")[1]["x-content-type-options"] == "nosniff"


def test_page_breaks_no_rule(server):
    _, headers, page = fetch(server, "/")
    assert "content-encoding" not in headers
    text = page.decode()
    assert not re.search(r"<script(?![^>]*\ssrc=)", text)
    assert not re.search(r"\sstyle=|<style|\son[a-z]+=|javascript:", text)
    addresses = re.findall(r"(?:src|href)=\"([^\"]+)\"", text)
    assert {"page.js", "page.css"} <= set(addresses)
    for address in addresses:
        assert fetch(server, f"/{address}")[0] == 200


def test_file_is_packed(server):
    _, headers, packed = fetch(server, "/page.js")
    assert headers["content-encoding"] == "gzip"
    assert gzip.decompress(packed) == (PAGE / "page.js").read_bytes()
    assert headers["content-type"].startswith("text/javascript")


def test_about_names_map_and_choices(server):
    facts = json.loads(fetch(server, "/about")[2])
    assert facts["map"]["name"] == "room"
    assert facts["map"]["origin"] == [0.0, 0.0, 0.2]
    assert not facts["can_export"]
    assert not facts["has_report"]
    assert "jazzy" in facts["distros"]
    assert "turtlebot4" in {lidar["name"] for lidar in facts["lidars"]}


def test_server_sends_cells_and_layers(server):
    with connect_socket(server) as link:
        state = Page(link).state
    status, headers, content = fetch(server, f"/cells/{state['basis']['map']}")
    assert status == 200
    assert "immutable" in headers["cache-control"]
    cells = np.frombuffer(gzip.decompress(content), np.uint8).reshape(GRID.shape)
    wanted = {0: 2, 127: 0, 254: 1}
    for row in range(GRID.shape[0]):
        for col in range(GRID.shape[1]):
            assert cells[GRID.shape[0] - 1 - row, col] == wanted[GRID.cells[row, col]]
    field = state["field"]
    for layer in state["layers"]:
        _, _, content = fetch(server, f"/layers/{field['digest']}/{layer['name']}")
        assert len(gzip.decompress(content)) == field["rows"] * field["cols"]
    assert fetch(server, f"/layers/{field['digest']}/nothing")[0] == 204
    assert fetch(server, "/cells/" + "0" * 64)[0] == 204


def test_download_is_attachment_with_plain_name(server):
    key = server.session.add_download('x"\r\ny/ä.html', b"<b>hi</b>")
    status, headers, content = fetch(server, f"/download/{key}")
    assert (status, content) == (200, b"<b>hi</b>")
    assert headers["content-disposition"] == 'attachment; filename="x___y__.html"'
    assert fetch(server, f"/download/{key[:-1]}")[0] == 404


def test_too_long_message_closes_socket(server):
    with connect_socket(server) as link:
        page = Page(link)
        link.send('{"do":"at","id":1,"x":0,"y":0,"z":"' + "x" * (MAX_MESSAGE - 1000) + '"}')
        assert page.wait(1)["known"] in (True, False)
        link.send("x" * (MAX_MESSAGE + 1))
        with pytest.raises(ConnectionClosed):
            page.wait(2)
    with connect_socket(server) as link:
        assert "x" in Page(link).ask("at", x=1.0, y=1.0)
