import dataclasses
import os

import numpy as np
import pytest
from conftest import random_rooms

from locplan import store
from locplan.config import FieldConfig
from locplan.grid import OccupancyGrid

QUICK = FieldConfig(sensor_range=0.6, window=0.4)


@pytest.fixture
def grid() -> OccupancyGrid:
    return OccupancyGrid(random_rooms((50, 60), seed=4), 0.1, name="rooms")


def computed(monkeypatch) -> list:
    calls = []
    compute = store.covariance_field
    monkeypatch.setattr(
        store, "covariance_field", lambda *a, **k: calls.append(1) or compute(*a, **k)
    )
    return calls


def test_a_field_is_computed_once(grid, tmp_path, monkeypatch):
    calls = computed(monkeypatch)
    first = store.load_or_compute(grid, QUICK, cache_dir=tmp_path)
    second = store.load_or_compute(grid, QUICK, cache_dir=tmp_path)
    assert len(calls) == 1
    np.testing.assert_array_equal(first.covariance, second.covariance)


@pytest.mark.parametrize(
    "change", [{"sensor_range": 0.7}, {"tau": 0.5}, {"quantisation": False}, {"stride": 0.3}]
)
def test_another_config_is_another_field(grid, change):
    other = dataclasses.replace(QUICK, **change)
    assert store.field_path(grid, QUICK) != store.field_path(grid, other)


def test_the_name_of_the_map_is_todays(grid, tmp_path):
    store.load_or_compute(grid, QUICK, cache_dir=tmp_path)
    renamed = dataclasses.replace(grid, name="other")
    assert store.load_or_compute(renamed, QUICK, cache_dir=tmp_path).grid.name == "other"


def test_a_damaged_field_is_computed_anew_with_a_warning(grid, tmp_path, monkeypatch):
    calls = computed(monkeypatch)
    store.load_or_compute(grid, QUICK, cache_dir=tmp_path)
    path = store.field_path(grid, QUICK, tmp_path)
    path.write_bytes(path.read_bytes()[:100])
    with pytest.warns(store.CacheWarning, match="computed anew"):
        store.load_or_compute(grid, QUICK, cache_dir=tmp_path)
    assert len(calls) == 2
    store.load_or_compute(grid, QUICK, cache_dir=tmp_path)
    assert len(calls) == 2


def test_a_cache_that_cannot_be_written_is_a_warning_not_an_error(grid, tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.warns(store.CacheWarning, match="not cached"):
        field = store.load_or_compute(grid, QUICK, cache_dir=tmp_path / "file" / "cache")
    assert field.evaluated.any()


def test_the_folder_is_the_argument_then_the_environment_then_the_users(tmp_path, monkeypatch):
    assert store.cache_folder(tmp_path / "a") == tmp_path / "a"
    monkeypatch.setenv("LOCPLAN_CACHE", os.fspath(tmp_path / "b"))
    assert store.cache_folder() == tmp_path / "b"
    monkeypatch.delenv("LOCPLAN_CACHE")
    assert "locplan" in store.cache_folder().parts
