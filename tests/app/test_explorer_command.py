"""`locplan explore` and `locplan.explore`: how the page is opened, and how it ends."""

from __future__ import annotations

import http.client
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace

import numpy as np
import pytest
from support.command_line import TERMINAL_CODE, check_refusal
from support.machine import TIMEOUT
from support.maps import random_rooms

import locplan
from locplan._support import public
from locplan.app.explorer.explorer import Explorer
from locplan.app.explorer.state import describe_state
from locplan.errors import LocplanError
from locplan.maps import FREE, OCCUPIED, OccupancyGrid

ARGUMENTS = ("--stride", "0.4", "--no-browser")


@contextmanager
def killed_at_last(process: subprocess.Popen) -> Iterator[None]:
    """A process that does not end by itself is not waited for."""
    try:
        yield
    finally:
        process.kill()


def room() -> OccupancyGrid:
    cells = random_rooms((40, 50), 2)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    return OccupancyGrid(cells, 0.1, (-1.0, 0.0, 0.0), "room")


def port_of(page: Explorer) -> int:
    return int(page.address.removeprefix("http://127.0.0.1:").partition("/")[0])


@pytest.fixture
def map_file(tmp_path):
    locplan.save_map(room(), tmp_path / "room.yaml")
    return tmp_path / "room.yaml"


@pytest.mark.skipif(sys.platform == "win32", reason="Windows sends no SIGINT")
def test_explore_serves_until_interrupt(map_file):
    command = [sys.executable, "-c", TERMINAL_CODE, "explore", str(map_file), *ARGUMENTS]
    with (
        subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env={**os.environ}
        ) as process,
        killed_at_last(process),
    ):
        address = process.stdout.readline().strip()
        begin, secret, _ = address.rsplit("/", 2)
        port = int(begin.rpartition(":")[2])
        assert begin == f"http://127.0.0.1:{port}"
        link = http.client.HTTPConnection("127.0.0.1", port, timeout=TIMEOUT)
        link.request("GET", f"/{secret}/about")
        response = link.getresponse()
        assert response.read()
        assert response.status == 200
        link.close()
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=TIMEOUT)
    assert process.returncode == 130
    assert out == ""
    assert err.splitlines() == [
        "locplan: open the address above in a browser on this machine. Stop with Ctrl-C",
        "locplan: interrupted",
    ]


def test_explore_passes_options_to_session(run, map_file, monkeypatch, tmp_path, small_field):
    seen = {}
    monkeypatch.setattr(Explorer, "wait", lambda self: seen.update(page=self))
    monkeypatch.setattr(Explorer, "open", lambda self: seen.update(open=True))
    given = ["--set=footprint=0.1", "--set=margin=0", "--set=alpha1=0.05", f"--field={small_field}"]
    given += ["--start=1,2", "--goal=3,2", "--via=-0.5,2", "--weight=7"]
    given += ["--threads=1", "--force", "-o", tmp_path / "out"]
    zones = locplan.Zones([locplan.Zone("slow", [[1, 1], [2, 1], [2, 2]], 30)])
    zones.save(tmp_path / "zones.geojson")
    given += ["--zones", tmp_path / "zones.geojson"]
    code, out, err = run("explore", map_file, *given)
    assert code == 0
    assert err.startswith("locplan: the page opens in your browser. If not, open the address")
    session = seen["page"].session
    assert out == f"{seen['page'].address}\n"
    assert seen["open"]
    assert session.original.config.estimator.range == 1.0
    assert describe_state(session)["default_weight"] == 7
    assert session.scene.site.robot.radius == 0.1
    assert (session.opening.start, session.opening.goal) == ((1.0, 2.0), (3.0, 2.0))
    assert session.opening.via == ((-0.5, 2.0),)
    assert session.scene.site.robot.filter.alpha1 == 0.05
    assert session.opening.folder == tmp_path / "out"
    assert session.opening.force
    assert session.scene.site.zones == zones
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "fault"),
    [
        (("--port", "70000"), "port must be"),
        (("--port", "80.5"), "--port must be a whole number"),
        (("--json",), "--json has no effect in explore"),
        (("--start", "1"), "--start must be"),
        (("--set", "footprint=40"), "a robot of radius 40.05 m fits nowhere on this map"),
        (("--start", "400,120"), "start 400,120 lies outside the map, which reaches from"),
        (("--goal", "400,120"), "goal 400,120 lies outside the map"),
        (("--via", "1,2", "--via", "1,-9"), "waypoint 2 1,-9 lies outside the map"),
        (("--weight", "-1"), "weight must be"),
        (("--zones", "nowhere.geojson"), "nowhere.geojson"),
        (("--lidar", "x"), "--lidar must be one of"),
    ],
)
def test_explore_refuses_wrong_options(run, map_file, arguments, fault):
    assert fault in check_refusal(run("explore", map_file, *ARGUMENTS, *arguments))


