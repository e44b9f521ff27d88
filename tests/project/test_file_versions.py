"""Each saved file has a version, and the reference lists it."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from support.costmaps import EMPTY_ROOM, ROOM_ENDS, blank_room

import locplan
from locplan.recordings import Recording
from locplan.recordings.files import save_recording

ROOT = Path(__file__).resolve().parents[2]
WRITERS = {
    "_support/runs.py": ["run, `run.yaml`"],
    "_support/saved.py": ["choice, `choice.json`", "costmap, `costmap.npz`", "plan, `plan.json`"],
    "_support/tables.py": ["result, `check.json`", "result, `tuning.json`"],
    "app/explorer/sharing.py": ["page of the explorer, `NAME.html`"],
    "export/registry.py": ["export, `export.json`"],
    "field/config.py": ["settings, `NAME.json`"],
    "field/files.py": ["field, `NAME.npz`"],
    "recordings/files.py": ["recording, `NAME.npz`"],
    "robots/robot.py": ["robot, `NAME.yaml`"],
}
"""Modules that write versions, and some of their rows."""


@pytest.fixture
def versions(monkeypatch):
    """The version of each file in the table of the reference."""
    monkeypatch.syspath_prepend(ROOT / "examples")
    import reference

    return {file: version for file, version, _ in reference.list_versions()}


def read_stamp(file):
    """Return kind and version of a file."""
    if file.suffix == ".npz":
        with np.load(file) as arrays:
            content = json.loads(str(arrays["about"]))
    else:
        content = yaml.safe_load(file.read_text("utf-8"))
    assert content["locplan"] == locplan.__version__
    return content["kind"], content["version"]


def test_table_lists_files_of_all_writers(versions):
    package = ROOT / "locplan"
    writers = {
        file.relative_to(package).as_posix()
        for file in package.rglob("*.py")
        if re.search(r"(?<!def )make_file_stamp\(", file.read_text("utf-8"))
    }
    assert writers == WRITERS.keys()
    assert {row for rows in WRITERS.values() for row in rows} <= versions.keys()


def test_file_versions_equal_documented_versions(versions, tmp_path):
    config = locplan.FieldConfig(locplan.Sad(range=0.5))
    costs = blank_room()
    locplan.Robot("turtlebot4").save(tmp_path / "robot.yaml")
    locplan.save_config(config, tmp_path / "settings.json")
    locplan.covariance_field(EMPTY_ROOM, config).save(tmp_path / "field.npz")
    costs.save(tmp_path / "costmap.npz")
    locplan.plan(costs, *ROOM_ENDS).save(tmp_path / "plan")
    ranges, poses = np.ones((2, 360), np.float32), np.zeros((2, 3))
    save_recording(Recording(ranges, locplan.Lidar(), poses), tmp_path / "recording.npz")
    files = [*tmp_path.glob("*.*"), tmp_path / "plan/plan.json", tmp_path / "plan/run.yaml"]
    assert len(files) == 7
    for file in files:
        kind, version = read_stamp(file)
        row = next(row for row in versions if row.startswith(f"{kind}, "))
        assert version == versions[row], row


def test_results_and_exports_have_versions(versions, run, tmp_path):
    locplan.save_map(EMPTY_ROOM, tmp_path / "room.yaml")
    folder, room = tmp_path / "made", tmp_path / "room.yaml"
    ends = [f"--{name}={x},{y}" for name, (x, y) in zip(("start", "goal"), ROOM_ENDS, strict=True)]
    assert (
        run("simulate", room, *ends, "--drives", 2, "--lidar", "turtlebot3", "-o", folder)[0] == 0
    )
    assert read_stamp(folder / "simulation.json") == (
        "simulation",
        versions["result, `simulation.json`"],
    )
    assert run("export", room, "--to", "ros-map", "--field", "sad", "-o", tmp_path / "map")[0] == 0
    assert read_stamp(tmp_path / "map/export.json") == (
        "ros-map",
        versions["export, `export.json`"],
    )
