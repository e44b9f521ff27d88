"""The explorer on a check's report, with faults and the mended map, and with the outline."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys

import numpy as np
import pytest
from support.command_line import check_refusal
from support.explorer_page import browser_file, serve
from support.explorer_views import ask_session
from support.maps import blocks

import locplan
from locplan.app.explorer.check_reports import CheckReport
from locplan.app.explorer.explorer import Explorer
from locplan.app.explorer.scene import Opening
from locplan.app.explorer.session import Session
from locplan.errors import LocplanError
from locplan.field import FieldConfig, Fisher, load_or_compute
from locplan.maps import hollowed, load_map, save_map
from locplan.robots import Footprint, Kinematics, Lidar, Robot

pytest.importorskip("starlette", reason="the explorer's server is not installed")
in_browser = pytest.mark.skipif(browser_file() is None, reason="no chromium on this machine")
LONG = Footprint(np.array([(0.6, 0.3), (-0.4, 0.3), (-0.4, -0.3), (0.6, -0.3)]))
CAR = Robot(
    Lidar(range=6.0),
    footprint=LONG,
    margin=0.0,
    kinematics=Kinematics(drive="car-like", turning_radius=0.8),
)
ROBOT = Robot(Lidar(range=6.0, beams=120))


def config_of(robot: Robot) -> FieldConfig:
    return FieldConfig(Fisher(robot.known_lidar), stride=0.8)


@pytest.fixture(scope="module")
def checked(tmp_path_factory):
    """The folder of a check on a solid map, as the command writes it."""
    folder = tmp_path_factory.mktemp("checked")
    save_map(blocks(), folder / "blocks.yaml")
    (folder / "stations.csv").write_text("name,x,y\na,14.05,15.05\nb,16.35,2.95\nc,18.7,8.7\n")
    words = ["check", folder / "blocks.yaml", "--effort=quick", "-o", folder / "report"]
    words += ["--set=range=6", "--set=beams=120", "--stations", folder / "stations.csv"]
    words += ["--set=min_particles=200", "--set=max_particles=400"]
    subprocess.run([sys.executable, "-m", "locplan", *map(str, words)], check=True)
    return folder / "report"


def session_on(folder) -> Session:
    report = CheckReport.read(folder)
    grid, config = load_map(report.map_file), config_of(report.robot)
    session = Session(grid, Opening(config, report.robot, report=report))
    session.begin(load_or_compute(grid, config)).result()
    return session


def test_report_is_read_with_routes_and_fixes(checked):
    told = ask_session(session_on(checked), "checked")
    about = json.loads((checked / "check.json").read_text())
    assert [each["letter"] for each in told["spots"]] == [
        each["letter"] for each in about["weak_spots"]
    ]
    assert told["recommended"] == about["recommended"]
    assert about["recommended"][0] == "map"
    assert told["next"] == about["next"]["sentence"]
    assert [each["title"] for each in told["fixes"]] == [each["title"] for each in about["fixes"]]
    for route, each in zip(told["routes"], about["routes"], strict=True):
        assert np.allclose(
            [route["xy"][0], route["xy"][-1]], [each["start"], each["goal"]], atol=1e-3
        )
        assert locplan.Path(route["xy"]).length == pytest.approx(each["length"], abs=0.01)
    assert CheckReport.read(checked).robot.known_lidar.range == 6.0


def test_page_begins_with_route_that_fails_most(checked, run, monkeypatch):
    seen = {}
    monkeypatch.setattr(Explorer, "wait", lambda self: seen.update(session=self.session))
    code, _, err = run("explore", "--check", checked, "--no-browser", "--stride", "0.8")
    assert code == 0, err
    session = seen["session"]
    worst = session.opening.report.about["routes"][0]
    assert session.opening.start == tuple(worst["start"])
    assert session.opening.goal == tuple(worst["goal"])
    assert session.robot.known_lidar.range == 6.0
    assert session.original == load_map(checked.parent / "blocks.yaml")


def test_a_path_that_the_check_recommends_is_shown(checked, tmp_path):
    shutil.copytree(checked.parent, tmp_path / "copy")
    folder = tmp_path / "copy" / "report"
    about = json.loads((folder / "check.json").read_text())
    (folder / "check.json").write_text(json.dumps(about | {"recommended": ["paths"]}))
    route = about["routes"][0]
    path = locplan.Path([route["start"], [1.0, 2.0], route["goal"]])
    path.save(folder / f"{route['name'].replace(' ', '-')}.csv")
    first, *others = ask_session(session_on(folder), "checked")["routes"]
    assert np.allclose(first["chosen"], path.xy, atol=1e-3)
    assert all(each["chosen"] is None for each in others)


@pytest.mark.parametrize(
    ("damage", "fault"),
    [
        (lambda folder: (folder / "check.json").unlink(), "has no check.json; name the folder"),
        (lambda folder: (folder / "run.yaml").unlink(), "has no run.yaml; name the folder"),
        (lambda folder: (folder / "check.json").write_text("[1]"), "is damaged, or of another"),
        (lambda folder: (folder / "check.json").write_text('{"robot": {}}'), "is damaged"),
        (lambda folder: (folder / "run.yaml").write_text("kind: robot"), "is damaged"),
        (lambda folder: (folder.parent / "blocks.yaml").unlink(), "there is no such file"),
        (
            lambda folder: save_map(hollowed(blocks()), folder.parent / "blocks.yaml"),
            "has changed since",
        ),
    ],
)
def test_a_bad_report_gets_one_line(checked, tmp_path, run, damage, fault):
    shutil.copytree(checked.parent, tmp_path / "copy")
    damage(tmp_path / "copy" / "report")
    err = check_refusal(run("explore", "--check", tmp_path / "copy" / "report", "--no-browser"))
    assert fault in err


@pytest.mark.parametrize(
    ("arguments", "fault"),
    [
        (("lab.yaml", "--check", "report"), "--check names the map itself"),
        ((), "name a map, or with --check the folder"),
        (("--check", "report", "--lidar", "lds-01"), "--lidar is not read with --check"),
        (("--check", "nowhere"), "nowhere: has no check.json"),
    ],
)
def test_a_map_or_a_report_is_named_and_not_both(run, arguments, fault):
    assert fault in check_refusal(run("explore", *arguments))


# The page


@in_browser
def test_clicked_route_becomes_start_and_goal(visit, checked):
    report = CheckReport.read(checked)
    grid, config = load_map(report.map_file), config_of(report.robot)
    field = load_or_compute(grid, config)
    with serve(grid, field, robot=report.robot, report=report, **report.ends) as explorer:
        seen = visit(explorer.address)
        seen.wait("#checked-group", "visible")
        assert seen.text("#checked-next") == " ".join(report.about["next"]["sentence"].split())
        assert seen.text("#checked-fixes tr.chosen >> nth=0").startswith(
            report.about["fixes"][0]["title"]
        )
        other = min(report.about["routes"], key=lambda each: each["lost"][0])
        seen.page.locator("#checked-routes button", has_text=other["name"]).click()
        seen.wait(f'.checked-route[aria-pressed="true"]:text-is("{other["name"]}")')
        assert seen.place("start") == pytest.approx(other["start"], abs=0.02)
        assert seen.place("goal") == pytest.approx(other["goal"], abs=0.02)
        assert seen.has_drawn(BROWN) == any(each["letter"] for each in report.about["weak_spots"])


BROWN = (122, 59, 0)
"""Colour of a weak spot's letter."""


def test_a_report_without_a_path_says_what_is_wrong(tmp_path):
    with pytest.raises(LocplanError, match=r"has no check\.json"):
        CheckReport.read(tmp_path)
