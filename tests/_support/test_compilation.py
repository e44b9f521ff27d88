import logging
import os
import time
from types import SimpleNamespace

import numba
import pytest
from numba.core import config

from locplan._support import compilation


@pytest.fixture
def package(tmp_path):
    kernels = tmp_path / "package" / "field" / "kernels"
    kernels.mkdir(parents=True)
    (kernels / "inner.py").write_text("one = 1\n")
    (kernels / "outer.py").write_text("from inner import one\n")
    return tmp_path / "package"


@pytest.fixture
def root(tmp_path, monkeypatch):
    """A folder of compiled kernels that is empty, for a process that has just begun."""
    monkeypatch.setattr(compilation, "find_kernel_root", lambda: tmp_path / "kernels")
    compilation.find_kernel_folder.cache_clear()
    yield tmp_path / "kernels"
    compilation.find_kernel_folder.cache_clear()


def test_digest_follows_all_sources_and_versions(package, monkeypatch):
    kernels = package / "field" / "kernels"
    digests = [compilation.compute_digest(package)]
    (kernels / "inner.py").write_text("one = 2\n")
    digests.append(compilation.compute_digest(package))
    (kernels / "inner.py").rename(kernels / "inmost.py")
    digests.append(compilation.compute_digest(package))
    (package / "kernels").mkdir()
    (package / "kernels" / "more.py").touch()
    digests.append(compilation.compute_digest(package))
    monkeypatch.setattr(compilation, "__version__", "0.0.1")
    digests.append(compilation.compute_digest(package))
    monkeypatch.setattr(numba, "__version__", "0.0.1")
    digests.append(compilation.compute_digest(package))
    assert len(set(digests)) == len(digests)
    (package / "other.py").touch()
    assert compilation.compute_digest(package) == digests[-1]


def test_digest_includes_kernels_of_package(tmp_path):
    """A pattern that matches nothing would keep machine code of other versions."""
    empty = compilation.compute_digest(tmp_path)
    assert compilation.compute_digest(compilation.PACKAGE) != empty


def make_kernel():
    @compilation.njit(nogil=True, cache=True)
    def double(value: float) -> float:
        return 2.0 * value

    return double


def test_kernel_cache_has_folder_per_version(root):
    before = config.CACHE_DIR
    assert make_kernel()(2.0) == 4.0
    (folder,) = root.iterdir()
    assert folder == compilation.find_kernel_folder()
    assert list(folder.rglob("*.nbc"))
    assert before == config.CACHE_DIR  # users' functions stay where they are


def test_kernel_runs_without_writable_cache(root):
    root.write_text("a file")
    kernel = make_kernel()
    assert kernel.stats.cache_path is None
    assert kernel(2.0) == 4.0


def test_new_folder_replaces_unused_ones(root):
    old, recent, foreign = (root / f"locplan-{16 * digit}" for digit in "01x")
    for folder in (old, recent, foreign):
        folder.mkdir(parents=True)
    week = time.time() - 8 * 86400.0
    for folder in (old, foreign):
        os.utime(folder, (week, week))
    folder = compilation.find_kernel_folder()
    assert sorted(root.iterdir()) == sorted([recent, foreign, folder])


@pytest.fixture
def compile_for(monkeypatch, caplog):
    """Function that compiles a function of a module for some seconds; returns the log's lines."""
    caplog.set_level(logging.INFO, "locplan")
    log, now = compilation.CompilationLog(), [0.0]
    monkeypatch.setattr(compilation.time, "monotonic", lambda: now[0])

    def compile_function(seconds, module="locplan.field.kernels.sad"):
        dispatcher = SimpleNamespace(py_func=SimpleNamespace(__module__=module))
        event = SimpleNamespace(data={"dispatcher": dispatcher})
        for step in (log.on_start, log.on_start, log.on_end):
            step(event)
        now[0] += seconds
        log.on_end(event)
        assert log.depth == 0
        now[0] += 100.0  # other work does not count
        return [record.getMessage() for record in caplog.records]

    return compile_function


def test_long_compilation_is_logged_once(compile_for):
    assert [len(compile_for(0.4)) for _ in range(5)] == [0, 0, 1, 1, 1]
    assert compile_for(0.4) == ["compiling kernels for their first use, which takes up to a minute"]


def test_log_omits_compilation_of_user_functions(compile_for):
    assert compile_for(5.0, "my_estimator") == []


def test_log_names_remedy_for_uncached_kernels(compile_for, root):
    root.write_text("a file")
    (line,) = compile_for(2.0)
    assert "set NUMBA_CACHE_DIR" in line


def test_compilation_is_noticed_while_it_lasts(root, monkeypatch):
    noticed = []
    monkeypatch.setattr(
        compilation.CompilationLog,
        "_log_if_long",
        lambda *_: noticed.append(compilation.is_compiling()),
    )
    make_kernel()(3)
    assert noticed == [True, True]
    assert not compilation.is_compiling()
    make_kernel()(3)  # is read from the cache
    assert len(noticed) == 2
