"""The command that reads a recorded drive once, and the drive.npz that it writes for others."""

from __future__ import annotations

import dataclasses
import json
import math
from types import SimpleNamespace

import numpy as np
import pytest
from support.bag_files import BEGIN, open_bag
from support.command_line import check_refusal
from support.maps import ascii_map

import locplan
from locplan import Lidar, Robot
from locplan.maps.map_faults import MapFault
from locplan.recordings import Recording, record_drive, study_recording
from locplan.recordings.faults import find_recording_faults

pytestmark = pytest.mark.usefixtures("undrawn")

LIDAR = Lidar(range=8.0, beams=90, model="own")
FEW = "--set", "min_particles=50", "--set", "max_particles=100"


@pytest.fixture(scope="module")
def grid() -> locplan.OccupancyGrid:
    """A room of 10 by 6 m with pillars, which looks different from everywhere."""
    lines = ["#" * 40, *["#" + "." * 38 + "#"] * 22, "#" * 40]
    cells = [list(line) for line in lines]
    for row, column, height, width in ((6, 12, 3, 3), (1, 30, 3, 9), (19, 4, 4, 5), (20, 18, 3, 2)):
        for y in range(row, row + height):
            cells[y][column : column + width] = "#" * width
    return ascii_map(*map("".join, cells), resolution=0.25)


@pytest.fixture(scope="module")
def drive(grid) -> Recording:
    path = locplan.plan(locplan.Costmap.blank(grid), (1.5, 2.5), (8.5, 2.0)).path
    return record_drive(grid, path, Robot(LIDAR), spacing=0.2)


@pytest.fixture
def files(tmp_path, grid, drive):
    locplan.save_map(grid, tmp_path / "room.yaml")
    drive.save(tmp_path / "monday.npz")
    return tmp_path


def test_recording_finds_ground_truth_on_map(run, files, grid, drive):
    Robot(LIDAR).save(files / "robot.yaml")
    command = "recording", files / "monday.npz", files / "room.yaml", *FEW
    command = *command, "--robot", files / "robot.yaml"
    code, out, err = run(*command, "-o", files / "monday")
    assert code == 0, err
    assert out.startswith(("Sound", "Usable: "))
    assert "ground truth" in out
    assert f"wrote {files / 'monday' / 'poses.tum'}: the ground truth, for evo" in out
    assert f"wrote {files / 'monday'}: 1 more file" in out
    assert out.splitlines()[-1] == (
        f"  locplan check {files / 'room.yaml'} --recording={files / 'monday' / 'drive.npz'}"
        f" --robot={files / 'robot.yaml'} -o report"
    )
    names = {"drive.npz", "recording.json", "recording.png", "poses.csv", "poses.tum", "robot.yaml"}
    assert {file.name for file in (files / "monday").iterdir()} == {*names, "run.yaml"}
    found = Recording.load(files / "monday" / "drive.npz")
    off = np.hypot(*(found.poses - drive.poses)[:, :2].T)
    assert np.median(off) < 0.05
    values = json.loads((files / "monday" / "recording.json").read_text())
    assert values["is_sound"]
    assert values["replay"]["runs"] == 12
    robot = Robot.load(files / "monday" / "robot.yaml")
    assert (robot.lidar.beams, robot.filter.max_particles) == (90, 100)


def test_recording_without_map_reports_only_faults(run, files, drive):
    code, out, err = run("recording", files / "monday.npz", "-o", files / "drive.npz")
    assert (code, err) == (0, "")
    assert f"wrote {files / 'drive.npz'}: the recording, for --recording of other commands" in out
    assert out.startswith(("Sound", "Usable: "))
    assert "ground truth  " not in out
    assert "Next:" not in out
    np.testing.assert_array_equal(Recording.load(files / "drive.npz").ranges, drive.ranges)
    values = json.loads(run("recording", files / "monday.npz", "--json")[1])
    assert (values["ground_truth"], values["seed"]) == (None, 1)


def test_recording_reads_limits_mount_and_alignment(run, files, drive):
    options = "--every", "2", "--range-limits", "0.5,3", "--mount=-0.1,0.2,90", "--align", "1,2,90"
    assert run("recording", files / "monday.npz", *options, "-o", files / "some.npz")[0] == 0
    read = Recording.load(files / "some.npz")
    assert len(read) == math.ceil(len(drive) / 2)
    assert np.nanmax(np.where(np.isfinite(read.ranges), read.ranges, np.nan)) <= 3
    assert (read.lidar.mount_x, read.lidar.mount_y) == (-0.1, 0.2)
    assert read.lidar.mount_yaw_deg == pytest.approx(90.0)
    x, y, heading = drive.poses[0]
    expected = (1 - y, 2 + x, heading + math.pi / 2)
    np.testing.assert_allclose(read.poses[0], expected, atol=1e-9)


def test_other_commands_take_written_recording(run, files):
    drive = files / "drive.npz"
    assert run("recording", files / "monday.npz", files / "room.yaml", *FEW, "-o", drive)[0] == 0
    simulate = "simulate", files / "room.yaml", "--recording", drive, *FEW, "--drives", "2"
    code, out, err = run(*simulate, "--json")
    assert code == 0, err
    assert json.loads(out)["runs"] == 2
    locate = "locate", files / "room.yaml", "--recording", drive, "--scan", "3", "--json"
    assert json.loads(run(*locate)[1])["recorded"]["distance"] < 0.5


