import dataclasses
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from support.cases import sample_cases
from support.fields import QUICK_FIELD, change_estimator
from support.machine import respects_permissions
from support.maps import random_rooms

from locplan.errors import LocplanError
from locplan.field import (
    CovarianceField,
    FieldConfig,
    Fisher,
    Scan,
    compute as computing,
    covariance_field,
    files,
    load_or_compute,
    tiles,
)
from locplan.field.cache import list_cache_entries
from locplan.field.sad import Exponential
from locplan.field.store import field_path
from locplan.maps import UNKNOWN, OccupancyGrid, save_map
from locplan.robots import Lidar

LIDAR = Lidar(range=3.0, beams=90)

CHILD = """
import sys
from locplan.field import compute as computing, files, load_or_compute, store
from locplan.maps import load_map
from support.fields import QUICK_FIELD

compute, write = computing.compute_tile, files.write_points
def when_allowed(*arguments, **task):
    sys.stdin.readline()
    return compute(*arguments, **task)
def and_report(*arguments):
    write(*arguments)
    print("written", flush=True)
computing.compute_tile, files.write_points, store.PART_SECONDS = when_allowed, and_report, 0.0
load_or_compute(load_map(sys.argv[1]), QUICK_FIELD, cache_dir=sys.argv[2], threads=1)
"""
"""Another process, which computes a tile for every line that it reads."""


class Child:
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
        """Return when the part of the next of four tiles is written."""
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
def child(grid, tmp_path):
    process = Child(grid, tmp_path)
    yield process
    process.process.kill()
    process.process.communicate()


@pytest.fixture
def grid() -> OccupancyGrid:
    return OccupancyGrid(random_rooms((200, 240), seed=4), 0.1, name="rooms")


@pytest.fixture
def computed(monkeypatch) -> list[int]:
    """Numbers of points of the computed tiles."""
    calls, compute = [], computing.compute_tile

    def spy(engine, estimator, part):
        calls.append(len(part.rows))
        return compute(engine, estimator, part)

    monkeypatch.setattr(computing, "compute_tile", spy)
    return calls


@pytest.fixture
def parts_of_tiles(monkeypatch):
    """Every finished tile becomes a part."""
    monkeypatch.setattr("locplan.field.store.PART_SECONDS", 0.0)


def equals_computed(field: CovarianceField) -> bool:
    again = covariance_field(field.grid, field.config)
    return field.covariance.tobytes() == again.covariance.tobytes()


def interrupt_computation(grid, folder, share: float) -> None:
    """Compute a share of a field, then interrupt the computation."""

    def interrupt(done, total):
        if done > share * total:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        load_or_compute(grid, QUICK_FIELD, cache_dir=folder, threads=1, progress=interrupt)


def edit_map(grid: OccupancyGrid) -> OccupancyGrid:
    cells = grid.cells.copy()
    cells[10:14, 10:14] = 0
    return dataclasses.replace(grid, cells=cells)


def test_field_is_computed_once(grid, tmp_path, computed):
    first = load_or_compute(grid, QUICK_FIELD, cache_dir=tmp_path)
    assert sum(computed) == first.is_evaluated.sum()
    second = load_or_compute(grid, QUICK_FIELD, cache_dir=tmp_path)
    assert sum(computed) == first.is_evaluated.sum()
    np.testing.assert_array_equal(first.covariance, second.covariance)
    np.testing.assert_array_equal(first.covariance, covariance_field(grid, QUICK_FIELD).covariance)


def test_cached_field_file_can_be_loaded(grid, tmp_path):
    load_or_compute(grid, QUICK_FIELD, cache_dir=tmp_path)
    loaded = CovarianceField.load(field_path(grid, QUICK_FIELD, tmp_path))
    assert loaded.grid.digest == grid.digest


@pytest.mark.parametrize(
    "other",
    [
        change_estimator(QUICK_FIELD, range=0.7),
        change_estimator(QUICK_FIELD, weights=Exponential(0.5)),
        change_estimator(QUICK_FIELD, quantisation=False),
        dataclasses.replace(QUICK_FIELD, stride=0.3),
        FieldConfig(Scan(LIDAR)),
        FieldConfig(Scan(dataclasses.replace(LIDAR, mount_yaw_deg=5.0))),
        FieldConfig(Fisher(LIDAR, model="range")),
    ],
)
def test_cache_path_depends_on_config(grid, other):
    for config in (QUICK_FIELD, FieldConfig(Fisher(LIDAR))):
        assert field_path(grid, config) != field_path(grid, other)


@pytest.mark.parametrize(
    ("config", "other"),
    [
        (QUICK_FIELD, dataclasses.replace(QUICK_FIELD, stride=0.21)),
        (FieldConfig(Scan(LIDAR)), FieldConfig(Scan(dataclasses.replace(LIDAR, range_sigma=0.01)))),
        (FieldConfig(Scan(LIDAR)), FieldConfig(Scan(LIDAR), headings=1)),
        (QUICK_FIELD, change_estimator(QUICK_FIELD, weights=Exponential(0.57))),
    ],
)
def test_cache_path_ignores_settings_without_effect(grid, config, other):
    assert field_path(grid, config) == field_path(grid, other)


