import dataclasses
import json
import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from conftest import changed, few_of, random_rooms, respects_permissions

from locplan.field import (
    Exponential,
    FieldConfig,
    Fisher,
    Sad,
    Scan,
    SearchWindow,
    _cache as cache,
    _compute as computing,
    _store as store,
    _tiles as tiles,
    _zarr as field_files,
    covariance_field,
)
from locplan.maps import UNKNOWN, OccupancyGrid, save_map
from locplan.robots import Lidar

QUICK = FieldConfig(Sad(range=0.6, window=SearchWindow(half_width=0.4)))
"""Two by two chunks of the map below."""
LIDAR = Lidar(range=3.0, beams=90)

CHILD = """
import sys
from locplan.field import _compute as computing, _store as store, _zarr as field_files
from locplan.maps import load_map
from test_store import QUICK

compute, write = computing.compute, field_files.write_chunks
def when_allowed(*arguments, **task):
    sys.stdin.readline()
    return compute(*arguments, **task)
def and_say_so(path, values, chunks):
    write(path, values, chunks)
    if chunks:
        print("written", flush=True)
computing.compute, field_files.write_chunks = when_allowed, and_say_so
store.load_or_compute(load_map(sys.argv[1]), QUICK, cache_dir=sys.argv[2], threads=1)
"""
"""Another process, which computes a tile for every line that it reads."""


class Other:
    """A process that computes the same field, and holds its lock from the first tile on."""

    def __init__(self, grid: OccupancyGrid, folder: Path) -> None:
        map_file = folder / "rooms.yaml"
        save_map(grid, map_file)
        self.process = subprocess.Popen(
            [sys.executable, "-c", CHILD, map_file, folder],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        )
        self.compute_a_tile()

    def compute_a_tile(self) -> None:
        """Each of the four tiles is a chunk; back when that is written."""
        self.process.stdin.write("\n")
        self.process.stdin.flush()
        assert self.process.stdout.readline() == "written\n"

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()

    @property
    def runs(self) -> bool:
        return self.process.poll() is None


@pytest.fixture
def other(grid, tmp_path):
    process = Other(grid, tmp_path)
    yield process
    process.process.kill()
    process.process.communicate()


@pytest.fixture
def grid() -> OccupancyGrid:
    return OccupancyGrid(random_rooms((200, 240), seed=4), 0.1, name="rooms")


@pytest.fixture
def computed(monkeypatch) -> list[int]:
    """How many points each tile computed had."""
    calls, compute = [], computing.compute

    def spy(engine, estimator, part):
        calls.append(len(part.rows))
        return compute(engine, estimator, part)

    monkeypatch.setattr(computing, "compute", spy)
    return calls


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
    "other",
    [
        changed(QUICK, range=0.7),
        changed(QUICK, weights=Exponential(0.5)),
        changed(QUICK, quantisation=False),
        dataclasses.replace(QUICK, stride=0.3),
        FieldConfig(Scan(LIDAR)),
        FieldConfig(Scan(dataclasses.replace(LIDAR, mount_yaw_deg=5.0))),
        FieldConfig(Fisher(LIDAR, model="range")),
    ],
)
def test_another_config_is_another_field(grid, other):
    for config in (QUICK, FieldConfig(Fisher(LIDAR))):
        assert store.field_path(grid, config) != store.field_path(grid, other)


@pytest.mark.parametrize(
    ("config", "other"),
    [
        (QUICK, dataclasses.replace(QUICK, stride=0.21)),
        (FieldConfig(Scan(LIDAR)), FieldConfig(Scan(dataclasses.replace(LIDAR, range_sigma=0.01)))),
        (FieldConfig(Scan(LIDAR)), FieldConfig(Scan(LIDAR), headings=1)),
        (QUICK, changed(QUICK, weights=Exponential(0.57))),
    ],
)
def test_what_decides_no_value_makes_no_other_field(grid, config, other):
    assert store.field_path(grid, config) == store.field_path(grid, other)


def test_another_engine_is_another_field(grid, tmp_path, computed, monkeypatch):
    store.load_or_compute(grid, QUICK, cache_dir=tmp_path)
    once = sum(computed)
    monkeypatch.setattr(tiles, "ENGINE", tiles.ENGINE + 1)
    store.load_or_compute(grid, QUICK, cache_dir=tmp_path)
    assert sum(computed) == 2 * once


def test_the_name_of_the_map_is_todays(grid, tmp_path):
    store.load_or_compute(grid, QUICK, cache_dir=tmp_path)
    renamed = dataclasses.replace(grid, name="other")
    assert store.load_or_compute(renamed, QUICK, cache_dir=tmp_path).grid.name == "other"


