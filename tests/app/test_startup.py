"""The command line starts, reads and ends without work that nobody needs."""

import ast
import gc
import os
import runpy
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from support.maps import ascii_map

import locplan
from locplan._support import progress
from locplan.app import cli
from locplan.app.cli.application import make_application, read_summary
from locplan.field import FieldConfig, Sad, load_or_compute

CONFIG = FieldConfig(Sad(range=0.5))


@pytest.fixture
def folder(tmp_path):
    grid = ascii_map("#" * 40, *["#" + "." * 38 + "#"] * 30, "#" * 40, resolution=0.1)
    load_or_compute(grid, CONFIG, cache_dir=tmp_path)
    return SimpleNamespace(grid=grid, cache=tmp_path)


def test_cached_field_is_read_without_numba(folder):
    code = (
        "import sys, numpy as np, locplan;"
        "from locplan.field import FieldConfig, Sad, load_or_compute;"
        f"cells = np.array({folder.grid.cells.tolist()}, np.uint8);"
        "grid = locplan.OccupancyGrid(cells, 0.1);"
        f"load_or_compute(grid, FieldConfig(Sad(range=0.5)), cache_dir={str(folder.cache)!r});"
        "print(sorted({'numba', 'matplotlib'} & set(sys.modules)))"
    )
    made = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert made.stdout.strip() == "[]", made.stderr


def test_help_lists_commands_without_import():
    """Their imports would take most of its time: numpy alone a tenth of a second."""
    code = (
        "import sys\nfrom locplan.app.cli import main\nsys.argv = ['locplan', '--help']\n"
        "try:\n    main()\nfinally:\n"
        "    print([m for m in sys.modules if m == 'numpy' or m.endswith('cli.export')])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout.splitlines()[-1] == "[]", done.stderr


def start_with_python_path(code, *folders):
    path = os.pathsep.join(map(str, folders))
    env = {**os.environ, "PYTHONPATH": path}
    return subprocess.run([sys.executable, *code], env=env, capture_output=True, text=True)


def test_ros_packages_never_replace_dependencies(tmp_path):
    """A sourced ROS sets PYTHONPATH, which may have packages for another Python."""
    for name in ("numpy", "PIL", "yaml"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("raise ImportError('for Python 3.10')")
    root = Path(locplan.__file__).parents[1]
    done = start_with_python_path(
        ["-m", "locplan", "info", str(root / "maps" / "two_corridors.yaml")], tmp_path
    )
    assert done.returncode == 0, done.stderr
    assert "two_corridors" in done.stdout


def test_folder_of_locplan_keeps_its_place(tmp_path):
    """It may have the dependencies; other folders of PYTHONPATH are searched last."""
    root = Path(locplan.__file__).parents[1]
    code = (
        "import sys; from locplan.__main__ import main; sys.argv = ['locplan', '--version']\n"
        "try:\n    main()\nfinally:\n    print(sys.path)"
    )
    done = start_with_python_path(["-c", code], tmp_path, root)
    path = ast.literal_eval(done.stdout.splitlines()[-1])
    assert path[-1] == str(tmp_path)
    assert path.index(str(root)) <= 1


@pytest.mark.parametrize("name", cli.COMMANDS)
def test_summary_equals_first_help_paragraph(name):
    text = make_application(name)[name].help
    assert read_summary(name) == " ".join(text.partition("\n\n")[0].split()) != ""


@pytest.mark.parametrize("ompl", [True, False])
def test_garbage_collection_stops_at_exit(monkeypatch, ompl):
    done = []
    for name in ("set_threshold", "disable", "freeze"):
        monkeypatch.setattr(gc, name, lambda *_, name=name: done.append(name))
    monkeypatch.setattr(cli, "main", lambda: done.append("work"))
    monkeypatch.delitem(sys.modules, "ompl", raising=False)
    if ompl:
        monkeypatch.setitem(sys.modules, "ompl", cli)  # its bindings would report leaks
    runpy.run_module("locplan", run_name="program")["run_command_line"]()
    assert done == ["set_threshold", "work", *([] if ompl else ["disable", "freeze"])]


def test_bar_shows_compilation_while_it_lasts(monkeypatch):
    from locplan._support import compilation

    bar = progress._ProgressBar("field", "cells", "starting")
    assert str(bar) == "starting"
    monkeypatch.setattr(compilation, "is_compiling", lambda: True)
    assert str(bar) == progress.COMPILING
    monkeypatch.undo()
    assert str(bar) == "starting"
    bar.update(10, 100)
    assert str(bar) == ""
