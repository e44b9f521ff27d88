import os
import time

import pytest
from conftest import random_rooms

from locplan._util.output import temporary_folder
from locplan.errors import ConfigError, LocplanError
from locplan.field import (
    FieldCache,
    FieldConfig,
    Fused,
    Sad,
    Scan,
    SearchWindow,
    _cache as cache,
    _store as store,
)
from locplan.maps import OccupancyGrid
from locplan.robots import Lidar

QUICK = FieldConfig(Sad(range=0.6, window=SearchWindow(half_width=0.4)))


@pytest.fixture
def three(tmp_path):
    """A cache of three fields, used 1, 2 and 3 days ago."""
    paths = []
    for days in (1, 2, 3):
        grid = OccupancyGrid(random_rooms((40, 50), seed=days), 0.1, name=f"rooms {days}")
        store.load_or_compute(grid, QUICK, cache_dir=tmp_path)
        paths.append(store.field_path(grid, QUICK, tmp_path))
        used = time.time() - days * 86400 - 60
        os.utime(paths[-1] / "zarr.json", (used, used))
    return paths


def names(folder) -> list[str]:
    return [entry.about["map_name"] for entry in cache.entries(folder)]


def test_entries_come_by_their_last_use(three, tmp_path):
    assert names(tmp_path) == ["rooms 1", "rooms 2", "rooms 3"]
    cache.mark_used(three[1])
    assert names(tmp_path) == ["rooms 2", "rooms 1", "rooms 3"]


def test_entries_know_their_size_and_whether_they_are_finished(three, tmp_path):
    entry = cache.CacheEntry.read(three[0])
    files = [file for file in three[0].rglob("*") if file.is_file()]
    assert entry.size == sum(file.stat().st_size for file in files)
    assert entry.share == 1.0
    assert abs(entry.computed - time.time()) < 600
    (three[0] / "covariance/c.0.0.0.0").unlink()
    assert cache.CacheEntry.read(three[0]).share < 1


def test_the_least_recently_used_go_first(three, tmp_path):
    size = sum(cache.CacheEntry.read(path).size for path in three[:2])
    cache.evict(tmp_path, size, three[0])
    assert names(tmp_path) == ["rooms 1", "rooms 2"]
    cache.evict(tmp_path, 1, three[1])
    assert names(tmp_path) == ["rooms 2"]


def test_a_new_field_drives_out_an_old_one(three, tmp_path, monkeypatch):
    monkeypatch.setenv("LOCPLAN_CACHE_SIZE", str(cache.CacheEntry.read(three[0]).size))
    grid = OccupancyGrid(random_rooms((40, 50), seed=9), 0.1, name="new")
    store.load_or_compute(grid, QUICK, cache_dir=tmp_path)
    assert names(tmp_path) == ["new"]


def test_what_is_being_computed_stays(three, tmp_path):
    with cache.lock_of(three[1]):
        removed, busy = cache.clear_cache(tmp_path, 0)
    assert [entry.folder for entry in busy] == [three[1]]
    assert {entry.folder for entry in removed} == {three[0], three[2]}
    assert names(tmp_path) == ["rooms 2"]


def test_only_what_was_not_used_for_so_long_is_removed(three, tmp_path):
    cache.clear_cache(tmp_path, 2)
    assert names(tmp_path) == ["rooms 1"]


def test_damaged_entries_can_be_seen_and_removed(three, tmp_path):
    (three[0] / "zarr.json").write_text("{")
    assert [entry.about for entry in cache.entries(tmp_path)].count({}) == 1
    cache.clear_cache(tmp_path, 0)
    assert cache.entries(tmp_path) == []


def test_leftovers_of_killed_processes_are_removed_but_not_those_of_live_ones(three, tmp_path):
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


def test_nothing_of_anybody_elses_is_touched(three, tmp_path):
    for name in (".git", "mine.zarr", f".{'a' * 31}", "a" * 32):
        (tmp_path / name).mkdir()
        (tmp_path / name / "zarr.json").write_text("{}")
        os.utime(tmp_path / name, (0, 0))
    cache.evict(tmp_path, 0, three[0])
    cache.clear_cache(tmp_path, 0)
    assert len(list(tmp_path.glob("*/zarr.json"))) == 4
    assert cache.entries(tmp_path) == []


def test_one_that_cannot_be_removed_does_not_keep_the_rest(three, tmp_path, monkeypatch):
    remove = cache.remove

    def all_but_one(field):
        if field == three[2]:
            raise LocplanError("not yours")
        return remove(field)

    monkeypatch.setattr(cache, "remove", all_but_one)
    cache.evict(tmp_path, 0, three[0])
    assert names(tmp_path) == ["rooms 1", "rooms 3"]


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
def test_the_limit_is_read(text, size, monkeypatch):
    monkeypatch.setenv("LOCPLAN_CACHE_SIZE", text)
    assert cache.cache_limit() == size


@pytest.mark.parametrize("text", ["much", "-1", "5 EB", "GB", "9" * 400])
def test_a_limit_that_is_none_is_refused(text, monkeypatch):
    monkeypatch.setenv("LOCPLAN_CACHE_SIZE", text)
    with pytest.raises(ConfigError, match="LOCPLAN_CACHE_SIZE"):
        cache.cache_limit()


def test_the_folder_is_the_argument_then_the_environment_then_the_users(tmp_path, monkeypatch):
    assert cache.cache_folder(tmp_path / "a") == tmp_path / "a"
    monkeypatch.setenv("LOCPLAN_CACHE", os.fspath(tmp_path / "b"))
    assert cache.cache_folder() == tmp_path / "b"
    monkeypatch.delenv("LOCPLAN_CACHE")
    assert "locplan" in cache.cache_folder().parts
    with pytest.raises(ConfigError, match="no such user"):
        cache.cache_folder("~nosuchuser/x")


@pytest.mark.parametrize(
    ("estimator", "told"),
    [
        (Sad(), "sad, range 6 "),
        (Sad.paper(), "sad, quantisation False, range 6, weights inverse-square "),
        (Scan(Lidar.preset("turtlebot3")), "scan, turtlebot3 "),
        (Fused(Lidar.preset("turtlebot3")), "fused, turtlebot3 "),
        (Fused(Lidar(range=6.0)), "fused, range 6 "),
    ],
)
def test_the_list_names_the_lidar_and_the_settings_that_differ(
    tmp_path, monkeypatch, estimator, told
):
    monkeypatch.setenv("COLUMNS", "200")
    about = {"map_name": "room", "config": FieldConfig(estimator).to_json(), "chunks": 1}
    entry = cache.CacheEntry(tmp_path, about, 1000, 1, time.time(), time.time())
    assert f"room {told}" in " ".join(FieldCache(tmp_path, [entry], 10**9).table().split())