@pytest.mark.parametrize("more_tiles", few_of([2, 0]))
def test_a_killed_run_is_resumed(grid, tmp_path, more_tiles, computed, other):
    for _ in range(more_tiles):
        other.compute_a_tile()
    other.kill()
    field = store.load_or_compute(grid, QUICK, cache_dir=tmp_path)
    assert len(computed) == 3 - more_tiles
    np.testing.assert_array_equal(field.covariance, covariance_field(grid, QUICK).covariance)
    assert cache.CacheEntry.read(store.field_path(grid, QUICK, tmp_path)).share == 1.0


def test_while_another_process_computes_one_waits_and_sees_how_far_it_is(
    grid, tmp_path, computed, other
):
    shares = []

    def waiting(done, total):
        assert not computed
        shares.append(done / total)
        if len(shares) < 4:
            other.compute_a_tile()

    store.load_or_compute(grid, QUICK, cache_dir=tmp_path, progress=waiting)
    assert shares[:3] == pytest.approx([0.25, 0.5, 0.75], abs=0.01)
    assert not computed


def test_whoever_waits_goes_on_where_a_killed_process_was(grid, tmp_path, computed, other):
    seen = []

    def waiting(done, total):
        seen.append((other.runs, len(computed)))
        other.kill()

    field = store.load_or_compute(grid, QUICK, cache_dir=tmp_path, progress=waiting)
    assert seen[0] == (True, 0)
    assert len(computed) == 3
    np.testing.assert_array_equal(field.covariance, covariance_field(grid, QUICK).covariance)


@pytest.mark.parametrize("finished", [0.1, 0.7, 1.0])
def test_fields_in_other_chunks_are_read_and_completed(
    grid, tmp_path, computed, monkeypatch, finished
):
    def interrupt(done, total):
        if done > finished * total:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch, suppress(KeyboardInterrupt):
        patch.setattr(tiles, "TILE", 16)
        store.load_or_compute(grid, QUICK, cache_dir=tmp_path, threads=1, progress=interrupt)
    path = store.field_path(grid, QUICK, tmp_path)
    known = tiles.known_points(field_files.read_values(path, grid, QUICK)[0])
    if finished < 1:  # a run that ends before it has a chunk loses nothing
        with suppress(KeyboardInterrupt):
            store.load_or_compute(
                grid, QUICK, cache_dir=tmp_path, progress=lambda *_: interrupt(1, 0)
            )
        kept = tiles.known_points(field_files.read_values(path, grid, QUICK)[0])
        assert (kept | ~known).all()
    computed.clear()
    field = store.load_or_compute(grid, QUICK, cache_dir=tmp_path)
    assert 0 < known.sum() <= field.evaluated.sum() - sum(computed)
    assert bool(computed) == (finished < 1)
    assert field_files.has_todays_chunks(path, grid, QUICK) == (finished < 1)
    np.testing.assert_array_equal(field.covariance, covariance_field(grid, QUICK).covariance)
    computed.clear()
    again = store.load_or_compute(grid, QUICK, cache_dir=tmp_path)
    assert not computed
    np.testing.assert_array_equal(again.covariance, field.covariance)
    assert cache.CacheEntry.read(path).share == 1.0


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


def unknown_codec(field):
    about = field / "covariance" / "zarr.json"
    about.write_text(about.read_text().replace('"zstd"', '"none"'))


def folder_for_a_chunk(field):
    (field / "covariance" / "c.0.0.0.0").unlink()
    (field / "covariance" / "c.0.0.0.0").mkdir()


def pipe_for_a_chunk(field):
    (field / "covariance" / "c.0.0.0.0").unlink()
    os.mkfifo(field / "covariance" / "c.0.0.0.0")


@pytest.mark.parametrize("damage", [unknown_codec, folder_for_a_chunk, pipe_for_a_chunk])
def test_whatever_stands_in_place_of_a_cached_field_it_heals(grid, tmp_path, computed, damage):
    whole = store.load_or_compute(grid, QUICK, cache_dir=tmp_path)
    damage(store.field_path(grid, QUICK, tmp_path))
    with pytest.warns(store.CacheWarning, match="computed anew") as warned:
        again = store.load_or_compute(grid, QUICK, cache_dir=tmp_path)
    assert len(warned) == 1
    np.testing.assert_array_equal(again.covariance, whole.covariance)
    computed.clear()
    store.load_or_compute(grid, QUICK, cache_dir=tmp_path)
    assert not computed


@pytest.mark.parametrize("setting", ['"level": 99', '"level": "x"', '"depth": 1'])
def test_an_unfinished_field_whose_codec_was_changed_heals(grid, tmp_path, computed, setting):
    whole = store.load_or_compute(grid, QUICK, cache_dir=tmp_path)
    folder = store.field_path(grid, QUICK, tmp_path) / "covariance"
    (folder / "c.0.0.0.0").unlink()
    about = (folder / "zarr.json").read_text()
    (folder / "zarr.json").write_text(about.replace('"level": 1', setting))
    again = store.load_or_compute(grid, QUICK, cache_dir=tmp_path)
    np.testing.assert_array_equal(again.covariance, whole.covariance)
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


@respects_permissions
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
