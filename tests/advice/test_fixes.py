"""Fixes of a check: map files, recordings, masks and poles."""

import dataclasses
import json

import numpy as np
import pytest
from support.check_cases import CORNERS, ROBOT
from support.maps import furnished_room

import locplan
from locplan import check, save_map
from locplan.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid, environments

pytestmark = pytest.mark.usefixtures("undrawn")

ALPHAS = {f"alpha{n}": 2.0 for n in range(1, 6)}


@pytest.mark.long
def test_threshold_repair_restores_unknown_cells(tmp_path):
    cells = np.full((160, 200), UNKNOWN, np.uint8)
    cells[20:140, 20:180] = furnished_room().cells
    grid = OccupancyGrid(cells, 0.05, (-1.0, -1.0, 0.0), name="room")
    save_map(grid, tmp_path / "room.yaml")
    file = tmp_path / "room.yaml"
    file.write_text(file.read_text().replace("free_thresh: 0.196", "free_thresh: 0.25"))
    with pytest.warns(locplan.maps.MapWarning, match="unknown grey"):
        assert (locplan.load_map(file).cells != UNKNOWN).all()
    report = check(file, ROBOT, CORNERS, effort="quick")
    assert report.recommended == ("walls",)
    assert (report.scenario.world.cells == UNKNOWN).sum() == (cells == UNKNOWN).sum()
    report.save(tmp_path / "report")
    assert np.array_equal(locplan.load_map(tmp_path / "report" / "map.yaml").cells, cells)


def record_lap(scale=1.0):
    """Return a recording of about 45 m in the room, with its positions scaled."""
    corners = [(7, 1), (7, 2), (1, 2.2), (1, 5), (4, 4), (7, 4), (7, 1.5), (4.5, 1), (1, 1)]
    path = locplan.Path([(1, 1), *corners * 2])
    drive = locplan.recordings.record_drive(furnished_room(), path, ROBOT, seed=3)
    return dataclasses.replace(drive, poses=drive.poses * [scale, scale, 1.0])


def test_recordings_calibrate_robot_and_resolution(tmp_path):
    grid = dataclasses.replace(furnished_room(), resolution=0.05 * 1.04)
    drive = record_lap(1.04)
    report = check(grid, ROBOT, {"a": (1.0, 1.0), "b": (7.0, 1.0)}, [drive, drive], effort="quick")
    assert report.recommended == ("walls",)
    assert report.scenario.stretch == pytest.approx(1 / 1.04, abs=0.005)
    (walls,) = (each for each in report.fixes if each.kind == "walls")
    assert walls.ratio.value != 1  # the fix changes the map, not the simulated world
    assert "resolution" in {each.kind for each in report.faults}
    sentences = "\n".join(report.recording_sentences)
    for words in (
        "drive 1: too few scans",
        "drive 2: too few scans",
        "lidar as",
        "odometry as",
    ):
        assert words in sentences
    assert report.scenario.robot.odometry != ROBOT.odometry
    assert report.scenario.robot.filter == ROBOT.filter
    report.save(tmp_path)
    assert locplan.load_map(tmp_path / "map.yaml").resolution == pytest.approx(0.05, abs=2e-4)


@pytest.mark.long
def test_check_saves_mask_for_better_paths(tmp_path):
    grid = environments.make("two_corridors", resolution=0.1)
    poor = {"distance_drift": 0.1, "distance_bias": 0.1, "heading_drift_deg": 3.0}
    routes = [((2.0, 3.0), (38.0, 3.0))]
    report = check(grid, ROBOT.with_settings(poor), routes)
    assert report.recommended == ("paths",)
    assert report.after.lost.high < report.before.lost.low
    path = locplan.plan(report.artifacts["paths"], *routes[0]).path
    assert np.array_equal(path.xy, report.fixed_scenario.paths["query 1"].xy)
    with pytest.warns(
        locplan.export.parameters.RobotWarning, match="path followers may stop below"
    ):
        report.save(tmp_path)
    mask_first, nav2 = report.summary(tmp_path, tmp_path / "x.yaml")["next"]["command"].splitlines()
    assert mask_first == f"ros2 launch {tmp_path}/mask/localizability.launch.xml"
    assert nav2.endswith(f"params_file:={tmp_path}/mask/nav2.yaml")
    assert (tmp_path / "mask" / "localizability.launch.xml").exists()
    assert set(report.describe_fix_files()) == {"mask/nav2.yaml"}
    assert json.loads((tmp_path / "mask" / "export.json").read_text())["kind"] == "nav2-keepout"
    mask = locplan.load_map(tmp_path / "mask" / "mask.yaml")
    assert mask.shape == grid.shape
    assert (mask.cells == OCCUPIED).any()
    assert not (mask.cells[grid.cell(path.resample(0.1).xy)] == OCCUPIED).any()


@pytest.mark.long
def test_check_recommends_poles_in_corridor():
    cells = np.full((24, 300), FREE, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    grid = OccupancyGrid(cells, 0.1, name="corridor")
    robot = ROBOT.with_settings({"distance_drift": 0.1, "distance_bias": 0.1})
    report = check(grid, robot, [((1.0, 1.2), (29.0, 1.2))])
    assert report.recommended == ("landmarks",)
    assert report.after.lost.high < report.before.lost.low
