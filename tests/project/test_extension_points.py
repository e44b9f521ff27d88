"""The recipes of CONTRIBUTING: one of each kind is added to a copy of the package."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from support.maps import ascii_map

import locplan
from locplan import save_map

ESTIMATOR = '''
from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from locplan.field.estimator import Estimator
from locplan.field.search_window import SearchWindow


@dataclass(frozen=True, kw_only=True)
class Uniform(Estimator):
    """The same covariance everywhere."""

    name: ClassVar[str] = "uniform"
    reach = 1.0
    title = "the same everywhere"

    def lattice(self, resolution):
        return SearchWindow().to_lattice(resolution)

    def covariances(self, part):
        q = self.q(self.lattice(part.resolution))
        return {"covariance": np.tile(0.01 * np.eye(3) + q, (len(part.cols), 1, 1))}

    def halo(self, resolution, map_shape):
        return 0
'''
PLANNER = '''
from dataclasses import dataclass

from locplan.planning.path import Path
from locplan.planning.protocol import PlannerResult


@dataclass(frozen=True)
class Straight:
    """The straight line."""

    name = "straight"
    minimises = None
    space = "R2"

    def check(self): ...

    def prepare(self): ...

    def solve(self, costs, start, goal):
        return PlannerResult(Path([start, goal]))
'''
FORMAT = '''
from dataclasses import dataclass

from locplan.export.registry import ExportOptions, ExportSummary, make_option_field


@dataclass(frozen=True, kw_only=True)
class NameOptions(ExportOptions):
    """The options of a name."""

    prefix: str = make_option_field("the ")
    """Text before the name."""


def write_name(target, job, options):
    """Write the name of the map."""
    target.write_text(options.prefix + job.costs.grid.name)
    return ExportSummary()
'''
COMMAND = '''
from locplan.app.cli.application import command


@command("hello you")
def hello(name: str) -> int:
    """Greet somebody."""
    print("hello", name)
    return 0
'''
WEIGHT_LAW = '''
@dataclass(frozen=True, repr=False)
class Gaussian(Settings):
    """Weights exp(-(S / width)^2)."""

    name: ClassVar[str] = "gaussian"
    width: float = 0.5
    """Mismatch area at which the weight falls to 1/e [m^2]."""

    def weigh(self, area, cell_area, template):
        return np.exp(-((area / self.width) ** 2))


'''
NEW_FILES = {
    "field/uniform.py": ESTIMATOR,
    "planning/straight.py": PLANNER,
    "export/name.py": FORMAT,
    "app/cli/hello.py": COMMAND,
}
"""The new files with their texts."""
NEW_LINES = [
    # estimator
    (
        "field/estimators.py",
        "from locplan.field.sad",
        "from locplan.field.uniform import Uniform\n",
    ),
    ("field/estimators.py", '    "sad":', '    "uniform": Uniform,\n'),
    # planner
    (
        "planning/registry.py",
        "from locplan.planning.protocol",
        "from locplan.planning.straight import Straight\n",
    ),
    ("planning/registry.py", '    "grid":', '    "straight": PlannerEntry(Straight, None),\n'),
    # export format
    (
        "export/formats.py",
        "from locplan.robots",
        "from locplan.export.name import NameOptions, write_name\n",
    ),
    (
        "export/formats.py",
        '    ExportFormat("nav2-speed"',
        '    ExportFormat("name", "a name", write_name, NameOptions, suffixes=(".txt",)),\n',
    ),
    # command
    ("app/cli/application.py", '    "info":', '    "hello": "Start",\n'),
    # measure: its field, its value, its column, and the words that compare planners by it
    ("planning/metrics.py", "    cost: float\n", "    corners: int\n"),
    ("planning/metrics.py", "        cost=float(", "        corners=len(path.xy) - 2,\n"),
    (
        "planning/metrics.py",
        '    TableColumn("cost"',
        '    TableColumn("corners", "", "corners", 0),\n',
    ),
    (
        "comparison/statistics.py",
        '    "cost": (RATIO',
        '    "corners": (RATIO_OF_SUMS, "fewer corners", "more corners"),\n',
    ),
    # lidar
    (
        "robots/lidar.py",
        '    "turtlebot3":',
        '    "toy": LidarDataSheet(5.0, 0.1, 90.0, 91, 0.02, "a box"),\n',
    ),
    # preset
    ("robots/presets.py", "    SAFE: dict(", '    "keen": {"z_hit": 0.8},\n'),
    # weight law
    ("field/sad.py", "\nWeightLaw = ", WEIGHT_LAW),
    ("field/sad.py", "Exponential | InverseSquare\n", "Gaussian | "),
    # column
    (
        "comparison/result.py",
        '    TableColumn("sentence", value=lambda standing: standing.cost',
        '    TableColumn("solved_runs", value=lambda standing: standing.summary.solved),\n',
    ),
    (
        "planning/metrics.py",
        '        TableColumn("range", "m", value',
        '        TableColumn("beams", title="beams", value=lambda share: share.lidar.beams),\n',
    ),
]
"""The existing files that change: the text before which new text stands, and the new text."""
USE_ALL = """
import numpy as np
import locplan
from locplan.comparison.result import STANDING_COLUMNS
from locplan.comparison.runs import run_from_plan
from locplan.comparison.statistics import RUN_COLUMNS, RunTask
from locplan.field.config import FieldConfig
from locplan.field.sad import Gaussian
from locplan.planning.metrics import LidarDegeneracy, make_lidar_table
from locplan.robots.presets import describe_preset, list_applicable_presets
from locplan.simulation.race import CANDIDATE_COLUMNS

