import os
import time

import pytest
from support.maps import random_rooms

from locplan._support.output import temporary_folder
from locplan.errors import ConfigError, LocplanError
from locplan.field import FieldConfig, Sad, SearchWindow, cache, load_or_compute
from locplan.field.cache import format_cache_table, list_cache_entries, load_or_compute_result
from locplan.field.store import field_path
from locplan.maps import OccupancyGrid

QUICK = FieldConfig(Sad(range=0.6, window=SearchWindow(half_width=0.4)))


@pytest.fixture
def three_fields(tmp_path):
    """A cache of three fields, used 1, 2 and 3 days ago."""
    paths = []
    for days in (1, 2, 3):
        grid = OccupancyGrid(random_rooms((40, 50), seed=days), 0.1, name=f"rooms {days}")
        load_or_compute(grid, QUICK, cache_dir=tmp_path)
        paths.append(field_path(grid, QUICK, tmp_path))
        used = time.time() - days * 86400 - 60
        os.utime(paths[-1], (used, used))
    return paths


def list_map_names(folder) -> list[str]:
    return [entry.metadata["map"] for entry in list_cache_entries(folder)]


def test_cache_lists_last_used_entry_first(three_fields, tmp_path):
    assert list_map_names(tmp_path) == ["rooms 1", "rooms 2", "rooms 3"]
    os.utime(three_fields[1])
    assert list_map_names(tmp_path) == ["rooms 2", "rooms 1", "rooms 3"]


def test_cache_entry_describes_saved_field(three_fields, tmp_path):
    entry = list_cache_entries(tmp_path)[0]
    assert entry.path == three_fields[0]
    assert entry.size == three_fields[0].stat().st_size
    assert (entry.kind, entry.finished_share) == ("field", 1.0)
    assert "field rooms 1 sad, disc" in " ".join(format_cache_table([entry], tmp_path).split())


def test_eviction_removes_least_recently_used_field(three_fields, tmp_path):
    size = sum(path.stat().st_size for path in three_fields[:2])
    cache.evict_results(tmp_path, size, three_fields[0])
    assert list_map_names(tmp_path) == ["rooms 1", "rooms 2"]
    cache.evict_results(tmp_path, 1, three_fields[1])
    assert list_map_names(tmp_path) == ["rooms 2"]


def test_new_field_evicts_older_fields(three_fields, tmp_path, monkeypatch):
    monkeypatch.setenv("LOCPLAN_CACHE_SIZE", str(three_fields[0].stat().st_size))
    grid = OccupancyGrid(random_rooms((40, 50), seed=9), 0.1, name="new")
    load_or_compute(grid, QUICK, cache_dir=tmp_path)
    assert list_map_names(tmp_path) == ["new"]


def test_clear_cache_keeps_locked_field(three_fields, tmp_path):
    """Another process may be computing it."""
    with cache.make_lock(three_fields[1]):
        removed, busy = cache.clear_cache(tmp_path, 0)
    assert [entry.path for entry in busy] == [three_fields[1]]
    assert {entry.path for entry in removed} == {three_fields[0], three_fields[2]}
    assert list_map_names(tmp_path) == ["rooms 2"]


def test_clear_cache_keeps_recently_used_field(three_fields, tmp_path):
    cache.clear_cache(tmp_path, 2)
    assert list_map_names(tmp_path) == ["rooms 1"]


def test_cache_lists_and_removes_unreadable_entries(three_fields, tmp_path):
    three_fields[0].write_text("{")
    for suffix in (".parts", ".zarr", ".kept"):
        (tmp_path / ("0" * 32 + suffix)).mkdir()
        (tmp_path / ("0" * 32 + suffix) / "zarr.json").write_text("{}")
    kinds = sorted(entry.kind for entry in list_cache_entries(tmp_path))
    assert kinds == ["damaged", "field", "field", *["outdated"] * 2, "unfinished"]
    assert "6 results" in format_cache_table(list_cache_entries(tmp_path), tmp_path)
    cache.clear_cache(tmp_path, 0)
    assert list_cache_entries(tmp_path) == []
    assert [path.name for path in tmp_path.iterdir()] == ["locks"]


def test_cache_removes_only_abandoned_temporary_folders(three_fields, tmp_path):
    """A live process holds its temporary folder."""
    abandoned = tmp_path / ".locplan-tmp-a1b2c3d4"
    (abandoned / "c").mkdir(parents=True)
    others = [tmp_path / name for name in (".locplan-tmp-a1b2", ".locplan-settings")]
    for other in others:
        other.mkdir()
    with temporary_folder(tmp_path) as held:
        assert not abandoned.exists()
        cache.clear_cache(tmp_path, 2)
        assert held.exists()
    assert all(other.exists() for other in others)
    assert not list(tmp_path.glob(".locplan-tmp-????????"))


