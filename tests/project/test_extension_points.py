"""What is new is one file and one line: CONTRIBUTING's table, done in a copy of the package."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import drawn

import locplan
from locplan import save_map

ESTIMATOR = '''
from dataclasses import dataclass
from typing import ClassVar
import numpy as np
from locplan.field import Estimator
from locplan.field import SearchWindow

@dataclass(frozen=True, kw_only=True)
class Everywhere(Estimator):
    """The same everywhere."""
    name: ClassVar[str] = "everywhere"
    remedy: ClassVar[str] = "none"
    weight: ClassVar[float] = 3.0
    reach = 1.0
    title = "the same everywhere"
    def lattice(self, resolution):
        return SearchWindow().on(resolution)
    def covariances(self, part):
        q = self.q(self.lattice(part.resolution))
        return {"covariance": np.tile(0.01 * np.eye(3) + q, (len(part.cols), 1, 1))}
    def halo(self, resolution, map_shape):
        return 0
'''
PLANNER = '''
from dataclasses import dataclass
from locplan.planning import Path
from locplan.planning import Found

@dataclass(frozen=True)
class Crow:
    """As the crow flies."""
    name = "crow"
    minimises = None
    space = "R2"
    def check(self): pass
    def prepare(self): pass
    def solve(self, costs, start, goal):
        return Found(Path([start, goal]))
'''
FORMAT = '''
from locplan.export.registry import ExportSummary, Format, NoOptions

def write(target, job, options):
    """Write the name of the map."""
    target.write_text(job.costs.grid.name)
    return ExportSummary()

FORMATS = (Format("name", "the map's name", write, suffixes=(".txt",)),)
'''
COMMAND = '''
from locplan.app.cli.application import command

@command("hello you")
def hello(name: str) -> int:
    """Greet somebody."""
    print("hello", name)
    return 3
'''
FIGURE = '''
from locplan.maps.figures import draw_map, map_axes

def bare_figure(grid):
    """Draw a map and nothing else."""
    figure, axes = map_axes(grid)
    draw_map(axes, grid)
    return figure
'''
RESULT = '''
from dataclasses import dataclass
from typing import ClassVar
from locplan._support.records import Column, Result, Table
from locplan._support.output import Results
from locplan._support.saved import Stored
from locplan.maps import OccupancyGrid

@dataclass(frozen=True, eq=False)
class Shape(Result, Stored):
    """How large a map is."""
    kind: ClassVar[str] = "shape"
    files: ClassVar[Results] = Results("shape", ("shape.json", "shape.png", "shape.npz"))
    _drawn_by: ClassVar[str] = "locplan.planning:bare_figure"
    grid: OccupancyGrid
    def summary(self):
        return {"rows": self.grid.shape[0]}
    def table(self):
        return Table.of([Column("rows", value=lambda grid: grid.shape[0])], [self.grid])
    def report(self):
        return str(self.table())
    def figure(self):
        from locplan.plotting import bare_figure
        return bare_figure(self.grid)
    def _write(self, folder):
        self.write(folder / "shape.npz")
        self.table().write_csv(folder / "shape.csv")
'''
ADDED = {
    "field/estimators/_everywhere.py": (
        *(ESTIMATOR, "field/estimators/__init__.py", '    "sad":'),
        '    "everywhere": "locplan.field.estimators._everywhere:Everywhere",',
    ),
    "planners/_crow.py": (
        *(PLANNER, "planners/_registry.py", '    "grid":'),
        '    "crow": Entry("locplan.planning._crow:Crow", None),',
    ),
    "export/_name.py": (
        *(FORMAT, "export/_registry.py", '"""Modules that have FORMATS'),
        'MODULES.append("locplan.export._name")',
    ),
    "cli/hello.py": (COMMAND, "cli/application.py", '    "info":', '    "hello": "Start",'),
    "plotting/_bare.py": (
        *(FIGURE, "plotting/__init__.pyi", "from ._cells"),
        "from ._bare import bare_figure as bare_figure",
    ),
    "planners/_shape.py": (
        *(RESULT, "planners/__init__.pyi", "from ._registry"),
        "from ._shape import Shape as Shape",
    ),
}
"""A file of each kind, its text, and the registry with the line that goes before another one."""
USED = """
from locplan import Costmap, load_map, plan, planners, plotting
grid = load_map("bay.yaml")
costs = Costmap.blank(grid, robot=0.1)
assert plan(costs, (1, 1), (2, 1), planner="crow").path.length == 1
assert plotting.bare_figure(grid).axes
made = planners.Shape(grid)
made.save("shaped")
assert planners.Shape.load("shaped") == made
print(made.summary())
"""


@pytest.fixture(scope="module")
def grown(tmp_path_factory):
    """A function that runs Python in a folder with a map, by a copy with one more of each kind."""
    home = tmp_path_factory.mktemp("grown")
    package = home / "locplan"
    shutil.copytree(
        Path(locplan.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__")
    )
    for name, (text, registry, before, line) in ADDED.items():
        (package / name).write_text(f"from __future__ import annotations\n{text}")
        lines = (package / registry).read_text().splitlines()
        place = next(n for n, each in enumerate(lines) if each.startswith(before))
        (package / registry).write_text("\n".join([*lines[:place], line, *lines[place:]]) + "\n")
    save_map(drawn("######", "#....#", "#....#", "######", resolution=0.5), home / "bay.yaml")
    # Kernels that are compiled anew would take a minute; on this map plain Python will do.
    own = {"PYTHONPATH": str(home), "NUMBA_DISABLE_JIT": "1", "LOCPLAN_CACHE": str(home / "cache")}

    def run(*words: object) -> str:
        words = (sys.executable, *map(str, words))
        done = subprocess.run(
            words, cwd=home, env=os.environ | own, capture_output=True, text=True, check=False
        )
        assert done.returncode in (0, 3), done.stderr
        return done.stdout

    return run


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("field bay.yaml --field everywhere", "the same everywhere"),
        ("export bay.yaml --to name --field everywhere --json", '"name"'),
        ("hello you", "hello you"),
    ],
)
def test_one_file_and_one_line_add_what_commands_know(grown, line, said):
    assert said in grown("-m", "locplan", *line.split())


def test_one_file_and_one_line_add_a_figure_and_a_result(grown):
    assert "{'rows': 4}" in grown("-c", USED)


def test_help_lists_the_added_command(grown):
    out = grown("-m", "locplan", "--help")
    assert "Greet somebody." in out