def test_field_is_recomputed_for_new_engine(grid, tmp_path, computed, monkeypatch):
    load_or_compute(grid, QUICK_FIELD, cache_dir=tmp_path)
    once = sum(computed)
    monkeypatch.setattr(tiles, "ENGINE", tiles.ENGINE + 1)
    load_or_compute(grid, QUICK_FIELD, cache_dir=tmp_path)
    assert sum(computed) == 2 * once


def test_cached_field_has_current_map_name(grid, tmp_path):
    load_or_compute(grid, QUICK_FIELD, cache_dir=tmp_path)
    renamed = dataclasses.replace(grid, name="other")
    assert load_or_compute(renamed, QUICK_FIELD, cache_dir=tmp_path).grid.name == "other"


@pytest.mark.parametrize("more_tiles", sample_cases([2, 0]))
def test_field_resumes_after_killed_process(grid, tmp_path, more_tiles, computed, child):
    for _ in range(more_tiles):
        child.compute_a_tile()
    child.kill()
    field = load_or_compute(grid, QUICK_FIELD, cache_dir=tmp_path)
    assert len(computed) == 3 - more_tiles
    np.testing.assert_array_equal(field.covariance, covariance_field(grid, QUICK_FIELD).covariance)
    assert [entry.finished_share for entry in list_cache_entries(tmp_path)] == [1.0]


def test_waiting_process_reports_progress(grid, tmp_path, computed, child):
    """Another process computes the same field."""
    shares = []

    def waiting(done, total):
        assert not computed
        shares.append(done / total)
        if len(shares) < 4:
            child.compute_a_tile()

    load_or_compute(grid, QUICK_FIELD, cache_dir=tmp_path, progress=waiting)
    assert 0 < shares[0] < shares[1] < shares[2] < 1
    assert not computed


def test_waiting_process_resumes_killed_computation(grid, tmp_path, computed, child):
    seen = []

    def waiting(done, total):
        seen.append((child.runs, len(computed)))
        child.kill()

    field = load_or_compute(grid, QUICK_FIELD, cache_dir=tmp_path, progress=waiting)
    assert seen[0] == (True, 0)
    assert len(computed) == 3
    np.testing.assert_array_equal(field.covariance, covariance_field(grid, QUICK_FIELD).covariance)


def test_interrupted_field_resumes_from_parts(grid, tmp_path, computed, parts_of_tiles):
    interrupt_computation(grid, tmp_path, 0.6)
    (entry,) = list_cache_entries(tmp_path)
    assert entry.path.suffix == ".parts"
    assert (entry.kind, entry.to_json()["map"]) == ("parts of a field", "rooms")
    assert 0 < entry.finished_share < 1
    done = sum(computed)
    computed.clear()
    field = load_or_compute(grid, QUICK_FIELD, cache_dir=tmp_path)
    rest = field.is_evaluated.sum() * (1 - entry.finished_share)
    assert 0 < sum(computed) <= rest + 1e-6  # the share is rounded
    assert done + sum(computed) < 1.6 * field.is_evaluated.sum()
    assert equals_computed(field)
    assert [entry.path for entry in list_cache_entries(tmp_path)] == [
        field_path(grid, QUICK_FIELD, tmp_path)
    ]


def test_quick_field_writes_no_parts(grid, tmp_path, monkeypatch):
    monkeypatch.setattr("locplan.field.store.make_folder", None)
    assert load_or_compute(grid, QUICK_FIELD, cache_dir=tmp_path).is_evaluated.any()


def test_damaged_part_is_computed_again(grid, tmp_path, computed, parts_of_tiles):
    interrupt_computation(grid, tmp_path, 0.6)
    (entry,) = list_cache_entries(tmp_path)
    for part in entry.path.iterdir():
        part.write_bytes(part.read_bytes()[:-30])
    computed.clear()
    field = load_or_compute(grid, QUICK_FIELD, cache_dir=tmp_path)
    assert sum(computed) == field.is_evaluated.sum()
    assert equals_computed(field)


def cut(file):
    file.write_bytes(file.read_bytes()[:-30])


def flip_bit(file):
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 1
    file.write_bytes(data)


def empty(file):
    file.write_bytes(b"")


def pipe(file):
    file.unlink()
    os.mkfifo(file)


def other_arrays(file):
    np.savez(file, covariance=np.zeros(3))


def objects(file):
    np.savez(file, about=np.array([{"an": "object"}], dtype=object))


DAMAGES = [cut, flip_bit, empty, pipe, other_arrays, objects]


@pytest.mark.parametrize("damage", DAMAGES)
def test_damaged_field_is_computed_again(grid, tmp_path, computed, damage, caplog):
    load_or_compute(grid, QUICK_FIELD, cache_dir=tmp_path)
    damage(field_path(grid, QUICK_FIELD, tmp_path))
    again = load_or_compute(grid, QUICK_FIELD, cache_dir=tmp_path)
    assert ["computed again" in message for message in caplog.messages] == [True]
    assert equals_computed(again)
    computed.clear()
    load_or_compute(grid, QUICK_FIELD, cache_dir=tmp_path)
    assert not computed