def test_other_commands_read_written_robot(run, files):
    Robot(LIDAR).save(files / "robot.yaml")
    command = "recording", files / "monday.npz", files / "room.yaml", *FEW
    command = *command, "--robot", files / "robot.yaml"
    assert run(*command, "-o", files / "out")[0] == 0
    robot = files / "out" / "robot.yaml"
    ends = "--start", "1.5,2.5", "--goal", "3,2.5", "--drives", "2", "--stride", "1"
    code, out, err = run("simulate", files / "room.yaml", *ends, "--robot", robot, "--json")
    assert code == 0, err
    assert json.loads(out)["robot"] == Robot.load(robot).summary()


def test_recording_overwrites_files_only_with_force(run, files):
    target = files / "drive.npz"
    target.write_text("mine")
    command = "recording", files / "monday.npz", "-o", target
    assert "drive.npz: was not written by this command" in check_refusal(run(*command))
    assert run(*command, "--force")[0] == 0
    assert run(*command)[0] == 0  # over an earlier result


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--mount=1,2",), "--mount must be 3 numbers"),
        (("--align=a,b,c",), "--align must be 3 numbers"),
        (("--range-limits=1",), "--range-limits must be 2 numbers"),
        (("--range-limits=3,2",), "--range-limits must be a minimum and a maximum"),
        (("--pose-topic=/pose",), "--pose-topic applies only to bags"),
        (("--start=1,2",), "--start needs a heading; write X,Y,DEG"),
        (("--start=nan,0,0",), "X,Y,DEG with a heading in degrees"),
        (("--start=1,2,0",), "--start has no effect without a map"),
        (("--lidar=tim571",), "--lidar has no effect with --recording"),
        (("--set=range=5",), "--set range has no effect with --recording"),
        (("-o", "poses.tum"), "poses.tum: must end in .npz, or be a folder"),
    ],
)
def test_recording_refuses_wrong_options(run, files, monkeypatch, options, message):
    monkeypatch.chdir(files)
    assert message in check_refusal(run("recording", "monday.npz", *options))


def test_recording_refuses_missing_file(run, files):
    assert "none.npz" in check_refusal(run("recording", files / "none.npz"))
    assert "FILE is missing" in check_refusal(run("recording"))
    folder = "recording", files / "monday.npz", files / "none.yaml"
    assert "none.yaml" in check_refusal(run(*folder))


@pytest.mark.parametrize(
    "command",
    [
        ("recording", "monday.npz", "places"),
        ("check", "places", "--recording", "monday.npz"),
        ("tune", "places", "--recording", "monday.npz"),
        ("simulate", "places", "--recording", "monday.npz"),
        ("locate", "places", "--recording", "monday.npz"),
        ("locate", "places", "--recording", "monday.npz", "--scan", "3"),
    ],
)
def test_command_rejects_recording_of_another_building(run, files, monkeypatch, command):
    monkeypatch.chdir(files)
    error = check_refusal(run(*command))
    assert "simulated does not fit places: only " in error
    assert error.endswith("use the map of the building where it was recorded\n")


def test_built_in_recording_keeps_its_name(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    command = "recording", "two_corridors", "--every", "40", "-o", "two_corridors"
    assert run(*command)[0] == 0
    assert len(Recording.load(tmp_path / "two_corridors" / "drive.npz")) == 25


def test_other_commands_suggest_recording_options(run, files):
    with open_bag(files, "mcap") as (bag, writer):
        writer.tf(BEGIN, writer.transform(BEGIN, "odom", "base_link", (0, 0, 0)))
        writer.scan(BEGIN, LIDAR, np.ones(90), topic="/front")
        writer.scan(BEGIN, LIDAR, np.ones(90), topic="/rear")
    error = check_refusal(run("simulate", files / "room.yaml", "--recording", bag))
    assert "choose one with --scan-topic /front; run `locplan recording" in error


@pytest.mark.parametrize(
    ("faults", "answer"),
    [
        ({}, "Sound"),
        ({"stamps_back": 3}, "Usable: 1 fault"),
        ({"stamps_back": 3, "n_jumps": 2}, "Not sound: 2 faults"),
    ],
)
def test_report_counts_faults_in_first_line(drive, faults, answer):
    sound = dataclasses.replace(
        find_recording_faults(drive),
        disagreements=(),
        n_jumps=0,
        wrong_signs=(),
        n_reversed_steps=0,
    )
    studied = study_recording(drive)
    report = dataclasses.replace(studied, faults=dataclasses.replace(sound, **faults)).report()
    assert report.startswith(answer)
    assert ("alphas 0.05" in report) == ("n_jumps" in faults)


def test_report_ends_sentence_before_places(drive):
    fault = MapFault("false walls", "the scans do not fit", "map it again", boxes=((0, 0, 2, 4),))
    fit = SimpleNamespace(sentence="The map fits.")
    report = dataclasses.replace(study_recording(drive), fit=fit, map_faults=(fault,)).report()
    assert "map it again. Worst at (1.0, 2.0)." in " ".join(report.split())
