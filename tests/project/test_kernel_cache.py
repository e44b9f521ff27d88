"""The folder of compiled kernels follows all their sources."""

import os
import subprocess
import sys

import pytest
from support import kernel_cache


@pytest.fixture
def kernels(tmp_path):
    folder = tmp_path / "kernels"
    folder.mkdir()
    (folder / "inner.py").write_text("one = 1\n")
    (folder / "outer.py").write_text("from inner import one\n")
    return folder


def test_a_change_of_any_source_or_name_or_of_numba_has_its_own_folder(kernels):
    digests = [kernel_cache.digest_of(kernels, "0.61")]
    digests.append(kernel_cache.digest_of(kernels, "0.62"))
    (kernels / "inner.py").write_text("one = 2\n")
    digests.append(kernel_cache.digest_of(kernels, "0.61"))
    (kernels / "inner.py").rename(kernels / "inmost.py")
    digests.append(kernel_cache.digest_of(kernels, "0.61"))
    (kernels / "new").mkdir()
    (kernels / "new" / "kernel.py").touch()
    digests.append(kernel_cache.digest_of(kernels, "0.61"))
    assert len(set(digests)) == len(digests)
    (kernels / "__pycache__").mkdir()
    (kernels / "__pycache__" / "outer.nbi").touch()
    assert kernel_cache.digest_of(kernels, "0.61") == digests[-1]


@pytest.fixture
def _untold(monkeypatch):
    monkeypatch.setenv(kernel_cache.VARIABLE, "")


@pytest.mark.usefixtures("_untold")
def test_the_folder_is_told_to_numba(kernels, tmp_path):
    kernel_cache.keep_kernels(tmp_path / "kept", kernels)
    (folder,) = (tmp_path / "kept").iterdir()
    assert os.environ[kernel_cache.VARIABLE] == str(folder)
    assert not list(folder.iterdir())
    kernel_cache.keep_kernels(tmp_path / "other", kernels)  # the user's own is kept
    assert os.environ[kernel_cache.VARIABLE] == str(folder)


@pytest.mark.usefixtures("_untold")
def test_a_folder_that_cannot_be_written_is_left_alone(kernels, tmp_path):
    (tmp_path / "kept").write_text("a file")
    kernel_cache.keep_kernels(tmp_path / "kept", kernels)
    assert not os.environ[kernel_cache.VARIABLE]


def test_the_tests_name_it_before_numba_is_imported():
    code = "import sys; sys.path.insert(0, 'tests'); import conftest; print('numba' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"
