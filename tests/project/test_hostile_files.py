"""Readers read damaged files, or refuse them in one line."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from hypothesis import given, settings
from support.hostile_files import READERS, damage

from locplan.errors import LocplanError

FEW, MANY = 10, 300
MAX_LINE = 1050
"""Length of a message [characters] that no error and no warning reaches."""


@contextmanager
def limited_memory(more: int = 2 * 10**9) -> Iterator[None]:
    """Let what takes so many bytes more fail, where the system can."""
    if sys.platform != "linux":
        yield
        return
    import resource

    taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (taken + more, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


@pytest.mark.parametrize("count", [FEW, pytest.param(MANY, marks=pytest.mark.long)])
@pytest.mark.parametrize("name", READERS)
def test_reader_survives_damaged_file(tmp_path, name, count):
    reader = READERS[name]
    reader.files(tmp_path)
    files = {str(each): each for each in tmp_path.glob(reader.pattern) if each.is_file()}
    valid = {each: file.read_bytes() for each, file in files.items()}
    assert valid

    @settings(max_examples=count, derandomize=True, deadline=None, database=None)
    @given(damage(reader.damages, valid))
    def check(damage: tuple[str, bytes]) -> None:
        file, content = damage
        files[file].write_bytes(content)
        said = []
        try:
            with warnings.catch_warnings(record=True) as caught, limited_memory():
                warnings.simplefilter("always")
                reader.read(files[file])
        except LocplanError as error:
            assert reader.may_refuse
            said.append(str(error))
        finally:
            files[file].write_bytes(valid[file])
        assert all(issubclass(each.category, UserWarning) for each in caught)
        for line in [*said, *(str(each.message) for each in caught)]:
            assert line.isprintable()
            assert 0 < len(line) < MAX_LINE

    check()