def test_cache_rejects_file_of_other_field(grid, tmp_path, caplog):
    other = dataclasses.replace(grid, cells=np.where(grid.cells == UNKNOWN, 0, grid.cells))
    load_or_compute(other, QUICK_FIELD, cache_dir=tmp_path)
    os.rename(field_path(other, QUICK_FIELD, tmp_path), field_path(grid, QUICK_FIELD, tmp_path))
    assert equals_computed(load_or_compute(grid, QUICK_FIELD, cache_dir=tmp_path))
    assert "another field" in caplog.text


def test_field_is_computed_without_writable_cache(grid, tmp_path, parts_of_tiles):
    """No folder takes the parts, which a writable cache would save after each tile."""
    (tmp_path / "file").write_text("in the way")
    field = load_or_compute(grid, QUICK_FIELD, cache_dir=tmp_path / "file" / "cache")
    assert equals_computed(field)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_full_disk_keeps_finished_parts(
    grid, tmp_path, monkeypatch, computed, parts_of_tiles, caplog
):
    write, written = files.write_points, []

    def until_full(*arguments):
        if len(written) == 2:
            raise LocplanError("No space left on device")
        written.append(1)
        write(*arguments)

    monkeypatch.setattr(files, "write_points", until_full)
    field = load_or_compute(grid, QUICK_FIELD, cache_dir=tmp_path, threads=1)
    assert caplog.messages == ["the result is not cached: No space left on device"]
    assert equals_computed(field)
    monkeypatch.setattr(files, "write_points", write)
    computed.clear()
    again = load_or_compute(grid, QUICK_FIELD, cache_dir=tmp_path)
    assert 0 < sum(computed) < field.is_evaluated.sum()
    np.testing.assert_array_equal(again.covariance, field.covariance)


@respects_permissions
def test_read_only_cache_serves_fields(grid, tmp_path, computed, caplog):
    load_or_compute(grid, QUICK_FIELD, cache_dir=tmp_path)
    computed.clear()
    for folder, _, names in os.walk(tmp_path):
        for name in names:
            os.chmod(os.path.join(folder, name), 0o444)
        os.chmod(folder, 0o555)
    load_or_compute(grid, QUICK_FIELD, cache_dir=tmp_path)
    assert not computed
    load_or_compute(
        grid, change_estimator(QUICK_FIELD, weights=Exponential(0.1)), cache_dir=tmp_path
    )
    assert "cannot be written" in caplog.text
    for folder, _, _ in os.walk(tmp_path):
        os.chmod(folder, 0o755)


def test_edited_map_recomputes_changed_part(grid, tmp_path, computed):
    load_or_compute(grid, QUICK_FIELD, cache_dir=tmp_path)
    after = edit_map(grid)
    computed.clear()
    field = load_or_compute(after, QUICK_FIELD, cache_dir=tmp_path)
    assert 0 < sum(computed) < field.is_evaluated.sum() / 4
    assert equals_computed(field)
    computed.clear()
    field_path(grid, QUICK_FIELD, tmp_path).unlink()  # nothing is borrowed
    np.testing.assert_array_equal(
        load_or_compute(after, QUICK_FIELD, cache_dir=tmp_path).covariance, field.covariance
    )
    assert not computed


def test_edited_map_ignores_damaged_field(grid, tmp_path):
    load_or_compute(grid, QUICK_FIELD, cache_dir=tmp_path)
    flip_bit(field_path(grid, QUICK_FIELD, tmp_path))
    assert equals_computed(load_or_compute(edit_map(grid), QUICK_FIELD, cache_dir=tmp_path))


def test_cache_read_updates_last_use(grid, tmp_path):
    load_or_compute(grid, QUICK_FIELD, cache_dir=tmp_path)
    os.utime(field_path(grid, QUICK_FIELD, tmp_path), (0, 0))
    load_or_compute(grid, QUICK_FIELD, cache_dir=tmp_path)
    assert list_cache_entries(tmp_path)[0].used > 1e9


def test_map_without_free_cells_is_cached(tmp_path, monkeypatch):
    nothing = OccupancyGrid(np.zeros((5, 5), np.uint8), 0.1)
    assert not load_or_compute(nothing, QUICK_FIELD, cache_dir=tmp_path).is_evaluated.any()
    monkeypatch.setattr("locplan.field.store.compute_missing_chunks", None)
    assert not load_or_compute(nothing, QUICK_FIELD, cache_dir=tmp_path).is_evaluated.any()


def test_cache_ignores_field_of_earlier_version(grid, tmp_path, computed):
    path = field_path(grid, QUICK_FIELD, tmp_path)
    path.with_suffix(".zarr").mkdir()
    (path.with_suffix(".zarr") / "zarr.json").write_text("{}")
    load_or_compute(grid, QUICK_FIELD, cache_dir=tmp_path)
    assert computed
    assert sorted(entry.kind for entry in list_cache_entries(tmp_path)) == [
        "field",
        "outdated",
    ]
