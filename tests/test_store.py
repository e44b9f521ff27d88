import dataclasses
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from conftest import changed, random_rooms

from locplan.field import Exponential, FieldConfig, Sad, SearchWindow, covariance_field
from locplan.field import _cache as cache
from locplan.field import _store as store
from locplan.field import _zarr as field_files
from locplan.field.estimators import _sad as sad
from locplan.maps import UNKNOWN, OccupancyGrid, save_map

QUICK = FieldConfig(Sad(range=0.6, window=SearchWindow(half_width=0.4)))
"""Two by two chunks of the map below."""

CHILD = """
import sys
from locplan import load_map
from locplan.field import FieldConfig
from locplan.field import _store as store
from locplan.field.estimators import _sad as sad

calls, compute = [], sad.covariances
def slowly(*, rows, **options):
    import time
    calls.append(len(rows))
    time.sleep(float(sys.argv[3]))
    return compute(rows=rows, **options)
sad.covariances = slowly
config = FieldConfig(sensor_range=0.6, window=0.4)
print("began", flush=True)
store.load_or_compute(load_map(sys.argv[1]), config, cache_dir=sys.argv[2], threads=1)
print(sum(calls))
"""


@pytest.fixture
def grid() -> OccupancyGrid:
    return OccupancyGrid(random_rooms((200, 240), seed=4), 0.1, name="rooms")


@pytest.fixture
def computed(monkeypatch) -> list[int]:
    """How many points each tile computed had."""
    calls, compute = [], sad.covariances

    def spy(*, rows, **options):
        calls.append(len(rows))
        return compute(rows=rows, **options)

    monkeypatch.setattr(sad, "covariances", spy)
    return calls


