import json
import os

import numpy as np
import pytest
from support.fields import change_estimator
from support.maps import random_rooms

from locplan.errors import FieldError, LocplanError
from locplan.field import CovarianceField, FieldConfig, Sad, SearchWindow, covariance_field
from locplan.field.sad import Exponential
from locplan.maps import OccupancyGrid

QUICK = FieldConfig(Sad(range=0.6, window=SearchWindow(half_width=0.4)))


@pytest.fixture(scope="module")
def field() -> CovarianceField:
    grid = OccupancyGrid(random_rooms((180, 240), seed=4), 0.1, (1.0, -2.0, 0.0), name="rooms")
    return covariance_field(grid, QUICK)


@pytest.fixture
def saved(field, tmp_path):
    field.save(tmp_path / "rooms.npz")
    return tmp_path / "rooms.npz"


def test_loaded_field_equals_saved_field(field, saved):
    loaded = CovarianceField.load(saved)
    np.testing.assert_array_equal(loaded.covariance, field.covariance)
    assert loaded.config == field.config
    assert loaded.grid.digest == field.grid.digest
    assert loaded.grid.name == "rooms"
    assert os.listdir(saved.parent) == ["rooms.npz"]


def test_numpy_reads_saved_field(field, saved):
    with np.load(saved, allow_pickle=False) as arrays:
        assert {*arrays} == {"about", "cells", "covariance"}
        np.testing.assert_array_equal(arrays["covariance"], field.covariance)
        np.testing.assert_array_equal(arrays["cells"], field.grid.cells)
        about = json.loads(str(arrays["about"]))
    assert (about["map"], about["resolution"], about["origin"]) == ("rooms", 0.1, [1, -2, 0])
    assert about["map_digest"] == field.grid.digest
    assert FieldConfig.from_json(about["config"]) == QUICK


def test_dataset_has_covariance_at_position(field):
    dataset = field.to_xarray()
    i, j = np.argwhere(field.is_evaluated)[77]
    x, y = field.grid.position(2 * int(i), 2 * int(j))
    there = dataset.covariance.sel(x=x, y=y, method="nearest")
    np.testing.assert_array_equal(there, field.covariance[i, j])
    assert dataset.covariance.dims[:2] == ("y", "x")


def test_loaded_positional_field_equals_saved_field(tmp_path):
    """The map has a yaw as well."""
    grid = OccupancyGrid(random_rooms((30, 40), seed=5), 0.1, (0.0, 0.0, 0.3))
    field = covariance_field(
        grid,
        change_estimator(QUICK, window=SearchWindow(half_rotation_deg=0)),
    )
    field.save(tmp_path / "f.npz")
    loaded = CovarianceField.load(tmp_path / "f.npz")
    np.testing.assert_array_equal(loaded.covariance, field.covariance)


def test_failed_save_keeps_old_field(field, saved, monkeypatch):
    other = covariance_field(field.grid, change_estimator(QUICK, weights=Exponential(0.1)))

    def full(*_, **__):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("locplan.field.files.write_arrays", full)
        with pytest.raises(LocplanError, match=r"rooms\.npz: cannot be written"):
            other.save(saved)
    np.testing.assert_array_equal(CovarianceField.load(saved).covariance, field.covariance)
    assert os.listdir(saved.parent) == ["rooms.npz"]
    other.save(saved)
    np.testing.assert_array_equal(CovarianceField.load(saved).covariance, other.covariance)


def test_suffix_of_field_is_npz(field, tmp_path):
    with pytest.raises(LocplanError, match=r"must end in \.npz"):
        field.save(tmp_path / "field.zarr")


@pytest.mark.parametrize("damage", ["cut", "text", "empty", "flip", "missing"])
def test_load_rejects_damaged_field(saved, damage):
    data = bytearray(saved.read_bytes())
    if damage == "flip":
        for at in range(len(data) // 4, len(data), 41):
            data[at] ^= 129
    replaced = {"cut": data[: len(data) // 2], "text": b"not a field", "empty": b"", "flip": data}
    saved.unlink() if damage == "missing" else saved.write_bytes(replaced[damage])
    with pytest.raises(LocplanError, match=r"rooms\.npz") as error:
        CovarianceField.load(saved)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("seed", range(40))
def test_load_detects_flipped_bit(field, saved, seed):
    """A bit that does not change the field may pass."""
    rng = np.random.default_rng(seed)
    data = bytearray(saved.read_bytes())
    # In the arrays, or in the directory at the end.
    at = rng.integers(len(data)) if seed % 2 else len(data) - 1 - rng.integers(250)
    data[at] ^= 1 << rng.integers(8)
    saved.write_bytes(data)
    try:
        loaded = CovarianceField.load(saved)
    except LocplanError:
        return
    np.testing.assert_array_equal(loaded.covariance, field.covariance)
    assert loaded.config == field.config
    assert loaded.grid.digest == field.grid.digest


def test_load_rejects_covariance_of_other_shape(field, saved):
    with np.load(saved) as arrays:
        content = dict(arrays)
    np.savez(saved, **content | {"covariance": content["covariance"][:50]})
    with pytest.raises(FieldError, match="does not fit"):
        CovarianceField.load(saved)


def test_field_of_another_engine_is_refused(field, saved, monkeypatch):
    """Its values may differ from those that its settings give now."""
    monkeypatch.setattr("locplan.field.tiles.ENGINE", 99)
    with pytest.raises(
        FieldError, match=r"another version of locplan \(engine .*, not 99\); compute it again"
    ):
        CovarianceField.load(saved)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"version": 99}, "is of a newer locplan"),
        ({"kind": "costmap"}, "holds a costmap, not a field"),
    ],
)
def test_field_of_another_format_is_refused(saved, change, message):
    with np.load(saved) as arrays:
        content = dict(arrays)
    about = json.loads(str(content["about"])) | change
    np.savez(saved, **content | {"about": np.array(json.dumps(about))})
    with pytest.raises(LocplanError, match=message):
        CovarianceField.load(saved)
