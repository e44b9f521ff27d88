"""The command line starts, reads and ends without work that nobody needs."""

import gc
import os
import pickle
import subprocess
import sys
import threading
import tracemalloc
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import zarr
from conftest import drawn
from google_crc32c import value as crc32c
from numcodecs.zstd import Zstd

from locplan import __main__ as program, _kernels as compilation, cli
from locplan._util import progress
from locplan.field import (
    FieldConfig,
    Sad,
    _tiles as tiles,
    _zarr as field_files,
    field_path,
    load_or_compute,
)
from locplan.maps import save_map
from locplan.planners import _ahead as ahead
from locplan.simulation import _simulate as compiling

CONFIG = FieldConfig(Sad(range=0.5))


@pytest.fixture
def folder(tmp_path):
    grid = drawn("#" * 40, *["#" + "." * 38 + "#"] * 30, "#" * 40, resolution=0.1)
    field = load_or_compute(grid, CONFIG, cache_dir=tmp_path)
    return SimpleNamespace(
        path=field_path(grid, CONFIG, tmp_path), field=field, grid=grid, cache=tmp_path
    )


def read(folder):
    shape = tiles.field_shapes(folder.grid, CONFIG)["covariance"]
    return tiles.read_array(folder.path / "covariance", shape)


def test_chunks_are_read_as_zarr_reads_them(folder):
    values, damaged = read(folder)
    assert not damaged
    assert np.isfinite(values).any()
    np.testing.assert_array_equal(values, zarr.open_array(folder.path / "covariance", mode="r")[:])
    cells, damaged = tiles.read_array(folder.path / "cells", folder.grid.shape, "uint8")
    np.testing.assert_array_equal(cells, folder.grid.cells)
    edge = field_files._edge(folder.grid, CONFIG)
    assert tiles.chunk_of(folder.path / "covariance", values.shape)[:2] == (edge, edge)


def test_absent_and_damaged_chunks_are_nan_and_the_latter_counted(folder):
    (chunk, *_) = sorted(folder.path.glob("covariance/c.*"))
    content = chunk.read_bytes()
    chunk.unlink()
    values, damaged = read(folder)
    assert np.isnan(values).all()
    assert not damaged
    body = Zstd().encode(bytes(10**8))  # zeros, much more than the chunk's
    bomb = body + crc32c(body).to_bytes(4, "little")
    for wrong in (content[:-1], content[:-1] + bytes([content[-1] ^ 1]), b"", bomb):
        chunk.write_bytes(wrong)
        tracemalloc.start()
        values, damaged = read(folder)
        assert tracemalloc.get_traced_memory()[1] < 10**7
        tracemalloc.stop()
        assert damaged == 1
        assert np.isnan(values).all()
    chunk.write_bytes(content)
    assert read(folder)[1] == 0


@pytest.mark.parametrize(
    ("old", "new"),
    [('"float64"', '"float32"'), ('"little"', '"big"'), ('"zstd"', '"gzip"'), ('"NaN"', "0.0")],
)
def test_arrays_of_another_kind_are_not_read(folder, old, new):
    about = folder.path / "covariance" / "zarr.json"
    text = about.read_text()
    assert old in text
    about.write_text(text.replace(old, new))
    with pytest.raises(ValueError, match="does not fit"):
        read(folder)


def test_a_cached_field_is_read_without_numba_and_zarr(folder):
    code = (
        "import sys, numpy as np, locplan;"
        "from locplan.field import FieldConfig, Sad, load_or_compute;"
        f"cells = np.array({folder.grid.cells.tolist()}, np.uint8);"
        "grid = locplan.OccupancyGrid(cells, 0.1);"
        f"load_or_compute(grid, FieldConfig(Sad(range=0.5)), cache_dir={str(folder.cache)!r});"
        "print(sorted({'numba', 'zarr', 'matplotlib'} & set(sys.modules)))"
    )
    made = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert made.stdout.strip() == "[]", made.stderr


@pytest.mark.parametrize("ompl", [True, False])
def test_the_search_for_garbage_ends_with_the_program(monkeypatch, ompl):
    done = []
    for name in ("set_threshold", "disable", "freeze"):
        monkeypatch.setattr(gc, name, lambda *_, name=name: done.append(name))
    monkeypatch.setattr(cli, "main", lambda: done.append("work"))
    monkeypatch.delitem(sys.modules, "ompl", raising=False)
    if ompl:
        monkeypatch.setitem(sys.modules, "ompl", cli)  # its bindings would report leaks
    program.work()
    assert done == ["set_threshold", "work", *([] if ompl else ["disable", "freeze"])]


@dataclass(frozen=True)
class Noted:
    """A planner that notes the process in which it was prepared."""

    file: Path
    fails: bool = False
    name = "noted"

    def prepare(self):
        if self.fails:
            raise RuntimeError("not here")
        self.file.write_text(str(os.getpid()))


