"""The explorer on a check's report."""

from __future__ import annotations

import dataclasses
import json
import shutil
import subprocess
import sys

import numpy as np
import pytest
from support.command_line import check_refusal
from support.explorer_sessions import ask
from support.maps import blocks

import locplan
from locplan.app.explorer.check_reports import CheckReport
from locplan.app.explorer.explorer import Explorer
from locplan.app.explorer.scene import StartSettings
from locplan.app.explorer.session import Session
from locplan.app.explorer.state import describe_state
from locplan.app.explorer.weak_spots import name_weak_spots
from locplan.errors import LocplanError
from locplan.field import FieldConfig, Fisher, load_or_compute
from locplan.maps import hollow_walls, load_map, save_map
from locplan.robots import Robot

pytest.importorskip("starlette", reason="the explorer's server is not installed")


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


def session_on(folder, **opening) -> Session:
    report = CheckReport.read(folder)
    grid, config = load_map(report.map_file), config_of(report.robot)
    session = Session(grid, StartSettings(config, report.robot, report=report, **opening))
    session.begin(load_or_compute(grid, config))
    session.wait()
    return session


def test_report_answer_has_routes_and_fixes(checked):
    session = session_on(checked)
    told = ask(session, "report")
    about = json.loads((checked / "check.json").read_text())
    letters = [spot["letter"] for spot in about["weak_spots"] if spot["letter"]]
    assert [spot["letter"] for spot in describe_state(session)["weak_spots"]] == letters
    assert told["basis"] == {**session.scene.basis, "route": None}
    pole = {"kind": "pole", "points": [[5.0, 5.0]], "width": 1.0}
    ask(session, "change", changes=[pole])
    assert ask(session, "report")["basis"]["map"] == told["basis"]["map"]
    assert session.scene.basis["map"] != told["basis"]["map"]
    assert told["recommended"] == about["recommended"]
    assert about["recommended"][0] == "map"
    sentence = about["next"]["sentence"].removesuffix(":")
    assert told["next"] == f"{sentence[0].upper()}{sentence[1:]}."
    assert [each["title"] for each in told["fixes"]] == [each["title"] for each in about["fixes"]]
    for route, each in zip(told["routes"], about["routes"], strict=True):
        assert np.allclose(
            [route["xy"][0], route["xy"][-1]], [each["start"], each["goal"]], atol=1e-3
        )
        assert locplan.Path(route["xy"]).length == pytest.approx(each["length"], abs=0.01)
    assert CheckReport.read(checked).robot.known_lidar.range == 6.0


def test_zones_keep_weak_spots_of_report(checked):
    zone = {"kind": "zone", "zone": "slow", "polygon": [[1, 1], [2, 1], [2, 2]], "percent": 30}
    plain, zoned = session_on(checked), session_on(checked, changes=(zone,))
    spots, others = (json.dumps(describe_state(each)["weak_spots"]) for each in (plain, zoned))
    assert spots == others


def test_failure_place_keeps_its_text(checked):
    """It has no size, even if drives fail within a degenerate place."""
    session = session_on(checked)
    report, spots = session.opening.report, name_weak_spots(session.scene)
    assert spots
    place = {
        **report.facts["weak_spots"][0],
        **{"x": spots[0].spot.x, "y": spots[0].spot.y, "length": 0.0, "width": 0.0},
        **{"position_std": None, "heading_std": None, "missing": "drives are aborted"},
    }
    report = dataclasses.replace(report, facts={**report.facts, "weak_spots": [place]})
    (named_spot,) = name_weak_spots(session.scene, report)
    assert (named_spot.title, named_spot.reason) == ("Drives fail here", "Drives are aborted.")


def test_page_starts_with_worst_route(checked, run, monkeypatch):
    seen = {}
    monkeypatch.setattr(Explorer, "wait", lambda self: seen.update(session=self.session))
    code, _, err = run("explore", "--check", checked, "--no-browser", "--stride", "0.8")
    assert code == 0, err
    session = seen["session"]
    worst = session.opening.report.facts["routes"][0]
    assert session.opening.start == tuple(worst["start"])
    assert session.opening.goal == tuple(worst["goal"])
    assert session.scene.site.robot.known_lidar.range == 6.0
    assert session.original.grid == load_map(checked.parent / "blocks.yaml")


def test_recommended_path_of_report_is_shown(checked, tmp_path):
    shutil.copytree(checked.parent, tmp_path / "copy")
    folder = tmp_path / "copy" / "report"
    about = json.loads((folder / "check.json").read_text())
    (folder / "check.json").write_text(json.dumps(about | {"recommended": ["paths"]}))
    route = about["routes"][0]
    path = locplan.Path([route["start"], [1.0, 2.0], route["goal"]])
    path.save(folder / f"{route['name'].replace(' ', '-')}.csv")
    first, *others = ask(session_on(folder), "report")["routes"]
    assert np.allclose(first["chosen"], path.xy, atol=1e-3)
    assert all(each["chosen"] is None for each in others)


@pytest.mark.parametrize(
    ("damage", "fault"),
    [
        (lambda folder: (folder / "check.json").unlink(), "has no check.json; name a folder"),
        (lambda folder: (folder / "run.yaml").unlink(), "has no run.yaml; name a folder"),
        (lambda folder: (folder / "check.json").write_text("[1]"), "is damaged or from another"),
        (lambda folder: (folder / "check.json").write_text('{"robot": {}}'), "is damaged"),
        (lambda folder: (folder / "run.yaml").write_text("kind: robot"), "is damaged"),
        (lambda folder: (folder.parent / "blocks.yaml").unlink(), "there is no such file"),
        (
            lambda folder: save_map(hollow_walls(blocks()), folder.parent / "blocks.yaml"),
            "has changed since",
        ),
    ],
)
def test_explore_refuses_unusable_report(checked, tmp_path, run, damage, fault):
    shutil.copytree(checked.parent, tmp_path / "copy")
    damage(tmp_path / "copy" / "report")
    err = check_refusal(run("explore", "--check", tmp_path / "copy" / "report", "--no-browser"))
    assert fault in err


@pytest.mark.parametrize(
    ("arguments", "fault"),
    [
        (("lab.yaml", "--check", "report"), "a map and --check exclude each other"),
        ((), "name a map, or pass the folder"),
        (("--check", "report", "--lidar", "lds-01"), "--lidar has no effect with --check"),
        (("--check", "nowhere"), "nowhere: has no check.json"),
    ],
)
def test_explore_takes_map_or_report(run, arguments, fault):
    assert fault in check_refusal(run("explore", *arguments))


def test_folder_without_report_is_refused(tmp_path):
    with pytest.raises(LocplanError, match=r"has no check\.json"):
        CheckReport.read(tmp_path)
