"""Files of covariance fields: .npz, for `CovarianceField.load`, numpy, and the cache.

A file holds a description "about" in JSON, the map's levels "cells", the arrays of the field by
name, and in the cache "points", the mask of the lattice points that the rows of the arrays are of.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from locplan._support.arrays import read_arrays, write_arrays
from locplan._support.checks import short_repr
from locplan._support.kernels.arrays import Array, Bools
from locplan._support.output import replace_file
from locplan._support.reading import MAX_JSON_BYTES, check_file_stamp, make_file_stamp, parse_json
from locplan._support.saved import TREE_NAME
from locplan.errors import FieldError, LocplanError
from locplan.field import tiles
from locplan.field.config import FieldConfig
from locplan.field.covariance import check_values
from locplan.field.estimator import MapPart, Values, declared_versions, is_from_locplan
from locplan.maps.grid import OccupancyGrid

FIELD_SUFFIX = ".npz"
KIND, VERSION = "field", 1
CELLS, POINTS = "cells", "points"
MAX_CELLS = 2**28
"""Maximum number of cells of a map in a file."""
IDENTIFYING_KEYS = ("engine", "map_digest", "identity")
"""Entries of a description that decide the values of a field."""
MATCHING_KEYS = ("engine", "map_shape", "resolution", "origin", "identity")
"""Entries that fields share if values of one may be values of the other."""


def make_metadata(
    grid: OccupancyGrid, config: FieldConfig, *, cached: bool = False
) -> dict[str, Any]:
    """Return the description of a field, fit for JSON.

    A FieldError if it is to be cached and its estimator declares no version.
    """
    estimator = config.estimator
    try:
        has_versions = cached and not is_from_locplan(estimator)
        metadata = {
            **make_file_stamp(KIND, VERSION),
            "engine": tiles.ENGINE,
            "map": grid.name,
            "map_digest": grid.digest,
            "map_shape": list(grid.shape),
            "resolution": grid.resolution,
            "origin": list(grid.origin),
            "identity": {
                "estimator": estimator.identity(),
                "stride_cells": config.stride_cells(grid.resolution),
                "headings": config.headings,
                "versions": declared_versions(estimator) if has_versions else [],
            },
            "title": config.title,
            "config": config.to_json(),
        }
        described: dict[str, Any] = json.loads(json.dumps(metadata))
    except (LocplanError, TypeError, ValueError) as error:  # the others are of JSON
        raise FieldError(f"estimator {short_repr(estimator.name)}: {error}") from None
    return described


def compute_cache_key(metadata: Mapping[str, Any]) -> str:
    """Return the name of a field in the cache from its description."""
    decisive = json.dumps([metadata[name] for name in IDENTIFYING_KEYS], sort_keys=True)
    return hashlib.sha256(decisive.encode()).hexdigest()[:32]


def write_field(
    file: Path,
    values: Values,
    grid: OccupancyGrid,
    metadata: Mapping[str, Any],
    extra_arrays: Mapping[str, Array] | None = None,
) -> None:
    """Write a whole field for people: compressed, and whole arrays.

    `metadata` is the field's description. `extra_arrays` are further arrays that are written along.
    """
    arrays = {
        TREE_NAME: np.array(json.dumps(metadata)),
        CELLS: grid.cells,
        **values,
        **(extra_arrays or {}),
    }
    with replace_file(file) as temporary:
        write_arrays(temporary, arrays)


def write_points(
    file: Path,
    values: Values,
    points: Bools,
    metadata: Mapping[str, Any],
    cells: Array | None = None,
) -> None:
    """Write the values at some points for the cache, which reads them fast.

    `metadata` is the field's description. The map's levels are left out of parts of a field.
    """
    rows: dict[str, Array] = {name: array[points] for name, array in values.items()}
    arrays = {TREE_NAME: np.array(json.dumps(metadata)), POINTS: points, **rows}
    if cells is not None:
        arrays[CELLS] = cells
    with replace_file(file) as temporary:
        write_arrays(temporary, arrays, uncompressed_names=rows)


def read_metadata(file: Path) -> dict[str, Any]:
    """Read the description of a field; a LocplanError for any file that is no field."""
    text = str(_read_array(file, MAX_JSON_BYTES, TREE_NAME)[TREE_NAME])
    try:
        metadata = parse_json(text)
    except ValueError:
        metadata = None
    check_file_stamp(file, metadata, KIND, VERSION)
    described: dict[str, Any] = metadata
    return described


def fill_values_from_file(
    values: Values,
    file: Path,
    grid: OccupancyGrid,
    config: FieldConfig,
    selection: Bools | None = None,
) -> None:
    """Fill NaN in the arrays of a field with the values in a file.

    Only the points `selection` are filled. A FieldError if the arrays in the file do not fit.
    """
    shapes = tiles.compute_field_shapes(grid, config)
    lattice = shapes["covariance"][:2]
    limit = 8 * sum(map(math.prod, shapes.values())) + math.prod(lattice) + 10**4
    try:
        arrays = read_arrays(file, limit, (POINTS, *shapes))
        is_whole = POINTS not in arrays
        is_stored = np.ones(lattice, bool) if is_whole else arrays[POINTS]
        if is_stored.dtype != bool or is_stored.shape != lattice:
            raise ValueError(f"its {POINTS} do not fit its map")
        for name, shape in shapes.items():
            expected = shape if is_whole else (int(is_stored.sum()), *shape[2:])
            if arrays[name].dtype != np.float64 or arrays[name].shape != expected:
                raise ValueError(f"its {name} does not fit its map and config")
    except (OSError, ValueError, KeyError) as error:
        raise FieldError(f"{file}: is damaged, or no field ({_format_error(error)})") from None
    new = is_stored & ~tiles.find_computed_points(values)
    if selection is not None:
        new &= selection
    is_new = new[is_stored]
    for name, array in values.items():
        rows = arrays[name].reshape(-1, *array.shape[2:])
        array[new] = rows if is_new.all() else rows[is_new]


def read_values(file: Path, grid: OccupancyGrid, config: FieldConfig) -> Values:
    """Read the arrays of a field; NaN for points without values."""
    values = tiles.make_empty_values(grid, config)
    fill_values_from_file(values, file, grid, config)
    return values


def read_grid(file: Path, metadata: Mapping[str, Any]) -> OccupancyGrid:
    """Read the map that a field belongs to; `metadata` is the field's description."""
    cells = _read_array(file, MAX_CELLS, CELLS)[CELLS]
    try:
        return OccupancyGrid(
            cells, metadata["resolution"], tuple(metadata["origin"]), metadata["map"]
        )
    except (LookupError, TypeError, LocplanError) as error:
        raise FieldError(f"{file}: its map is damaged ({_format_error(error)})") from None