def test_a_planner_is_prepared_in_another_process(tmp_path, monkeypatch):
    monkeypatch.setattr(ahead, "_compiled", lambda: False)
    with ahead.prepared_beside(Noted(tmp_path / "pid")) as ready:
        ready()
    assert int((tmp_path / "pid").read_text()) != os.getpid()


def test_no_process_is_made_where_all_is_compiled_or_nothing_can_be_sent(tmp_path, monkeypatch):
    monkeypatch.setattr(ahead.subprocess, "Popen", lambda *_, **__: pytest.fail("a process"))
    monkeypatch.setattr(ahead, "_compiled", lambda: True)
    with ahead.prepared_beside(Noted(tmp_path / "pid")) as ready:
        ready()
    monkeypatch.setattr(ahead, "_compiled", lambda: False)
    with ahead.prepared_beside(lambda: None):
        pass


def test_one_plans_without_another_process_where_none_can_be_started(tmp_path, monkeypatch):
    monkeypatch.setattr(ahead, "_compiled", lambda: False)
    monkeypatch.setattr(ahead.sys, "executable", str(tmp_path / "no such program"))
    with ahead.prepared_beside(Noted(tmp_path / "pid")) as ready:
        ready()
    assert not list(tmp_path.iterdir())


def test_a_process_that_fails_disturbs_nobody_and_one_that_is_not_needed_ends(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(ahead, "_compiled", lambda: False)
    with ahead.prepared_beside(Noted(tmp_path / "pid", fails=True)) as ready:
        ready()
    made, popen = [], subprocess.Popen
    monkeypatch.setattr(
        ahead.subprocess, "Popen", lambda *a, **k: made.append(popen(*a, **k)) or made[0]
    )
    with pytest.raises(KeyError), ahead.prepared_beside(Noted(tmp_path / "pid")):
        raise KeyError
    assert made[0].poll() is not None


def test_the_kernels_of_drives_are_prepared_beside_the_field_of_a_lidar(tmp_path, run, monkeypatch):
    grid = drawn("#" * 20, *["#" + "." * 18 + "#"] * 8, "#" * 20, resolution=0.2)
    save_map(grid, tmp_path / "room.yaml")
    events = []

    @contextmanager
    def beside(user, compiled=None):
        if isinstance(user, compiling.DriveKernels):
            events.append(("begun", compiled()))
        yield lambda: events.append(("awaited", user.name))

    compiling.DriveKernels().prepare()  # "compiled" holds from here on
    monkeypatch.setattr(compiling, "prepared_beside", beside)
    ends = ("--start", "0.7,0.7", "--goal", "3.1,1.1", "--lidar", "rplidar-a1", "--set", "range=1")
    kept = ("--estimator", "fisher", "--cache-dir", tmp_path / "c")
    for options in ((), ("--drives", "0"), ()):
        code, _, err = run("plan", tmp_path / "room.yaml", *ends, *kept, *options)
        assert code == 0, err
    awaited = ("awaited", "simulating")
    assert [each for each in events if each != awaited] == [
        ("begun", True),  # and none where nothing is driven
        ("begun", True),
    ]
    assert events[1] == events[-1] == awaited


def test_kernels_count_as_cached_only_where_the_cache_has_them(tmp_path, monkeypatch):
    cache = SimpleNamespace(_load_index=dict)
    kernel = SimpleNamespace(_cache=SimpleNamespace(_cache_file=cache))
    assert not compilation.are_cached(kernel)
    cache._load_index = lambda: {"signature": "file"}
    assert compilation.are_cached(kernel)
    assert compilation.are_cached(len)  # without numba there is no cache
    cache._load_index = lambda: pickle.loads(b"cut")
    assert compilation.are_cached(kernel)


def test_the_bar_says_that_it_compiles_only_while_it_does():
    from numba.core.compiler_lock import global_compiler_lock

    bar = progress._Bar("field", "cells", "starting")
    assert str(bar) == "starting"
    held, done = threading.Event(), threading.Event()

    def compile_something():
        with global_compiler_lock:
            held.set()
            done.wait()

    thread = threading.Thread(target=compile_something)
    thread.start()
    held.wait()
    assert [str(bar) for _ in range(3)] == ["starting", progress.COMPILING, progress.COMPILING]
    done.set()
    thread.join()
    bar.update(10, 100)
    assert str(bar) == ""


def test_a_kernel_read_from_the_cache_is_not_called_compiled(monkeypatch):
    bar = progress._Bar("field", "cells", "starting")
    looks = iter([True, False, True, False])
    monkeypatch.setattr(progress, "is_compiling", lambda: next(looks))
    assert [str(bar) for _ in range(4)] == ["starting"] * 4
