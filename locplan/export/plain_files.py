"""Paths and fields as files in common formats."""

from __future__ import annotations

import json
import os
from pathlib import Path as FilePath

import numpy as np

from locplan import __version__
from locplan._support.files import check_writable_file, write_text
from locplan._support.output import replace_file
from locplan._support.tables import write_csv
from locplan.export.registry import DEFAULT_FRAME
from locplan.field.field import CovarianceField
from locplan.planning.costmap import Costmap
from locplan.planning.path import Path

PATH_SUFFIXES = ".csv", ".json", ".geojson", ".yaml"


def write_path_file(
    path: str | os.PathLike[str],
    route: Path,
    *,
    frame: str = DEFAULT_FRAME,
    step: float | None = None,
) -> None:
    """Write a path; the suffix chooses the format.

    .csv has x, y, heading and distance travelled, a position per row. .json has the same by name.
    .geojson is `Path.to_geojson`. .yaml is `Path.to_nav_msgs`, for
    ``ros2 topic pub --once /plan nav_msgs/msg/Path "$(cat FILE)"``. Positions without a heading
    face along the path.

    Parameters
    ----------
    path : path
        The file *.csv, *.json, *.geojson or *.yaml; an existing file is replaced.
    route : Path
        The path.
    frame : str, default "map"
        Frame of the coordinates.
    step : float, optional
        Maximum distance between positions [m], above 0, as some controllers need. By default the
        file has only the path's corners.

    Raises
    ------
    LocplanError
        If the suffix is unknown, or the file cannot be written.
    """
    file = FilePath(path)
    check_writable_file(file, *PATH_SUFFIXES)
    if step is not None:
        route = route.resample(step)
    poses = np.column_stack([route.xy, route.facing, route.distance])
    names = ("x", "y", "heading", "distance")
    suffix = file.suffix.lower()
    if suffix == ".csv":
        write_csv(file, poses, ",".join(names))
        return
    if suffix == ".json":
        rows = [dict(zip(names, pose, strict=True)) for pose in poses.tolist()]
        route_data = {"locplan": __version__, "frame": frame, "length": route.length, "poses": rows}
        text = json.dumps(route_data, indent=1)
    elif suffix == ".geojson":
        text = json.dumps(route.to_geojson(frame=frame))
    else:  # YAML with a pose per line, each in JSON
        fields = route.to_nav_msgs(frame=frame)
        lines = [f"header: {json.dumps(fields['header'])}", "poses:"]
        text = "\n".join([*lines, *(f"- {json.dumps(pose)}" for pose in fields["poses"])])
    with replace_file(file) as temporary:
        write_text(temporary, text + "\n")


def write_field_file(path: str | os.PathLike[str], field: CovarianceField) -> None:
    """Write a field like `CovarianceField.save`, and the degeneracy of the map's cells as "u_map".

    ``numpy.load`` reads the file without locplan. "u_map" combines several headings by their mean
    information.

    Parameters
    ----------
    path : path
        The file *.npz; an existing file is replaced.
    field : CovarianceField
        The field.

    Raises
    ------
    LocplanError
        If the suffix is unknown, or the file cannot be written.
    """
    field.save(path, extra_arrays={"u_map": Costmap.from_field(field).u})