def started(map_file: Path, folder: Path, seconds_a_tile: float) -> subprocess.Popen:
    command = [sys.executable, "-c", CHILD, map_file, folder, str(seconds_a_tile)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def wait_until(condition) -> None:
    end = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < end, "waited for too long"
        time.sleep(0.01)


def test_a_field_is_computed_once(grid, tmp_path, computed):
    first = store.load_or_compute(grid, QUICK, cache_dir=tmp_path)
    assert sum(computed) == first.evaluated.sum()
    second = store.load_or_compute(grid, QUICK, cache_dir=tmp_path)
    assert sum(computed) == first.evaluated.sum()
    np.testing.assert_array_equal(first.covariance, second.covariance)
    np.testing.assert_array_equal(first.covariance, covariance_field(grid, QUICK).covariance)


def test_a_cached_field_is_a_field_like_any_other(grid, tmp_path):
    store.load_or_compute(grid, QUICK, cache_dir=tmp_path)
    loaded = store.CovarianceField.load(store.field_path(grid, QUICK, tmp_path))
    assert loaded.grid.digest == grid.digest


@pytest.mark.parametrize(
    "change", [{"sensor_range": 0.7}, {"tau": 0.5}, {"quantisation": False}, {"stride": 0.3}]
)
def test_another_config_is_another_field(grid, change):
    other = dataclasses.replace(QUICK, **change)
    assert store.field_path(grid, QUICK) != store.field_path(grid, other)


def test_another_engine_is_another_field(grid, tmp_path, computed, monkeypatch):
    store.load_or_compute(grid, QUICK, cache_dir=tmp_path)
    once = sum(computed)
    monkeypatch.setattr(field_files, "ENGINE", field_files.ENGINE + 1)
    store.load_or_compute(grid, QUICK, cache_dir=tmp_path)
    assert sum(computed) == 2 * once


def test_the_name_of_the_map_is_todays(grid, tmp_path):
    store.load_or_compute(grid, QUICK, cache_dir=tmp_path)
    renamed = dataclasses.replace(grid, name="other")
    assert store.load_or_compute(renamed, QUICK, cache_dir=tmp_path).grid.name == "other"


@pytest.mark.parametrize("tiles_done", [1, 3])
def test_a_killed_run_is_resumed(grid, tmp_path, tiles_done, computed):
    save_map(grid, tmp_path / "rooms.yaml")
    path = store.field_path(grid, QUICK, tmp_path)
    process = started(tmp_path / "rooms.yaml", tmp_path, 0.5)
    wait_until(lambda: field_files.count_chunks(path) == tiles_done)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    field = store.load_or_compute(grid, QUICK, cache_dir=tmp_path)
    assert 0 < sum(computed) < field.evaluated.sum()
    np.testing.assert_array_equal(field.covariance, covariance_field(grid, QUICK).covariance)
    assert cache.CacheEntry.read(path).share == 1.0


@pytest.mark.parametrize("killed", [False, True])
def test_of_two_processes_one_computes_and_the_other_waits(grid, tmp_path, killed):
    save_map(grid, tmp_path / "rooms.yaml")
    path = store.field_path(grid, QUICK, tmp_path)
    first = started(tmp_path / "rooms.yaml", tmp_path, 4.0 if killed else 0.5)
    wait_until(lambda: field_files.count_chunks(path) == 1)
    second = started(tmp_path / "rooms.yaml", tmp_path, 0.0)
    assert second.stdout.readline() == "began\n"
    if killed:
        time.sleep(0.3)  # for the second to find the lock taken
        assert second.poll() is None
        first.send_signal(signal.SIGKILL)
    told = [process.communicate(timeout=60)[0].split()[-1:] for process in (first, second)]
    alone = int(covariance_field(grid, QUICK).evaluated.sum())
    if killed:
        assert 0 < int(told[1][0]) < alone
    else:
        assert told == [[str(alone)], ["0"]]


def test_whoever_waits_sees_how_far_the_other_is(grid, tmp_path):
    save_map(grid, tmp_path / "rooms.yaml")
    path = store.field_path(grid, QUICK, tmp_path)
    other = started(tmp_path / "rooms.yaml", tmp_path, 0.7)
    wait_until(lambda: field_files.count_chunks(path) == 1)
    seen = []
    store.load_or_compute(
        grid, QUICK, cache_dir=tmp_path, progress=lambda done, total: seen.append(done / total)
    )
    other.communicate()
    assert any(0 < share < 1 for share in seen)
    assert seen == sorted(seen)


DAMAGES = {
    "covariance/c.0.0.0.0": "damaged chunks: 1",
    "covariance/zarr.json": "not a covariance field",
    "zarr.json": "not a covariance field",
}


@pytest.mark.parametrize("file", DAMAGES)
def test_damage_is_computed_anew_with_a_warning(grid, tmp_path, computed, file):
    whole = store.load_or_compute(grid, QUICK, cache_dir=tmp_path)
    path = store.field_path(grid, QUICK, tmp_path) / file
    path.write_bytes(path.read_bytes()[:-30])
    computed.clear()
    with pytest.warns(store.CacheWarning, match=f"{DAMAGES[file]}.*computed anew"):
        again = store.load_or_compute(grid, QUICK, cache_dir=tmp_path)
    np.testing.assert_array_equal(again.covariance, whole.covariance)
    if file.endswith("c.0.0.0.0"):
        assert 0 < sum(computed) < whole.evaluated.sum()
    computed.clear()
    store.load_or_compute(grid, QUICK, cache_dir=tmp_path)
    assert not computed


def test_a_folder_that_is_another_fields_is_not_believed(grid, tmp_path, computed):
    other = dataclasses.replace(grid, cells=np.where(grid.cells == UNKNOWN, 0, grid.cells))
    store.load_or_compute(other, QUICK, cache_dir=tmp_path)
    os.rename(store.field_path(other, QUICK, tmp_path), store.field_path(grid, QUICK, tmp_path))
    with pytest.warns(store.CacheWarning, match="another field"):
        field = store.load_or_compute(grid, QUICK, cache_dir=tmp_path)
    np.testing.assert_array_equal(field.covariance, covariance_field(grid, QUICK).covariance)


def test_a_cache_that_cannot_be_written_is_a_warning_not_an_error(grid, tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.warns(store.CacheWarning, match="not cached"):
        field = store.load_or_compute(grid, QUICK, cache_dir=tmp_path / "file" / "cache")
    assert field.evaluated.any()


def test_a_full_disk_is_a_warning_and_what_was_written_counts(
    grid, tmp_path, monkeypatch, computed
):
    write, written = field_files.write_chunks, []

    def until_full(folder, covariance, chunks):
        if len(written) == 3:  # the first call writes nothing: no chunk was carried over
            raise OSError(28, "No space left on device")
        written.append(1)
        write(folder, covariance, chunks)

    monkeypatch.setattr(field_files, "write_chunks", until_full)
    with pytest.warns(store.CacheWarning, match="not cached in .*: No space left") as warned:
        field = store.load_or_compute(grid, QUICK, cache_dir=tmp_path)
    assert len(warned) == 1
    np.testing.assert_array_equal(field.covariance, covariance_field(grid, QUICK).covariance)
    monkeypatch.setattr(field_files, "write_chunks", write)
    computed.clear()
    again = store.load_or_compute(grid, QUICK, cache_dir=tmp_path)
    assert 0 < sum(computed) < field.evaluated.sum()
    np.testing.assert_array_equal(again.covariance, field.covariance)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_read_only_cache_serves_what_it_holds(grid, tmp_path, computed):
    store.load_or_compute(grid, QUICK, cache_dir=tmp_path)
    computed.clear()
    for folder, _, files in os.walk(tmp_path):
        for name in files:
            os.chmod(os.path.join(folder, name), 0o444)
        os.chmod(folder, 0o555)
    store.load_or_compute(grid, QUICK, cache_dir=tmp_path)
    assert not computed
    with pytest.warns(store.CacheWarning, match="cannot be written"):
        store.load_or_compute(grid, changed(QUICK, weights=Exponential(0.1)), cache_dir=tmp_path)
    for folder, _, _ in os.walk(tmp_path):
        os.chmod(folder, 0o755)


def test_an_edited_map_is_computed_only_where_the_change_is_felt(grid, tmp_path, computed):
    store.load_or_compute(grid, QUICK, cache_dir=tmp_path)
    cells = grid.cells.copy()
    cells[10:14, 10:14] = 0
    after = dataclasses.replace(grid, cells=cells)
    computed.clear()
    field = store.load_or_compute(after, QUICK, cache_dir=tmp_path)
    assert 0 < sum(computed) < field.evaluated.sum() / 4
    np.testing.assert_array_equal(field.covariance, covariance_field(after, QUICK).covariance)
    computed.clear()
    assert cache.remove(store.field_path(grid, QUICK, tmp_path))  # nothing is borrowed
    np.testing.assert_array_equal(
        store.load_or_compute(after, QUICK, cache_dir=tmp_path).covariance, field.covariance
    )
    assert not computed


def test_what_was_read_was_used(grid, tmp_path):
    store.load_or_compute(grid, QUICK, cache_dir=tmp_path)
    path = store.field_path(grid, QUICK, tmp_path)
    os.utime(path / "zarr.json", (0, 0))
    store.load_or_compute(grid, QUICK, cache_dir=tmp_path)
    assert cache.CacheEntry.read(path).used > 1e9


def test_what_a_killed_writer_left_is_removed(grid, tmp_path):
    store.load_or_compute(grid, QUICK, cache_dir=tmp_path)
    path = store.field_path(grid, QUICK, tmp_path)
    (path / "covariance" / "c.0.0.0.0").rename(path / "covariance" / "c.0.0.0.abc.partial")
    assert cache.CacheEntry.read(path).share < 1
    store.load_or_compute(grid, QUICK, cache_dir=tmp_path)
    assert not list(path.rglob("*.partial"))


def test_nothing_is_carried_over_from_a_damaged_map(grid, tmp_path):
    store.load_or_compute(grid, QUICK, cache_dir=tmp_path)
    about = store.field_path(grid, QUICK, tmp_path) / "zarr.json"
    described = json.loads(about.read_text())
    described["attributes"]["map_digest"] = "0" * 64
    about.write_text(json.dumps(described))
    cells = grid.cells.copy()
    cells[10:14, 10:14] = 0
    after = dataclasses.replace(grid, cells=cells)
    field = store.load_or_compute(after, QUICK, cache_dir=tmp_path)
    np.testing.assert_array_equal(field.covariance, covariance_field(after, QUICK).covariance)


def test_a_map_without_free_cells_needs_no_cache(tmp_path):
    nothing = OccupancyGrid(np.zeros((5, 5), np.uint8), 0.1)
    assert not store.load_or_compute(nothing, QUICK, cache_dir=tmp_path).evaluated.any()
    assert os.listdir(tmp_path) == []
