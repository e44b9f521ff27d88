import json
import os
import shutil

import numpy as np
import pytest
import xarray
import zarr
from conftest import changed, random_rooms

from locplan.errors import FieldError, LocplanError
from locplan.field import (
    CovarianceField,
    Exponential,
    FieldConfig,
    Sad,
    SearchWindow,
    _zarr as field_files,
    covariance_field,
)
from locplan.maps import OccupancyGrid

QUICK = FieldConfig(Sad(range=0.6, window=SearchWindow(half_width=0.4)))


@pytest.fixture(scope="module")
def field() -> CovarianceField:
    grid = OccupancyGrid(random_rooms((180, 240), seed=4), 0.1, (1.0, -2.0, 0.0), name="rooms")
    return covariance_field(grid, QUICK)


@pytest.fixture
def saved(field, tmp_path):
    field.save(tmp_path / "rooms.zarr")
    return tmp_path / "rooms.zarr"


def test_saved_fields_come_back_whole(field, saved):
    loaded = CovarianceField.load(saved)
    np.testing.assert_array_equal(loaded.covariance, field.covariance)
    assert loaded.config == field.config
    assert loaded.grid.digest == field.grid.digest
    assert loaded.grid.name == "rooms"
    assert os.listdir(saved.parent) == ["rooms.zarr"]


def test_any_zarr_reader_opens_them(field, saved):
    group = zarr.open_group(saved, mode="r")
    assert group.metadata.zarr_format == 3
    assert group["covariance"].chunks == (64, 64, 3, 3)
    np.testing.assert_array_equal(group["covariance"][:], field.covariance)
    assert group.attrs["map_name"] == "rooms"
    assert group.attrs["map_digest"] == field.grid.digest
    assert FieldConfig.from_json(group.attrs["config"]) == QUICK


def test_xarray_reads_the_covariance_at_a_position(field, saved):
    with xarray.open_zarr(saved, consolidated=False) as dataset:
        i, j = np.argwhere(field.evaluated)[77]
        x, y = field.grid.cell_to_world(2 * int(i), 2 * int(j))
        there = dataset.covariance.sel(x=x, y=y, method="nearest")
        np.testing.assert_array_equal(there, field.covariance[i, j])
        assert dataset.covariance.dims[:2] == ("y", "x")
        np.testing.assert_array_equal(dataset.cells, field.grid.cells)
        assert dataset.attrs["resolution"] == 0.1
        for name in ("x", "y"):
            np.testing.assert_array_equal(dataset[name], field.to_xarray()[name])


def test_fields_without_rotation_and_turned_maps_come_back(tmp_path):
    grid = OccupancyGrid(random_rooms((30, 40), seed=5), 0.1, (0.0, 0.0, 0.3))
    field = covariance_field(
        grid,
        changed(QUICK, window=SearchWindow(half_rotation_deg=0)),
    )
    field.save(tmp_path / "f.zarr")
    loaded = CovarianceField.load(tmp_path / "f.zarr")
    np.testing.assert_array_equal(loaded.covariance, field.covariance)


def test_a_field_replaces_a_field(field, saved):
    other = covariance_field(field.grid, changed(QUICK, weights=Exponential(0.1)))
    other.save(saved)
    np.testing.assert_array_equal(CovarianceField.load(saved).covariance, other.covariance)
    assert os.listdir(saved.parent) == ["rooms.zarr"]


@pytest.mark.parametrize("there", ["file", "folder", "other group"])
def test_nothing_else_is_replaced(field, tmp_path, there):
    path = tmp_path / "mine.zarr"
    if there == "file":
        path.write_text("mine")
    elif there == "folder":
        path.mkdir()
        (path / "mine").write_text("mine")
    else:
        zarr.create_group(path, attributes={"mine": 1})
    before = sorted(os.walk(tmp_path))
    with pytest.raises(LocplanError, match="choose another name"):
        field.save(path)
    assert sorted(os.walk(tmp_path)) == before


def test_a_link_is_followed(field, saved, tmp_path):
    (tmp_path / "link.zarr").symlink_to(saved)
    field.save(tmp_path / "link.zarr")
    assert (tmp_path / "link.zarr").is_symlink()
    assert sorted(os.listdir(tmp_path)) == ["link.zarr", "rooms.zarr"]


def test_a_failed_save_leaves_the_old_field(field, saved, monkeypatch):
    other = covariance_field(field.grid, changed(QUICK, weights=Exponential(0.1)))
    monkeypatch.setattr(field_files, "write_chunks", lambda *_: (_ for _ in ()).throw(OSError(28)))
    with pytest.raises(LocplanError, match=r"rooms\.zarr: cannot be written"):
        other.save(saved)
    np.testing.assert_array_equal(CovarianceField.load(saved).covariance, field.covariance)
    assert os.listdir(saved.parent) == ["rooms.zarr"]


def test_the_suffix_is_zarr(field, tmp_path):
    with pytest.raises(LocplanError, match=r"must end in \.zarr"):
        field.save(tmp_path / "field.npz")


FILES = (
    "zarr.json",
    "covariance/zarr.json",
    "covariance/c.0.0.0.0",
    "cells/zarr.json",
    "cells/c/0/0",
)


@pytest.mark.parametrize("damage", ["cut", "text", "empty", "flip", "missing"])
@pytest.mark.parametrize("file", FILES)
def test_damaged_fields_are_refused_in_one_line(saved, file, damage):
    path = saved / file
    data = bytearray(path.read_bytes())
    if damage == "flip":
        for at in range(len(data) // 4, len(data), 41):
            data[at] ^= 129
    replaced = {"cut": data[: len(data) // 2], "text": b"not a field", "empty": b"", "flip": data}
    path.unlink() if damage == "missing" else path.write_bytes(replaced[damage])
    with pytest.raises(FieldError, match=r"rooms\.zarr") as error:
        CovarianceField.load(saved)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("seed", range(40))
def test_a_flipped_bit_is_noticed_or_changes_nothing(field, saved, seed):
    rng = np.random.default_rng(seed)
    path = saved / rng.choice(FILES)
    data = bytearray(path.read_bytes())
    data[rng.integers(len(data))] ^= 1 << rng.integers(8)
    path.write_bytes(data)
    try:
        loaded = CovarianceField.load(saved)
    except FieldError:
        return
    np.testing.assert_array_equal(loaded.covariance, field.covariance)
    assert loaded.config == field.config
    assert loaded.grid.digest == field.grid.digest


def test_covariances_of_another_shape_are_not_believed(field, saved, tmp_path):
    small = OccupancyGrid(field.grid.cells[:100], 0.1)
    covariance_field(small, QUICK).save(tmp_path / "small.zarr")
    shutil.rmtree(saved / "covariance")
    (tmp_path / "small.zarr" / "covariance").rename(saved / "covariance")
    with pytest.raises(FieldError, match="does not fit"):
        CovarianceField.load(saved)


def test_field_of_another_engine_is_refused(field, saved, monkeypatch):
    """Its values may differ from those that its settings give now."""
    monkeypatch.setattr("locplan.field._tiles.ENGINE", 99)
    with pytest.raises(
        FieldError, match=r"another locplan \(engine .*, not 99\); compute it again"
    ):
        CovarianceField.load(saved)


def test_a_field_of_another_format_says_so(saved):
    path = saved / "zarr.json"
    about = json.loads(path.read_text())
    about["attributes"]["format"] = "locplan-field-1"
    path.write_text(json.dumps(about))
    with pytest.raises(FieldError, match="its format is 'locplan-field-1'"):
        CovarianceField.load(saved)
