import os
import tempfile

import platformdirs
import pytest

from locplan._support import user_cache


@pytest.fixture
def home(tmp_path, monkeypatch):
    """A home that has no cache folder yet, and an empty folder for temporary files."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(platformdirs, "user_cache_path", lambda name: tmp_path / "home" / name)
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    return tmp_path / "home"


@pytest.fixture
def substitute(home):
    """The substitute of a home that cannot be written."""
    home.write_text("a file")
    name = f"locplan-{os.getuid() if hasattr(os, 'getuid') else 'cache'}"
    return home.parent / "temporary" / name


def test_user_cache_lies_in_home(home, caplog):
    assert user_cache.find_user_cache() == home / "locplan"
    assert user_cache.find_kernel_root() == home / "locplan" / "kernels"
    assert not caplog.records
    assert not home.exists()


def test_unwritable_home_has_substitute(home, substitute, caplog):
    assert user_cache.find_user_cache() == substitute
    assert user_cache.find_user_cache() == substitute
    (record,) = caplog.records  # not one for each file
    assert str(home / "locplan") in record.getMessage()
    assert str(substitute) in record.getMessage()


@pytest.mark.skipif(os.name != "posix", reason="Windows has no modes of folders")
def test_substitute_is_private(substitute):
    assert user_cache.find_user_cache().stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize("folder", ["~/.cache/locplan", None])
def test_missing_home_has_substitute(substitute, monkeypatch, folder):
    def find(_):
        if folder is None:
            raise RuntimeError("could not determine the home directory")
        return user_cache.Path(folder)  # of older versions of platformdirs

    monkeypatch.setattr(platformdirs, "user_cache_path", find)
    assert user_cache.find_user_cache() == substitute


@pytest.mark.skipif(os.name != "posix", reason="Windows has no modes of folders")
@pytest.mark.parametrize("kind", ["writable for all", "link", "file"])
def test_substitute_of_another_user_is_refused(home, substitute, kind, caplog):
    """Machine code from it could do anything."""
    if kind == "link":
        (home.parent / "foreign").mkdir(mode=0o700)
        substitute.symlink_to(home.parent / "foreign")
    elif kind == "file":
        substitute.touch()
    else:
        substitute.mkdir()
        substitute.chmod(0o777)
    assert user_cache.find_user_cache() == home / "locplan"
    assert not caplog.records


def test_kernel_root_is_numbas_if_writable(home, tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "numba"))
    assert user_cache.find_kernel_root() == tmp_path / "numba"
    (tmp_path / "numba").touch()
    assert user_cache.find_kernel_root() == home / "locplan" / "kernels"
