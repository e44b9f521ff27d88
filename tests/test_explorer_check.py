"""The explorer on a check's report, with faults and the mended map, and with the outline."""

from __future__ import annotations

import gzip
import json
import math
import shutil
import subprocess
import sys

import numpy as np
import pytest
from conftest import refused
from explorer_page import browser_file, served
from explorer_server import fetched, served as served_plainly
from explorer_views import GOAL, START, WAY, answered, corridors, session_of
from test_explorer_page import server, visit  # noqa: F401
from test_explorer_work_files import done_again, reproduced
from test_faults import blocks

import locplan
from locplan.errors import LocplanError
from locplan.explorer import CheckReport, Explorer, Opening, Session
from locplan.field import FieldConfig, Fisher, load_or_compute
from locplan.maps import hollowed, load_map, save_map
from locplan.planners import plan
from locplan.robots import Footprint, Kinematics, Lidar, Robot
from locplan.simulation import Simulator, drive_closed

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
    words = ["check", folder / "blocks.yaml", "--quick", "-o", folder / "report"]
    words += ["--set=range=6", "--set=beams=120"]
    subprocess.run([sys.executable, "-m", "locplan", *map(str, words)], check=True)
    return folder / "report"


def session_on(folder) -> Session:
    report = CheckReport.read(folder)
    grid, config = load_map(report.map_file), config_of(report.robot)
    session = Session(
        grid, Opening(config, report.robot, map_file=str(report.map_file), report=report)
    )
    session.begin(load_or_compute(grid, config)).result(60)
    return session


def test_a_report_is_read_with_its_map_robot_trips_and_cures(checked):
    told = answered(session_on(checked), "checked")
    about = json.loads((checked / "check.json").read_text())
    assert [each["letter"] for each in told["spots"]] == [
        each["letter"] for each in about["weak_spots"]
    ]
    assert told["recommended"] == about["recommended"] == ["map"]
    assert told["next"] == about["next"]["sentence"]
    assert [each["title"] for each in told["cures"]] == [each["title"] for each in about["cures"]]
    for trip, each in zip(told["trips"], about["trips"], strict=True):
        assert np.allclose(
            [trip["xy"][0], trip["xy"][-1]], [each["start"], each["goal"]], atol=1e-3
        )
        assert locplan.Path(trip["xy"]).length == pytest.approx(each["length"], abs=0.01)
    assert CheckReport.read(checked).robot.known_lidar.range == 6.0


def test_the_page_begins_with_the_trip_that_loses_most(checked, run, monkeypatch):
    seen = {}
    monkeypatch.setattr(Explorer, "wait", lambda self: seen.update(session=self.session))
    code, _, err = run("explore", "--check", checked, "--no-browser", "--stride", "0.8")
    assert code == 0, err
    session = seen["session"]
    worst = max(session.opening.report.about["trips"], key=lambda each: each["lost"][0])
    assert session.opening.start == tuple(worst["start"])
    assert session.opening.goal == tuple(worst["goal"])
    assert session.robot.known_lidar.range == 6.0
    assert session.original == load_map(checked.parent / "blocks.yaml")


def test_a_path_that_the_check_recommends_is_shown(checked, tmp_path):
    shutil.copytree(checked.parent, tmp_path / "copy")
    folder = tmp_path / "copy" / "report"
    about = json.loads((folder / "check.json").read_text())
    (folder / "check.json").write_text(json.dumps(about | {"recommended": ["paths"]}))
    trip = about["trips"][0]
    path = locplan.Path([trip["start"], [1.0, 2.0], trip["goal"]])
    path.save(folder / f"{trip['name'].replace(' ', '-')}.csv")
    first, *others = answered(session_on(folder), "checked")["trips"]
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
    err = refused(run("explore", "--check", tmp_path / "copy" / "report", "--no-browser"))
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
    assert fault in refused(run("explore", *arguments))


def test_faults_have_words_and_places(checked, tmp_path):
    grid = blocks()
    session = Session(grid, Opening(config_of(ROBOT), ROBOT))
    told = answered(session, "faults")
    assert "solid walls" in [each["kind"] for each in told["faults"]]
    assert told["placed"]
    assert told["mends"]
    none = answered(session_of(), "faults")
    assert (none["faults"], none["placed"], none["mends"]) == ([], False, False)


