"""Fixtures that several packages of tests share."""

from __future__ import annotations

import gc
import os
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
from _pytest.doctest import DoctestModule
from support.machine import SHARED_DATA

from locplan._support import progress
from locplan.app.cli import main
from locplan.field import FieldConfig, Sad, save_config


def pytest_configure() -> None:
    """Keep compiled modules, also if the environment forbids it.

    Tests start a hundred processes, each of which would compile the package, and pytest rewrites
    the tests' assertions.
    """
    sys.dont_write_bytecode = False
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)


def pytest_ignore_collect(collection_path, config):
    """Import neither helpers nor benchmarks to look for tests."""
    is_test = any(collection_path.match(pattern) for pattern in config.getini("python_files"))
    return True if collection_path.suffix == ".py" and not is_test else None


@pytest.hookimpl(wrapper=True)
def pytest_collect_file():
    """Look for doctests in the package only."""
    collectors = yield
    return [item for item in collectors if not isinstance(item, DoctestModule)]


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item):
    """Skip tests that fail because this system has no ompl."""
    return skip_without_ompl((yield), item)


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector):
    """Skip modules of tests that need ompl where this system has none."""
    return skip_without_ompl((yield), collector)


def skip_without_ompl(report, node):
    """Return the report; it becomes a skip if a failure names the missing ompl."""
    text = str(report.longrepr) if report.failed and find_spec("ompl") is None else ""
    if "OMPL's planners" in text or "No module named 'ompl'" in text:
        report.outcome = "skipped"
        report.longrepr = (str(node.path), 0, "Skipped: this system has no ompl")
    return report


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """Search for garbage rarely, and not among thousands of tests, which are kept to the end."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()
        gc.freeze()
        gc.set_threshold(20_000)


def pytest_unconfigure() -> None:
    """Let the end of the program free all, or OMPL's bindings report leaks."""
    gc.unfreeze()


@pytest.fixture(autouse=True)
def _own_cache(tmp_path_factory, monkeypatch):
    """No test reads or writes the user's cache."""
    monkeypatch.setenv("LOCPLAN_CACHE", str(tmp_path_factory.getbasetemp() / "cache"))


@pytest.fixture
def run(monkeypatch, capsys):
    """Function that runs a command; its log does not depend on the speed of the machine."""
    monkeypatch.setattr(progress, "DISPLAY_DELAY", 3600.0)

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
    save_config(FieldConfig(Sad(range=1.0)), file)
    return file


@pytest.fixture
def inline_workers(monkeypatch):
    """Comparisons start no processes: for tests of what is compared, not of what runs it."""
    from support.comparison_runs import InlineWorkers

    monkeypatch.setattr("locplan.comparison.experiment.WorkerPool", InlineWorkers)


@pytest.fixture
def undrawn(monkeypatch):
    """Pictures are empty files, since drawing takes longer than what the test looks at."""
    from locplan._support.drawing import NotebookFigure

    def write_nothing(_, target, **_options):
        if isinstance(target, str | Path):
            Path(target).touch()

    monkeypatch.setattr(NotebookFigure, "savefig", write_nothing)


@pytest.fixture
def coarse_fit(monkeypatch):
    """Search moves that fit a drive to a map in cells of half a metre, which is faster.

    For tests of sentences on a fit; test_map_fit.py tests the search.
    """
    monkeypatch.setattr("locplan.recordings.map_fit.FINEST", 0.5)


@pytest.fixture
def real_maps() -> Path:
    folder = SHARED_DATA / "rosmaps"
    if not folder.is_dir():
        pytest.skip("the collection of real maps (../shared/data/rosmaps) is not here")
    return folder


@pytest.fixture(scope="module")
def browser():
    """Chromium; what needs it is skipped where it is missing."""
    from support.browser import FLAGS, browser_file

    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if browser_file() is None:
        pytest.skip("no chromium on this machine")
    with sync_api.sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=browser_file(), args=FLAGS)
        yield chromium
        chromium.close()
