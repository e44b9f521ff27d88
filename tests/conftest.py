"""What several tests share."""

from __future__ import annotations

import math
import os
import pickle
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.kernel_cache import keep_kernels

from locplan.app.cli import main
from locplan.field import FieldConfig, Sad, save_config
from locplan.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid

GUARD = 600.0
"""Time after which an answer does not come any more, however busy the machine is [s]."""
SHARED_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


def pytest_configure() -> None:
    """Keep compiled kernels, before numba is imported; worker processes inherit the folder.

    They keep compiled modules, too, as Python does where nobody forbids it: tests start a hundred
    processes, of which each would compile the package, and pytest rewrites the tests' assertions.
    """
    keep_kernels()
    sys.dont_write_bytecode = False
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)


respects_permissions = pytest.mark.skipif(
    sys.platform == "win32" or getattr(os, "geteuid", int)() == 0,
    reason="no permission stops root, nor are folders read-only on Windows",
)


@pytest.fixture(autouse=True)
def _own_cache(tmp_path_factory, monkeypatch):
    """No test reads or writes the user's cache."""
    monkeypatch.setenv("LOCPLAN_CACHE", str(tmp_path_factory.getbasetemp() / "cache"))


@pytest.fixture
def run(monkeypatch, capsys):
    def call(*arguments):
        monkeypatch.setattr(sys, "argv", ["locplan", *map(str, arguments)])
        try:
            main()
            code = 0
        except SystemExit as stop:
            code = stop.code or 0
        out, err = capsys.readouterr()
        return code, out, err

    return call


@pytest.fixture
def small_field(tmp_path_factory) -> Path:
    """Settings of a field for --field that is quick to compute: the paper's disc of 1 m."""
    file = tmp_path_factory.mktemp("settings") / "small.json"
    save_config(file, FieldConfig(Sad(range=1.0)))
    return file


class InlineWorkers:
    """The workers of a comparison in this process: what they are sent is copied as for others."""

    def __init__(self, planners, count, **_):
        import cloudpickle

        self.planners = pickle.loads(cloudpickle.dumps(list(planners)))

    def __enter__(self):
        for spec in self.planners:
            spec.planner.prepare()
        return self

    def __exit__(self, *_):
        pass

    def run(self, orders):
        from locplan.comparison.runs import perform

        for order in orders:
            run = perform(self.planners[order.planner], order, math.inf)
            yield replace(run, wall_seconds=run.seconds)


@pytest.fixture
def inline_workers(monkeypatch):
    """Comparisons start no processes: for tests of what is compared, not of what runs it."""
    monkeypatch.setattr("locplan.comparison.comparing.Workers", InlineWorkers)


@pytest.fixture
def coarse_fit(monkeypatch):
    """Moves that fit a drive to a map are searched in cells of half a metre, which takes a part.

    For tests of what is said of a fit; those in test_map_fit.py hold the search itself.
    """
    monkeypatch.setattr("locplan.recordings.map_fit.FINEST", 0.5)


@pytest.fixture
def real_maps() -> Path:
    folder = SHARED_DATA / "rosmaps"
    if not folder.is_dir():
        pytest.skip("the collection of real maps (../shared/data/rosmaps) is not here")
    return folder


def few_of(values, usual: int = 1, *, are_rows: bool = False) -> list:
    """Parameters of a test: the first ones by default, the others with `-m long`.

    Rows have a value for each of several arguments.
    """
    rows = values[usual:] if are_rows else [(value,) for value in values[usual:]]
    long = [pytest.param(*row, marks=pytest.mark.long) for row in rows]
    return [*values[:usual], *long]


def changed(config: FieldConfig, **settings) -> FieldConfig:
    """The same with other settings of its estimator."""
    return replace(config, estimator=replace(config.estimator, **settings))


def refused(result) -> str:
    code, out, err = result
    assert code == 2
    assert out == ""
    assert err.startswith("locplan: error: ")
    assert err.count("\n") == 1
    return err


def drawn(*lines: str, resolution: float = 1.0, origin=(0.0, 0.0, 0.0)) -> OccupancyGrid:
    """A grid from a drawing, its first line at the top: '.' free, '#' occupied, ' ' unknown."""
    levels = {".": FREE, "#": OCCUPIED, " ": UNKNOWN}
    cells = [[levels[character] for character in line] for line in reversed(lines)]
    return OccupancyGrid(np.array(cells, np.uint8), resolution, origin)


def random_rooms(shape: tuple[int, int], seed: int, *, blocks: int = 14) -> np.ndarray:
    """Levels of a map with random boxes of all three levels, deterministic."""
    rng = np.random.default_rng(seed)
    cells = np.full(shape, FREE, np.uint8)
    for _ in range(blocks):
        top, left = rng.integers(0, shape[0]), rng.integers(0, shape[1])
        height, width = rng.integers(2, max(3, min(shape) // 4), 2)
        cells[top : top + height, left : left + width] = rng.choice([OCCUPIED, UNKNOWN, FREE])
    return cells


def corridor(
    length: float, width: float, *, angle: float = 0.0, resolution: float = 0.05
) -> OccupancyGrid:
    """A straight corridor with walls, unknown beyond, its axis turned by `angle` [rad]."""
    half = int((length / 2 + 1) / resolution)
    y, x = np.mgrid[-half:half, -half:half] + 0.5
    along = (np.cos(angle) * x + np.sin(angle) * y) * resolution
    across = (np.cos(angle) * y - np.sin(angle) * x) * resolution
    cells = np.full(x.shape, UNKNOWN, np.uint8)
    cells[(abs(across) < width / 2 + 0.15) & (abs(along) < length / 2)] = OCCUPIED
    cells[(abs(across) < width / 2) & (abs(along) < length / 2)] = FREE
    return OccupancyGrid(cells, resolution, (-half * resolution, -half * resolution, 0.0))


@pytest.fixture(scope="module")
def browser():
    """Chromium; what needs it is skipped where it is missing."""
    from support.explorer_page import FLAGS, browser_file

    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if browser_file() is None:
        pytest.skip("no chromium on this machine")
    with sync_api.sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=browser_file(), args=FLAGS)
        yield chromium
        chromium.close()