grid = locplan.load_map("bay.yaml")
costs = locplan.Costmap.blank(grid, robot=0.1)
plan = locplan.plan(costs, (1, 1), (2, 1), planner="straight")
assert plan.path.length == 1

assert plan.metrics.corners == 0, plan.path.xy
assert "corners" in plan.table().names
assert "corners" in [column.name for column in RUN_COLUMNS]
assert "corners" in [column.name for column in CANDIDATE_COLUMNS]
assert "solved_runs" in [column.name for column in STANDING_COLUMNS]
run = run_from_plan(RunTask("bay", "none", "ab", 4.0, "straight", 1), plan)
assert run.measure("corners") == 0

assert list_applicable_presets(locplan.robots.Amcl())["keen"].z_hit == 0.8
assert describe_preset("keen") == "z_hit 0.8"

assert locplan.Lidar.preset("toy").beams == 91

config = FieldConfig(locplan.Sad(weights=Gaussian(0.4)))
assert FieldConfig.from_json(config.to_json()) == config
assert "gaussian" in config.title and "Gaussian(width=0.4)" in repr(config)
weights = config.estimator.offset_weights(np.array([0, 254, 254000]), 0.05)
assert 1 == weights[0] > weights[1] > 0.99 and weights[2] < 1e-10

assert "beams" in str(make_lidar_table([LidarDegeneracy(locplan.Lidar.preset("turtlebot4"), 0.1)]))
"""


@pytest.fixture(scope="module")
def run_copy(tmp_path_factory):
    """A function that runs Python in a folder with a map, with a copy that has one more of each."""
    home = tmp_path_factory.mktemp("copy")
    package = home / "locplan"
    shutil.copytree(
        Path(locplan.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__")
    )
    for name, text in NEW_FILES.items():
        (package / name).write_text(text)
    for name, before, line in NEW_LINES:
        text = (package / name).read_text()
        assert text.count(before) == 1, (name, before)
        (package / name).write_text(text.replace(before, line + before))
    save_map(ascii_map("######", "#....#", "#....#", "######", resolution=0.5), home / "bay.yaml")
    # Compiling the kernels again would take a minute; on this map plain Python is fast enough.
    variables = {
        "PYTHONPATH": str(home),
        "NUMBA_DISABLE_JIT": "1",
        "LOCPLAN_CACHE": str(home / "cache"),
    }

    def run(*words: str) -> str:
        process = subprocess.run(
            (sys.executable, *words),
            cwd=home,
            env=os.environ | variables,
            capture_output=True,
            text=True,
            check=False,
        )
        assert process.returncode == 0, process.stderr
        return process.stdout

    return run


def test_recipes_extend_package_copy(run_copy):
    run_copy("-c", USE_ALL)


def test_commands_use_added_estimator_and_format(run_copy):
    line = "export bay.yaml --to name --field uniform --json -o name.txt"
    assert '"name"' in run_copy("-m", "locplan", *line.split(), "--prefix", "my ")
    assert run_copy("-c", "print(open('name.txt').read())") == "my bay\n"


def test_help_lists_added_command(run_copy):
    assert "Greet somebody." in run_copy("-m", "locplan", "--help")
    assert run_copy("-m", "locplan", "hello", "you") == "hello you\n"
