"""Covariance fields as Zarr v3 groups, which xarray and every other Zarr reader open.

A group holds `covariance` (y, x, pose_row, pose_col), its coordinates `y` and `x`, and the map as
`cells` (row, col); its attributes describe them. Where there are several headings, `heading` comes
after x. Some estimators add layers, (y, x) or (y, x, heading). A chunk that was not computed is
absent, and reads as NaN; each chunk that was computed carries a checksum.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from locplan import __version__
from locplan._util.checks import shown
from locplan._util.files import check_folder_target
from locplan._util.reading import MAX_JSON_BYTES, parsed_json, read_bytes
from locplan.errors import FieldError, LocplanError
from locplan.field import _tiles as tiles
from locplan.field._config import FieldConfig
from locplan.field._covariance import check_values
from locplan.field._estimator import MapPart, Values, declared_versions, is_ours
from locplan.field._lattice import evaluated_points
from locplan.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid

FORMAT = "locplan-field-4"
FIELD_SUFFIX = ".zarr"
DECISIVE = ("format", "engine", "map_digest", "identity")
"""Attributes that decide the values of a field."""


def attributes(grid: OccupancyGrid, config: FieldConfig, **identity: str) -> dict[str, Any]:
    """Attributes of a field's group, which describe the field; `identity` is put to its own."""
    return {
        "format": FORMAT,
        "engine": tiles.ENGINE,
        "locplan": __version__,
        "map_name": grid.name,
        "map_digest": grid.digest,
        "map_shape": list(grid.shape),
        "resolution": grid.resolution,
        "origin": list(grid.origin),
        "identity": {
            "estimator": config.estimator.identity(),
            "stride_cells": config.stride_cells(grid.resolution),
            "headings": config.headings,
            **identity,
        },
        "config": config.to_json(),
    }


def cached_attributes(grid: OccupancyGrid, config: FieldConfig, in_part: bool) -> dict[str, Any]:
    """Attributes of a cached field; a FieldError if nothing can say what decides its values."""
    identity, estimator = {"points": "some"} if in_part else {}, config.estimator
    try:
        if not is_ours(estimator):
            identity["version"] = ", ".join(declared_versions(estimator))
        about = attributes(grid, config, **identity)
        json.dumps(about)
    except (LocplanError, TypeError, ValueError) as error:  # the others are of JSON
        raise FieldError(f"estimator {shown(estimator.name)}: {error}") from None
    return about


def name_of(about: dict[str, Any]) -> str:
    """Name in the cache of the field that has these attributes."""
    decisive = [about[name] for name in DECISIVE]
    key = hashlib.sha256(json.dumps(decisive, sort_keys=True).encode()).hexdigest()[:32]
    return key + FIELD_SUFFIX


def kind_of(about: dict[str, Any]) -> dict[str, Any]:
    """The attributes that fields must share for values of one to be values of the other."""
    names = ("format", "engine", "map_shape", "resolution", "origin")
    identity = {name: value for name, value in about["identity"].items() if name != "points"}
    return {**{name: about.get(name) for name in names}, "identity": identity}


def read_attributes(folder: Path) -> dict[str, Any]:
    """Read the attributes of a field's group."""
    try:
        description = read_bytes(folder / "zarr.json", MAX_JSON_BYTES).decode("utf-8")
        about: dict[str, Any] = parsed_json(description)["attributes"]
        if about["format"] != FORMAT:
            found = shown(about["format"])
            raise ValueError(f"its format is {found}, not {FORMAT}: compute it by this locplan")
        if about["checksum"] != _checksum(about):
            raise ValueError("its description does not match its checksum")
        kinds = {"map_name": str, "map_digest": str, "map_shape": list, "origin": list}
        for name, kind in {**kinds, "identity": dict, "config": dict, "chunks": int}.items():
            if not isinstance(about[name], kind):
                raise ValueError(f"its {name} is {shown(about[name])}")
        return about
    except (FileNotFoundError, NotADirectoryError):
        what = "holds no zarr.json" if os.path.exists(folder) else "no such folder"
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        what = _in_short(error)
    raise FieldError(f"{folder}: not a covariance field ({what})")


def check_field_target(path: Path, *, force: bool = False) -> None:
    """Check that `CovarianceField.save` can write to a folder, before a field is computed.

    Parameters
    ----------
    path : path
        The folder, named *.zarr.
    force : bool, default False
        See `CovarianceField.save`.

    Raises
    ------
    LocplanError
        If it cannot be written, or something else is in the way.
    """
    check_folder_target(path, FIELD_SUFFIX, partial(may_be_replaced, force=force))


