"""Try an installed locplan outside its checkout: main commands, all modules, doctests, extras.

Run: python .ci/smoke.py [--extras dask,explore,...] [--quick]

Each extra in the list must work. Each other extra must be missing, and its feature must name it in
one line. Without --extras, all of them must work. --quick leaves out commands and doctests.
"""

from __future__ import annotations

import argparse
import doctest
import importlib
import os
import pkgutil
import re
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Callable
from importlib.metadata import metadata, version
from pathlib import Path

import numpy as np

import locplan
from locplan.comparison import compare
from locplan.errors import LocplanError

CHECKOUT = Path(__file__).resolve().parents[1]
LOCPLAN = [sys.executable, "-m", "locplan"]
ROUTE = ["--start", "2,3", "--goal", "38,3"]
ROOM = locplan.OccupancyGrid(np.full((60, 60), 254), resolution=0.1)
ENDS = (1.0, 1.0), (5.0, 5.0)
FIELD = locplan.FieldConfig(locplan.Sad(range=1.0), stride=1.0)
ONLY_OF_CHECKOUT = ("docs", "test")
"""Extras that nothing in the package uses."""


def run(*words: str, code: int = 0) -> str:
    """Return stdout and stderr of a command that must end with this exit code."""
    done = subprocess.run(
        [*LOCPLAN, *words], capture_output=True, text=True, encoding="utf-8", timeout=1800
    )
    text = done.stdout + done.stderr
    if done.returncode != code or "Traceback" in text:
        raise SystemExit(f"locplan {' '.join(words)}: exit code {done.returncode}\n{text}")
    return text


def check_package() -> None:
    """Check that locplan is imported from an installation, with types and its own version."""
    home = Path(locplan.__file__).resolve().parent
    assert CHECKOUT not in home.parents or "site-packages" in home.parts, f"imported from {home}"
    assert (home / "py.typed").is_file()
    assert locplan.__version__ == version("locplan")
    assert version("locplan") in run("--version")


def check_commands() -> None:
    """Run the main job and the commands next to it."""
    run("plan", "two_corridors", *ROUTE, "--lidar", "turtlebot4", "-o", "planned")
    assert Path("planned/choice.png").stat().st_size > 10_000
    assert Path("planned/chosen.csv").is_file()
    run("info", "two_corridors", "--lidar", "turtlebot4", "-o", "map.png")
    run("field", "two_corridors", "--field", "sad", "--stride", "2", "-o", "field.npz")
    run("export", "two_corridors", "--to", "nav2-keepout", "--choice", "planned", "-o", "mask")
    run("export", "two_corridors", "--to", "nav2-speed", "--lidar", "turtlebot4", "-o", "speed")
    assert Path("mask/mask.yaml").is_file()
    assert Path("speed/mask.yaml").is_file()
    message = run("plan", "nowhere.yaml", *ROUTE, code=2)
    assert len(message.strip().splitlines()) == 1, message


def check_modules() -> None:
    """Import all modules. Those of missing extras may fail."""
    for module in pkgutil.walk_packages(locplan.__path__, "locplan."):
        try:
            importlib.import_module(module.name)
        except (LocplanError, ModuleNotFoundError) as error:
            if "locplan" in str(getattr(error, "name", "")):
                raise
            print(f"  {module.name}: {error}")


def check_doctests() -> None:
    """Run the examples in docstrings."""
    attempted = failed = 0
    for module in pkgutil.walk_packages(locplan.__path__, "locplan."):
        if not module.name.endswith("__main__"):
            result = doctest.testmod(importlib.import_module(module.name))
            attempted, failed = attempted + result.attempted, failed + result.failed
    assert attempted > 100, f"only {attempted} examples"
    assert not failed, f"{failed} of {attempted} examples fail"


def use_dask() -> None:
    from distributed import Client

    with Client(n_workers=1, processes=False, dashboard_address=None) as client:
        locplan.covariance_field(ROOM, FIELD, executor=client.get_executor())


