"""The command line starts, reads and ends without work that nobody needs."""

import gc
import runpy
import subprocess
import sys
from types import SimpleNamespace

import pytest
from support.maps import ascii_map

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


@pytest.mark.parametrize("name", cli.COMMANDS)
def test_summary_equals_first_paragraph_of_command_help(name):
    text = make_application(name)[name].help
    assert read_summary(name) == " ".join(text.partition("\n\n")[0].split()) != ""


@pytest.mark.parametrize("ompl", [True, False])
def test_the_search_for_garbage_ends_with_the_program(monkeypatch, ompl):
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