def may_be_replaced(folder: Path, *, force: bool = False) -> bool:
    """Return whether a folder holds a covariance field, which is known by its attributes.

    Raises
    ------
    FieldError
        Unless `force` is set: if the field has files in it that locplan did not write.
    """
    try:
        layers = FieldConfig.from_json(read_attributes(folder)["config"]).estimator.layers
    except (LocplanError, KeyError, TypeError):
        return False
    if force:
        return True
    arrays = "|".join(("covariance", "cells", "y", "x", "heading", *(each.name for each in layers)))
    ours = re.compile(rf"zarr\.json|({arrays})/(zarr\.json|c([./]\d+)*(\.\w+\.partial)?)")
    for path in folder.rglob("*"):
        its_own = ours.fullmatch(path.relative_to(folder).as_posix())
        if path.is_symlink() or not (path.is_dir() or its_own):
            raise FieldError(
                f"{path}: is in the way, and not locplan's; move it, name another folder, or"
                " replace the field with --force (in Python force=True)"
            )
    return True


def write(
    folder: Path,
    values: Values,
    grid: OccupancyGrid,
    config: FieldConfig,
    about: dict[str, Any] | None = None,
) -> None:
    """Write a field's group: the map, the coordinates, and all values that are known.

    `about` are the `attributes` of the field.
    """
    import zarr
    from zarr.codecs import Crc32cCodec, ZstdCodec

    compressed: Any = [ZstdCodec(level=1), Crc32cCodec()]
    edge, stride = _edge(grid, config), config.stride_cells(grid.resolution)
    chunks = sum(1 for _ in tiles.chunks_of(evaluated_points(grid.free, stride), edge))
    about = (about or attributes(grid, config)) | {"chunks": chunks}
    about["checksum"] = _checksum(about)
    group = zarr.create_group(folder, zarr_format=3, attributes=about)
    quantities = {layer.name: (layer.label, layer.unit) for layer in config.estimator.layers}
    whole = "covariance of a pose match (x, y, theta), world frame"
    quantities["covariance"] = whole, "m2, m rad, rad2"
    places = tiles.coordinates(grid, config)
    for name, shape in tiles.field_shapes(grid, config).items():
        group.create_array(
            name,
            chunk_key_encoding={"name": "default", "separator": tiles.separator_of("float64")},
            shape=shape,
            chunks=(edge, edge, *shape[2:]),
            dtype="float64",
            fill_value=np.nan,
            compressors=compressed,
            dimension_names=(*places, "pose_row", "pose_col")[: len(shape)],
            attributes=dict(zip(("long_name", "units"), quantities[name], strict=True)),
        )
    group.create_array(
        "cells",
        data=grid.cells,
        chunks=tuple(min(1024, size) for size in grid.shape),
        compressors=compressed,
        dimension_names=("row", "col"),
        attributes={
            "long_name": "occupancy, row 0 at the lowest y",
            "flag_values": [OCCUPIED, UNKNOWN, FREE],
            "flag_meanings": "occupied unknown free",
        },
    )
    for name, (points, meaning) in places.items():
        group.create_array(name, data=points, dimension_names=(name,), attributes=meaning)
    write_chunks(folder, values, [*tiles.chunks_of(tiles.known_points(values), edge)])


def write_chunks(folder: Path, values: Values, chunks: Iterable[tiles.Chunk]) -> None:
    """Write finished chunks, each whole or not at all, with its covariances last."""
    import zarr

    # A reader takes values as known only where there are covariances.
    names = sorted(values, key="covariance".__eq__)
    arrays: Any = [(values[name], zarr.open_array(folder / name, mode="r+")) for name in names]
    for chunk in chunks:
        for computed, array in arrays:
            array[chunk] = computed[chunk]


def check_readable(values: Values, grid: OccupancyGrid, config: FieldConfig) -> None:
    """Raise a FieldError if `read` could not read these values again, once they are written."""
    estimator = config.estimator
    kind = type(estimator)
    try:
        again = FieldConfig.from_json(json.loads(json.dumps(config.to_json())))
        readable = type(again.estimator).__qualname__ == kind.__qualname__
    except Exception:  # settings of a user's own fail in as many ways as they are written
        readable = False
    if not readable:
        raise FieldError(
            f"a field of estimator {shown(estimator.name)} could not be read again; give the class"
            " a name of its own and settings fit for JSON, and register it:"
            f" locplan.field.ESTIMATORS[{estimator.name!r}] ="
            f" {f'{kind.__module__}:{kind.__qualname__}'!r}"
        )
    for name, shape in tiles.field_shapes(grid, config).items():
        if name not in values or values[name].shape != shape:
            raise FieldError(f"the field's {name} must be an array of shape {shape}")
    known, stride = tiles.known_points(values), config.stride_cells(grid.resolution)
    rows, cols = (index * stride for index in np.nonzero(known))
    part = MapPart(
        grid.cells, rows, cols, grid.resolution, grid.shape, headings=config.heading_angles
    )
    check_values({name: array[known] for name, array in values.items()}, estimator, part)