def read_field(file: Path) -> tuple[Values, OccupancyGrid, FieldConfig]:
    """Read a whole field: its arrays, map and config."""
    metadata = read_metadata(file)
    if metadata.get("engine") != tiles.ENGINE:
        raise FieldError(
            f"{file}: its values come from another version of locplan (engine"
            f" {metadata.get('engine')!s:.9},"
            f" not {tiles.ENGINE}); compute it again"
        )
    grid = read_grid(file, metadata)
    try:
        config = FieldConfig.from_json(metadata["config"])
    except (AttributeError, LookupError, TypeError, LocplanError) as error:
        raise FieldError(f"{file}: its config cannot be used ({_format_error(error)})") from None
    values = read_values(file, grid, config)
    lacking = int(
        (tiles.find_required_points(grid, config) & ~tiles.find_computed_points(values)).sum()
    )
    if lacking:
        raise FieldError(f"{file}: {lacking} points were never computed; compute it again")
    return values, grid, config


def check_readable(values: Values, grid: OccupancyGrid, config: FieldConfig) -> None:
    """Raise a FieldError if `read_field` could not read these values once they are written."""
    estimator = config.estimator
    kind = type(estimator)
    try:
        reloaded = FieldConfig.from_json(json.loads(json.dumps(config.to_json())))
        readable = type(reloaded.estimator).__qualname__ == kind.__qualname__
    except Exception:  # settings of a user's own fail in as many ways as they are written
        readable = False
    if not readable:
        raise FieldError(
            f"a field of estimator {short_repr(estimator.name)} could not be read again; give the"
            " class a unique name and settings fit for JSON, and register it:"
            f" locplan.field.ESTIMATORS[{estimator.name!r}] = {kind.__qualname__}"
        )
    for name, shape in tiles.compute_field_shapes(grid, config).items():
        if name not in values or values[name].shape != shape:
            raise FieldError(f"the field's {name} must be an array of shape {shape}")
    is_computed, stride = tiles.find_computed_points(values), config.stride_cells(grid.resolution)
    rows, cols = (index * stride for index in np.nonzero(is_computed))
    part = MapPart(
        grid.cells, rows, cols, grid.resolution, grid.shape, headings=config.heading_angles
    )
    check_values({name: array[is_computed] for name, array in values.items()}, estimator, part)


def _read_array(file: Path, limit: int, name: str) -> dict[str, Any]:
    """Read one array of a field's file."""
    try:
        arrays = read_arrays(file, limit, (name,))
        if name not in arrays:
            raise ValueError(f"it has no {name}")
        return arrays
    except FileNotFoundError:
        raise FieldError(f"{file}: there is no such file") from None
    except (OSError, ValueError) as error:
        raise FieldError(f"{file}: is damaged, or no field ({_format_error(error)})") from None


def _format_error(error: Exception) -> str:
    """Return the message of an error while reading."""
    return " ".join(str(error).split())[:120] or type(error).__name__
