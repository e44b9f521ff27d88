"""A covariance field as an xarray.Dataset."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from locplan._util.extras import needed
from locplan.field._config import FieldConfig
from locplan.field._estimator import Values
from locplan.field._zarr import coordinates
from locplan.maps import OccupancyGrid

if TYPE_CHECKING:
    from xarray import Dataset


def dataset_of(
    values: Values, e: NDArray[np.float64], e_unit: str, grid: OccupancyGrid, config: FieldConfig
) -> Dataset:
    """A field's arrays and e with their coordinates; see `CovarianceField.to_xarray`."""
    needed("xarray", "tables", "to_xarray")
    from xarray import Dataset

    along = coordinates(grid, config)
    places = tuple(along)
    arrays: dict[str, Any] = {name: (places, array) for name, array in values.items()}
    arrays["covariance"] = (*places, "pose_row", "pose_col"), values["covariance"]
    arrays["e"] = places, e, {"units": e_unit}
    at = {name: (name, *described) for name, described in along.items()}
    about = {"map": grid.name, "yaw": grid.origin[2], "estimator": config.estimator.summary}
    return Dataset(arrays, at, about)
