"""The lowest versions of libraries that pyproject.toml allows are ones that work together."""

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
EXTRAS = ("dask", "explore", "functions", "ros", "tables")
USE = """
import locplan
grid = locplan.load_map("maps/two_corridors.yaml")
field = locplan.covariance_field(grid, locplan.FieldConfig(locplan.Sad(range=1.0), stride=1.0))
field.to_xarray()
costs = locplan.Costmap.blank(grid, robot=0.25)
plan = locplan.plan(costs, (2.0, 3.0), (38.0, 3.0), planner="RRT", iterations=2000)
import cloudpickle, cv2, distributed, pandas, rosbags.typesys, uvicorn
import starlette.applications, websockets
"""


def floors() -> list[str]:
    """Each dependency, those of extras included, at its lowest version."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    optional = project["optional-dependencies"]
    every = [*project["dependencies"], *(each for extra in EXTRAS for each in optional[extra])]
    assert all(each.partition(";")[0].count(">=") == 1 for each in every)
    return [each.replace(">=", "==", 1) for each in every]


@pytest.mark.long
@pytest.mark.skipif(sys.version_info[:2] != (3, 11), reason="later Pythons need later versions")
def test_declared_minimum_versions_work(tmp_path):
    def run(*words):
        env = {**os.environ, "PYTHONPATH": str(ROOT)}
        done = subprocess.run(words, cwd=ROOT, env=env, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr[-3000:]
        return done.stdout

    run(sys.executable, "-m", "venv", tmp_path / "env")
    python = tmp_path / "env" / "bin" / "python"
    run(python, "-m", "pip", "install", "-q", "--no-compile", *floors())
    ends = ("--start", "2,3", "--goal", "38,3", "--lidar", "turtlebot4")
    run(python, "-m", "locplan", "plan", "maps/two_corridors.yaml", *ends, "-o", tmp_path / "out")
    assert (tmp_path / "out" / "choice.png").stat().st_size > 10_000
    run(python, "-c", USE)
