"""The command line starts, reads and ends without work that nobody needs."""

import gc
import subprocess
import sys
import threading
import tracemalloc
from types import SimpleNamespace

import numpy as np
import pytest
import zarr
from conftest import drawn
from google_crc32c import value as crc32c
from numcodecs.zstd import Zstd

from locplan import __main__ as program, cli
from locplan._util import progress
from locplan.field import (
    FieldConfig,
    Sad,
    _tiles as tiles,
    _zarr as field_files,
    field_path,
    load_or_compute,
)

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