def test_explore_names_missing_extra(run, map_file, monkeypatch):
    monkeypatch.setattr(public, "find_spec", lambda name: None if name == "uvicorn" else True)
    err = check_refusal(run("explore", map_file, *ARGUMENTS))
    assert "the explorer needs uvicorn: pip install 'locplan[explore]'" in err
    with pytest.raises(LocplanError, match=r"locplan\[explore\]"):
        locplan.explore(room(), open_browser=False)


def test_explore_in_python_shows_computed_field():
    field = locplan.covariance_field(
        room(), locplan.FieldConfig(locplan.Sad(range=1.0), stride=0.4)
    )
    robot = locplan.Robot("lds-01", footprint=0.1)
    with locplan.explore(room(), field, robot, open_browser=False) as page:
        page.session.wait()
        assert page.session.scene.site.robot == robot
        assert page.field is field
        assert page.grid == room()
        assert page.address in repr(page)
        with pytest.raises(LocplanError, match="port"):
            locplan.explore(room(), port=port_of(page), open_browser=False)
    with pytest.raises(OSError, match="refused"):
        socket.create_connection(("127.0.0.1", port_of(page)))


def test_zones_of_opening_can_be_edited(tmp_path):
    """Masks have a rectangle of cells for each zone."""
    cells = np.full((40, 50), FREE, np.uint8)
    cells[5:9, 10:20] = OCCUPIED
    mask = locplan.Zones.from_mask(OccupancyGrid(cells, 0.1, (-1.0, 0.0, 0.0)))
    prefer = locplan.Zone("prefer", [[0, 0], [2, 0], [2, 2]])
    zones = locplan.Zones([*mask, prefer])
    config = locplan.FieldConfig(locplan.Sad(range=1.0), stride=0.4)
    with locplan.explore(room(), estimator=config, zones=zones, open_browser=False) as page:
        page.session.wait()
        changes = describe_state(page.session)["changes"]
        assert page.session.scene.costs.zones == zones
        basis = page.session.scene.basis
        page.session.answer("change", changes=changes[:1])
        assert page.session.scene.costs.zones == mask
        page.session.answer("change", changes=changes)
        assert page.session.scene.basis == basis
        page.session.answer("change", changes=[])
        assert not page.session.scene.costs.zones


def test_zones_of_opening_are_checked():
    far = locplan.Zone("no-go", [[100, 100], [101, 100], [101, 101]])
    near = locplan.Zone("no-go", [[1, 1], [2, 1], [2, 2]])
    faults = {
        "no zone overlaps": [far],
        "1,501 zones with 4,503 corners are too many": [near] * 1501,
    }
    for fault, zones in faults.items():
        with pytest.raises(LocplanError, match=fault):
            locplan.explore(room(), zones=locplan.Zones(zones), open_browser=False)


def test_explore_chooses_estimator_by_lidar(monkeypatch):
    addresses = []
    monkeypatch.setattr("webbrowser.open", addresses.append)
    monkeypatch.setattr("locplan.app.explorer.session.Session.prepare", lambda session: None)
    begun = "locplan.app.explorer.session.Session.begin"
    monkeypatch.setattr(begun, lambda *_: None)
    lidar = locplan.Lidar(range=3.0, beams=20)
    with locplan.explore(room(), robot=locplan.Robot(lidar)) as page:
        assert page.session.original.config.estimator == locplan.Fused(lidar)
        assert page.session.scene.site.robot.lidar == lidar
        assert addresses == [page.address]
    with locplan.explore(room(), open_browser=False) as page:
        assert page.session.original.config.estimator == locplan.Sad()
        assert page.session.original.named_robot.lidar is None
    with pytest.raises(LocplanError, match="grid must be"):
        locplan.explore(np.zeros((3, 3)))
    with pytest.raises(LocplanError, match="robot must be"):
        locplan.explore(room(), robot="turtlebot4")


def test_notebook_shows_page_in_frame(monkeypatch):
    shell = SimpleNamespace(kernel=object())
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: shell))
    monkeypatch.setattr("locplan.app.explorer.session.Session.prepare", lambda session: None)
    monkeypatch.setattr("webbrowser.open", lambda _: pytest.fail("a browser was opened"))
    monkeypatch.setattr("locplan.app.explorer.session.Session.begin", lambda *_: None)
    with locplan.explore(room()) as page:
        assert f'src="{page.address}"' in page._repr_html_()