def count_chunks(folder: Path) -> int:
    """Number of finished chunks of covariances; the attribute "chunks" says of how many."""
    try:
        names = os.listdir(folder / "covariance")
    except OSError:
        return 0  # the folder is not there, or has just been removed
    return sum(name.startswith("c.") and not name.endswith(".partial") for name in names)


def read_values(folder: Path, grid: OccupancyGrid, config: FieldConfig) -> tuple[Values, int]:
    """Read a field's arrays, NaN where a chunk is absent or damaged, and count damaged chunks."""
    shapes = tiles.field_shapes(grid, config)
    values, damaged = {}, 0
    for name, shape in shapes.items():
        try:
            values[name], lost = tiles.read_array(folder / name, shape)
        except Exception as error:  # a damaged description fails in as many ways as JSON can be cut
            raise FieldError(f"{folder}: not a covariance field ({_in_short(error)})") from None
        damaged += lost
    for name in shapes:  # a place is known if all its values are
        lost_here = np.isnan(values[name]).reshape(*shapes[name][:2], -1)[:, :, 0]
        values["covariance"][lost_here] = np.nan
    return values, damaged


def has_todays_chunks(folder: Path, grid: OccupancyGrid, config: FieldConfig) -> bool:
    """Return whether a field's chunks are as large as they would be if it were computed now."""
    shapes, edge = tiles.field_shapes(grid, config), _edge(grid, config)
    return all(tiles.chunk_of(folder / name, shapes[name])[:2] == (edge, edge) for name in shapes)


def read_grid(folder: Path, about: dict[str, Any]) -> OccupancyGrid:
    """Read the map that a field belongs to; `about` is what `read_attributes` returned."""
    try:
        rows, cols = about["map_shape"]
        if rows * cols > 2**28:
            raise ValueError("it has over 2^28 cells")
        cells, damaged = tiles.read_array(folder / "cells", (rows, cols), "uint8")
        if damaged:
            raise ValueError(f"damaged chunks: {damaged}")
        grid = OccupancyGrid(cells, about["resolution"], tuple(about["origin"]), about["map_name"])
    except Exception as error:  # a damaged description fails in many ways
        raise FieldError(f"{folder}: its map is damaged ({_in_short(error)})") from None
    if grid.digest != about["map_digest"]:
        raise FieldError(f"{folder}: the map inside does not match its digest")
    return grid


def read(folder: Path) -> tuple[Values, OccupancyGrid, FieldConfig]:
    """Read a whole field: its arrays, map and config."""
    about = read_attributes(folder)
    if about.get("engine") != tiles.ENGINE:
        raise FieldError(
            f"{folder}: its values are those of another locplan (engine {about.get('engine')!s:.9},"
            f" not {tiles.ENGINE}); compute it again"
        )
    grid = read_grid(folder, about)
    try:
        config = FieldConfig.from_json(about["config"])
    except (KeyError, TypeError, LocplanError) as error:
        raise FieldError(f"{folder}: its config cannot be used ({_in_short(error)})") from None
    values, damaged = read_values(folder, grid, config)
    left = int((tiles.needed_points(grid, config) & ~tiles.known_points(values)).sum())
    if damaged or left:
        why = f"{damaged} chunks are damaged" if damaged else f"{left} points were never computed"
        raise FieldError(f"{folder}: {why}; compute it anew")
    return values, grid, config


def _edge(grid: OccupancyGrid, config: FieldConfig) -> int:
    """Edge length of a chunk [lattice points]."""
    height, width = tiles.field_shapes(grid, config)["covariance"][:2]
    return min(tiles.chunk_edge(config, grid.resolution), max(height, width))


def _checksum(about: dict[str, Any]) -> str:
    """SHA-256 of the attributes; chunks have checksums of their own, and the map has a digest."""
    described = {name: value for name, value in about.items() if name != "checksum"}
    return hashlib.sha256(json.dumps(described, sort_keys=True).encode()).hexdigest()


def _in_short(error: Exception) -> str:
    return " ".join(str(error).split())[:120] or type(error).__name__