def use_explorer() -> None:
    words = ["explore", "two_corridors", "--no-browser"]
    server = subprocess.Popen(
        [*LOCPLAN, *words], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    assert server.stdout is not None
    try:
        text = ""
        for line in server.stdout:
            text += line
            if found := re.search(r"https?://\S+", line):
                with urllib.request.urlopen(found[0].rstrip("."), timeout=60) as page:
                    assert b"<html" in page.read().lower()
                return
        raise RuntimeError(text.strip())
    finally:
        server.terminate()
        server.wait(60)


def use_function() -> None:
    def plan_my_way(costs, start, goal):  # type: ignore[no-untyped-def]
        return locplan.plan(costs, start, goal)

    costs = locplan.Costmap.blank(ROOM, robot=0.25)
    (result,) = compare({"room": costs}, plan_my_way, [ENDS]).runs
    assert result.status == "solved"


def use_ompl() -> None:
    costs = locplan.Costmap.blank(ROOM, robot=0.25)
    plan = locplan.plan(costs, *ENDS, planner="RRT", iterations=2000)
    assert plan.status == "solved"


def use_bag() -> None:
    Path("empty.bag").write_bytes(b"#ROSBAG V2.0\n")
    text = run("recording", "empty.bag", "-o", "drive.npz", code=2).strip()
    if "locplan[" in text:
        raise RuntimeError(text)
    assert "empty.bag" in text, text


def use_tables() -> None:
    assert locplan.covariance_field(ROOM, FIELD).to_xarray().sizes
    plan = locplan.plan(locplan.Costmap.blank(ROOM, robot=0.25), *ENDS)
    assert len(plan.table().to_frame()) == 1


USES: dict[str, Callable[[], None]] = {
    "dask": use_dask,
    "explore": use_explorer,
    "functions": use_function,
    "ompl": use_ompl,
    "ros": use_bag,
    "tables": use_tables,
}
"""A use of each extra."""
ANSWERS = {"dask": "No module named 'distributed'", "ompl": "not available on"}
"""Messages that need not name the extra. With dask, the user imports the library."""


def check_extra(extra: str, *, is_installed: bool) -> None:
    """Check that an extra works, or that one line names it."""
    if is_installed:
        USES[extra]()
        return
    try:
        USES[extra]()
    except Exception as error:
        line = str(error)
    else:
        raise AssertionError(f"{extra} is not missing")
    print(f"  {line}")
    assert "\n" not in line, line
    assert f"locplan[{extra}]" in line or ANSWERS.get(extra, "?") in line, line


def main() -> None:
    """Run all checks in an empty folder, and print the seconds of each."""
    provided = {*(metadata("locplan").get_all("Provides-Extra") or ())} - {*ONLY_OF_CHECKOUT}
    assert provided == USES.keys(), f"no use of {provided ^ USES.keys()}"
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("--extras", default=",".join(USES))
    parser.add_argument("--quick", action="store_true")
    arguments = parser.parse_args()
    installed = {*filter(None, arguments.extras.split(","))}
    assert installed <= USES.keys(), f"no such extra: {installed - USES.keys()}"
    checks: list[tuple[str, Callable[[], None]]] = [
        ("package", check_package),
        *([] if arguments.quick else [("commands", check_commands)]),
        ("modules", check_modules),
        *((f"extra {extra}", lambda e=extra: check_extra(e, is_installed=e in installed))
          for extra in USES),
    ]  # fmt: skip
    if not arguments.quick and installed == USES.keys():
        checks.append(("doctests", check_doctests))
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        os.chdir(folder)
        os.environ["LOCPLAN_CACHE"] = str(Path(folder) / "cache")
        for name, check in checks:
            print(name, flush=True)
            start, used = time.perf_counter(), os.times()
            check()
            seconds, now = time.perf_counter() - start, os.times()
            cpu = sum(now[:4]) - sum(used[:4])
            print(f"  {seconds:.0f} s, {cpu:.0f} s of CPU", flush=True)
        os.chdir(CHECKOUT)


if __name__ == "__main__":
    main()