def test_drives_have_the_mended_map_in_their_filter():
    grid, config = blocks(), config_of(ROBOT)
    session = Session(grid, Opening(config, ROBOT))
    session.begin(load_or_compute(grid, config)).result(60)
    start, goal = session.state()["start"], session.state()["goal"]
    way = {"start": start, "goal": goal, "drives": 4}
    as_it_is, mended = (answered(session, "simulate", **way, mended=each) for each in (False, True))
    own = locplan.choose(
        *(grid, start, goal, session.robot),
        costs=config,
        drives=4,
        filter_map=hollowed(grid),
    )
    assert mended["candidates"][0]["driven"] == json.loads(
        json.dumps(own.summary()["candidates"][0]["driven"])
    )
    assert mended["candidates"][0]["driven"] != as_it_is["candidates"][0]["driven"]


def test_an_edit_stays_on_the_mended_map_of_a_report(checked):
    report = CheckReport.read(checked)
    x, y = report.about["trips"][0]["start"]
    config = config_of(report.robot)
    with served_plainly(load_map(report.map_file), config, report=report) as plain:
        session = plain.session
        stroke = {"tool": "pole", "points": [[x, y]], "width": 0.4}
        answered(session, "edit", strokes=[stroke])
        _, _, packed = fetched(plain, f"/data/cells/{session.grid.digest}/mended")
        cells = np.frombuffer(gzip.decompress(packed), np.uint8).reshape(session.grid.shape)[::-1]
    assert cells[session.grid.world_to_cell(x, y)] == 3  # occupied, and not marked
    same = session.grid.cells == blocks().cells
    marked = hollowed(blocks()).cells != blocks().cells
    assert marked.any()
    assert ((cells == 2) == marked)[same].all()


def test_the_copied_command_has_the_mended_map(checked, tmp_path):
    about = CheckReport.read(checked).about["trips"][0]
    way = {"start": about["start"], "goal": about["goal"], "mended": True}
    session = session_on(checked)
    file = str(checked / "map_amcl.yaml")
    made = answered(session, "reproduce", **way, drives=4)
    assert f"--filter-map {file}" in made["shell"]
    assert f"filter_map = locplan.load_map({file!r})" in made["python"]
    assert "filter_map" not in answered(session, "reproduce", **way)["python"]
    plain = reproduced(config_of(ROBOT), blocks(), way, 4, robot=ROBOT, map_file="my map.yaml")
    first, second = plain["shell"].splitlines()
    assert first == "locplan mend 'my map.yaml' --output mended"
    assert "--filter-map mended/map_amcl.yaml" in second
    assert "filter_map = locplan.mend(grid).filter_map" in plain["python"]


def test_the_lattice_plans_with_headings_only_where_they_are_set():
    session = session_of(robot=CAR)
    way = WAY | {"planner": "lattice"}
    free = answered(session, "plan", **way)["aware"]
    costs = session.costs(WAY["weight"])
    own = plan(costs, START, GOAL, planner="lattice").path
    assert np.allclose(free["xy"], own.xy, atol=1e-4)
    assert np.allclose(free["heading"], own.heading, atol=1e-3)
    turned = answered(session, "plan", **way, start_heading=math.pi / 2)["aware"]
    assert turned["heading"][0] == pytest.approx(math.pi / 2, abs=1e-3)
    assert abs(free["heading"][0] - math.pi / 2) > 0.5
    circle = answered(session, "plan", **WAY, start_heading=math.pi / 2)["aware"]
    assert "heading" not in circle
    held = answered(session, "plan", **way, hold="goal")["aware"]
    assert "heading" not in held  # it is the draft of the lattice's


def test_a_path_that_leads_back_is_played_in_reverse():
    x, y = START
    xy = np.column_stack([np.linspace(x + 2, x, 9), np.full(9, y)])
    session = session_of(robot=CAR)
    way = {"xy": xy.tolist(), "heading": [0.0] * 9}
    shown = answered(session, "steer", **WAY, **way)
    simulator = Simulator(session.grid, session.robot)
    own = drive_closed(simulator, {"": locplan.Path(xy, [0.0] * 9)}, range(16))[""]
    assert own.words in shown["what"]
    assert own.arrived.value == 1.0
    assert np.abs(shown["heading"]).max() < 0.5
    assert shown["x"][-1] == pytest.approx(x, abs=0.5)


def test_the_robot_says_whether_the_lattice_is_offered():
    assert session_of(robot=CAR).about()["robot"]["lattice"]
    about = session_of().about()["robot"]
    assert (about["lattice"], about["outline"]) == (False, None)


