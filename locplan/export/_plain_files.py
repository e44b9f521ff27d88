"""Paths and fields as files that anything reads."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path as FilePath

import numpy as np

from locplan import __version__
from locplan._util.files import check_target, replacing
from locplan._util.tables import write_csv
from locplan.costs import Costmap, Path
from locplan.field import CovarianceField


def path(
    path: str | os.PathLike[str], route: Path, *, frame: str = "map", step: float | None = None
) -> None:
    """Write a path; the suffix chooses the format.

    .csv: x, y, heading and distance travelled, a position a row. .json: those by name. .yaml: a
    nav_msgs/Path, as ``ros2 topic pub --once /plan nav_msgs/msg/Path "$(cat FILE)"`` takes it.
    Positions without a heading face the way they go.

    Parameters
    ----------
    path : path
        The file, named *.csv, *.json or *.yaml; one that is there is replaced.
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
    check_target(file, ".csv", ".json", ".yaml")
    if step is not None:
        route = route.resampled(step)
    poses = np.column_stack([route.xy, route.facing, route.distance])
    if file.suffix.lower() == ".csv":
        write_csv(file, poses, "x,y,heading,distance")
        return
    if file.suffix.lower() == ".json":
        names = ("x", "y", "heading", "distance")
        rows = [dict(zip(names, pose, strict=True)) for pose in poses.tolist()]
        about = {"locplan": __version__, "frame": frame, "length": route.length, "poses": rows}
        text = json.dumps(about, indent=1)
    else:
        text = _nav_path(poses, frame)
    with replacing(file) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")


def _nav_path(poses: np.ndarray, frame: str) -> str:
    """A nav_msgs/Path in YAML, whose lines hold JSON: a pose a line."""
    stamp = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": frame}
    lines = [f"header: {json.dumps(stamp)}", "poses:"]
    for x, y, heading, _ in poses.tolist():
        position = {"x": x, "y": y, "z": 0.0}
        turn = {"x": 0.0, "y": 0.0, "z": math.sin(heading / 2), "w": math.cos(heading / 2)}
        pose = {"header": stamp, "pose": {"position": position, "orientation": turn}}
        lines.append(f"- {json.dumps(pose)}")
    return "\n".join(lines)


NUMPY_SUFFIX = ".npz"


def field(path: str | os.PathLike[str], computed: CovarianceField) -> None:
    """Write a field for ``numpy.load``, which needs no locplan.

    It has "covariance" on the lattice, the degeneracy "u_map" and the levels "cells" of the map's
    cells, "resolution", "origin" and "config" (JSON). "u_map" merges several headings by their mean
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
    file = FilePath(path)
    check_target(file, NUMPY_SUFFIX)
    with replacing(file) as temporary, open(temporary, "wb") as stream:
        np.savez_compressed(
            stream,
            covariance=computed.covariance,
            u_map=Costmap.from_field(computed.grid, computed).u,
            cells=computed.grid.cells,
            resolution=computed.grid.resolution,
            origin=computed.grid.origin,
            config=json.dumps(computed.config.to_json()),
        )
