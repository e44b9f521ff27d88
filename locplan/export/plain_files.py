"""Paths and fields as files that anything reads."""

from __future__ import annotations

import json
import os
from pathlib import Path as FilePath

import numpy as np

from locplan import __version__
from locplan._support.files import check_target
from locplan._support.output import replace_file
from locplan._support.tables import write_csv
from locplan.export.registry import FRAME
from locplan.field.field import CovarianceField
from locplan.planning.costmap import Costmap
from locplan.planning.path import Path

PATH_SUFFIXES = ".csv", ".json", ".geojson", ".yaml"


def write_path_file(
    path: str | os.PathLike[str], route: Path, *, frame: str = FRAME, step: float | None = None
) -> None:
    """Write a path; the suffix chooses the format.

    .csv: x, y, heading and distance travelled, a position a row. .json: those by name. .geojson:
    `Path.to_geojson`. .yaml: `Path.to_nav_msgs`, as
    ``ros2 topic pub --once /plan nav_msgs/msg/Path "$(cat FILE)"`` takes it. Positions without a
    heading face the way they go.

    Parameters
    ----------
    write_path_file : path
        The file, named *.csv, *.json, *.geojson or *.yaml; one that is there is replaced.
    route : Path
        The path.
    frame : str, default "map"
        Frame of the coordinates.
    step : float, optional
        Maximum distance of the positions [m], above 0, as a controller may want them: further
        ones between the path's corners, which are all there is by default.

    Raises
    ------
    LocplanError
        If the suffix is another, or the file cannot be written.
    """
    file = FilePath(path)
    check_target(file, *PATH_SUFFIXES)
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
        content = {"locplan": __version__, "frame": frame, "length": route.length, "poses": rows}
        text = json.dumps(content, indent=1)
    elif suffix == ".geojson":
        text = json.dumps(route.to_geojson(frame=frame))
    else:  # YAML, whose lines hold JSON: a pose a line
        fields = route.to_nav_msgs(frame=frame)
        lines = [f"header: {json.dumps(fields['header'])}", "poses:"]
        text = "\n".join([*lines, *(f"- {json.dumps(pose)}" for pose in fields["poses"])])
    with replace_file(file) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")


def write_field_file(path: str | os.PathLike[str], computed: CovarianceField) -> None:
    """Write a field, as `CovarianceField.save`, with the degeneracy "u_map" of the map's cells.

    ``numpy.load`` reads it without locplan. "u_map" merges several headings by their mean
    information.

    Parameters
    ----------
    path : path
        The file, named *.npz; one that is there is replaced.
    computed : CovarianceField
        The field.

    Raises
    ------
    LocplanError
        If the suffix is another, or the file cannot be written.
    """
    computed.save(path, extra_arrays={"u_map": Costmap.from_field(computed).u})