def test_the_copied_command_plans_by_the_lattice(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    grid, field = corridors()
    save_map(grid, "lab.yaml")
    way = WAY | {"planner": "lattice", "goal_heading": 0.5}
    made = reproduced(field.config, None, way, robot=CAR, map_file="lab.yaml")
    shown = answered(session_of(robot=CAR), "plan", **way)["aware"]
    code, command = done_again(made, run)
    own = [each.path for each in code.candidates]
    assert any(is_same(each.xy, shown["xy"]) for each in own)
    assert all(each.heading[-1] == pytest.approx(0.5) for each in own)
    typed = [each["path"]["xy"] for each in command["candidates"]]
    assert all(is_same(*both) for both in zip(typed, [each.xy for each in own], strict=True))


def is_same(one, other) -> bool:
    return len(one) == len(other) and np.allclose(one, other, atol=1e-4)


# The page


@in_browser
def test_a_trip_that_is_clicked_becomes_start_and_goal(visit, checked):  # noqa: F811
    report = CheckReport.read(checked)
    grid, config = load_map(report.map_file), config_of(report.robot)
    field = load_or_compute(grid, config)
    with served(grid, field, robot=report.robot, report=report, **report.ends) as explorer:
        seen = visit(explorer.address)
        seen.wait("#checked-group", "visible")
        assert seen.text("#checked-next") == " ".join(report.about["next"]["sentence"].split())
        assert seen.text("#checked-cures tr.chosen th").startswith(
            report.about["cures"][0]["title"]
        )
        other = min(report.about["trips"], key=lambda each: each["lost"][0])
        seen.page.locator("#checked-trips button", has_text=other["name"]).click()
        seen.wait(f'.trip[aria-pressed="true"]:text-is("{other["name"]}")')
        assert seen.place("start") == pytest.approx(other["start"], abs=0.02)
        assert seen.place("goal") == pytest.approx(other["goal"], abs=0.02)
        assert seen.has_drawn(BROWN) == any(each["letter"] for each in report.about["weak_spots"])


@in_browser
def test_the_mend_is_tried_seen_and_taken_back(visit):  # noqa: F811
    grid, config = blocks(), config_of(ROBOT)
    field = load_or_compute(grid, config)
    ends = Session(grid, Opening(config, ROBOT)).state()
    with served(grid, field, robot=ROBOT, start=ends["start"], goal=ends["goal"]) as explorer:
        seen = visit(explorer.address)
        seen.page.locator("#faults-group h2", has_text="Faults of the map (").wait_for()
        seen.unfold("faults-group")
        assert "solid walls: " in seen.text("#faults-list")
        seen.page.locator("#faults-show").check()
        seen.wait('html[data-marks="faults"]')
        seen.page.locator("#mend").click()
        seen.wait('html[data-marks="mended"]')
        assert not seen.page.locator("#faults-show").is_checked()
        seen.wait("#mended-mark", "visible")
        seen.page.locator("#mend").click()
        seen.wait('html[data-marks=""]')
        seen.wait("#mended-mark", "hidden")


@in_browser
def test_a_heading_is_turned_by_hand_and_reset(visit):  # noqa: F811
    grid, field = corridors()
    with served(grid, field, robot=CAR) as explorer:
        seen = visit(explorer.address)
        assert seen.page.locator(".handle.start").is_hidden()
        painted = seen.value("painted")
        seen.page.locator("#planner").select_option("lattice")
        painted = seen.await_change("painted", painted)
        handle = seen.page.locator(".handle.start")
        assert handle.get_attribute("aria-label").endswith("not set")
        (px, py), (x, y) = seen.middle(".marker.start"), seen.middle(".handle.start")
        seen.drag(".handle.start", px - x, py - 44 - y)
        seen.page.locator('.handle.start[aria-label$=" 90 degrees"]').wait_for()
        seen.await_change("painted", painted)
        seen.page.locator("#headings-reset").click()
        seen.page.locator('.handle.start[aria-label$="not set"]').wait_for()
        assert seen.page.locator("#headings-reset").is_disabled()


BROWN = (122, 59, 0)
"""Colour of a weak spot's letter."""


def test_a_report_without_a_path_says_what_is_wrong(tmp_path):
    with pytest.raises(LocplanError, match=r"has no check\.json"):
        CheckReport.read(tmp_path)