def test_cache_keeps_unknown_files(three_fields, tmp_path):
    for name in ("mine.npz", f"{'a' * 31}.npz", f"{'a' * 32}.csv", "a" * 32):
        (tmp_path / name).write_text("{}")
        os.utime(tmp_path / name, (0, 0))
    cache.evict_results(tmp_path, 0, three_fields[0])
    cache.clear_cache(tmp_path, 0)
    assert len([path for path in tmp_path.iterdir() if path.is_file()]) == 4
    assert list_cache_entries(tmp_path) == []


def test_eviction_continues_after_failed_removal(three_fields, tmp_path, monkeypatch):
    remove = cache.remove_entry

    def all_but_one(field):
        if field == three_fields[2]:
            raise LocplanError("not yours")
        return remove(field)

    monkeypatch.setattr(cache, "remove_entry", all_but_one)
    cache.evict_results(tmp_path, 0, three_fields[0])
    assert list_map_names(tmp_path) == ["rooms 1", "rooms 3"]


@pytest.mark.parametrize(
    ("text", "size"),
    [
        ("", 5e9),
        ("700", 700),
        ("1.5 GB", 1.5e9),
        ("20mb", 2e7),
        ("3k", 3000),
        ("1TB", 1e12),
        ("2GiB", 2 << 30),
    ],
)
def test_cache_limit_accepts_byte_units(text, size, monkeypatch):
    monkeypatch.setenv("LOCPLAN_CACHE_SIZE", text)
    assert cache.cache_limit() == size


@pytest.mark.parametrize("text", ["much", "-1", "5 EB", "GB", "9" * 400])
def test_cache_limit_rejects_invalid_text(text, monkeypatch):
    monkeypatch.setenv("LOCPLAN_CACHE_SIZE", text)
    with pytest.raises(ConfigError, match="LOCPLAN_CACHE_SIZE"):
        cache.cache_limit()


def test_cache_folder_prefers_argument_over_environment(tmp_path, monkeypatch):
    """Without either, it is the user's cache folder."""
    assert cache.cache_folder(tmp_path / "a") == tmp_path / "a"
    monkeypatch.setenv("LOCPLAN_CACHE", os.fspath(tmp_path / "b"))
    assert cache.cache_folder() == tmp_path / "b"
    monkeypatch.delenv("LOCPLAN_CACHE")
    assert "locplan" in cache.cache_folder().parts
    with pytest.raises(ConfigError, match="no such user"):
        cache.cache_folder("~nosuchuser/x")


KEY = "0123456789abcdef" * 2


def read_number(path):
    try:
        return int(path.read_text())
    except ValueError:
        raise LocplanError(f"{path}: is damaged") from None


def fetch_number(folder, compute):
    def save(path, number):
        path.write_text(str(number))

    return load_or_compute_result(KEY, read_number, compute, save, cache_dir=folder)


def test_result_is_computed_once(tmp_path):
    assert fetch_number(tmp_path, lambda parts: 7) == 7
    assert fetch_number(tmp_path, None) == 7


def test_damaged_result_is_computed_again(tmp_path, caplog):
    fetch_number(tmp_path, lambda parts: 7)
    (tmp_path / f"{KEY}.npz").write_text("seven")
    assert fetch_number(tmp_path, lambda parts: 8) == 8
    assert "is damaged; computed again" in caplog.text
    assert fetch_number(tmp_path, None) == 8


def test_interrupted_result_resumes_from_parts(tmp_path):
    """The parts are removed when the result is saved."""

    def interrupted(parts):
        parts.mkdir()
        (parts / "1").write_text("7")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fetch_number(tmp_path, interrupted)
    assert [entry.kind for entry in list_cache_entries(tmp_path)] == ["unfinished"]
    assert fetch_number(tmp_path, lambda parts: read_number(parts / "1")) == 7
    assert [entry.path.name for entry in list_cache_entries(tmp_path)] == [f"{KEY}.npz"]


def test_unwritable_cache_is_logged_once(tmp_path, caplog):
    """Each result is still computed, without a folder for parts."""
    (tmp_path / "file").write_text("")
    for _ in range(2):
        assert fetch_number(tmp_path / "file", lambda parts: 7 if parts is None else 8) == 7
    (message,) = caplog.messages  # not one for each result
    assert message.startswith(f"results are not cached: {tmp_path / 'file'} cannot be written (")
