"""Paths and fields as files that anything reads."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from locplan import __version__
from locplan._util.files import check_target, replacing
from locplan._util.tables import write_csv
from locplan.costs import Costmap, Path
from locplan.field import CovarianceField, position_axes

PATH_FILES = (".csv", ".json", ".yaml")
FIELD_FILES = (".csv", ".npz", ".png")


def path(
    target: str | os.PathLike[str], route: Path, *, frame: str = "map", step: float | None = None
) -> None:
    """Write a path; the suffix chooses the format.

    .csv: x, y, heading and distance travelled, a position a row. .json: those by name. .yaml: a
    nav_msgs/Path, as ``ros2 topic pub --once /plan nav_msgs/msg/Path "$(cat FILE)"`` takes it.
    Positions without a heading face the way they go.

    Parameters
    ----------
    target : path
        The file, named *.csv, *.json or *.yaml; one that is there is replaced.
    route : Path
        The path.
    frame : str, default "map"
        Frame of the coordinates.
    step : float, optional
        Greatest distance of the positions [m], above 0, as a controller may want them: further
        ones between the path's corners, which are all there is by default.

    Raises
    ------
    LocplanError
        If the suffix is another, or the file cannot be written.
    """
    file = FilePath(target)
    check_target(file, *PATH_FILES)
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


def field(target: str | os.PathLike[str], computed: CovarianceField) -> None:
    """Write a field; the suffix chooses the format.

    .csv: a row for each evaluated lattice point, its position, scalars and covariance. .npz: for
    ``numpy.load``, "covariance" on the lattice, its positions "x" and "y" in the world, "e" on the
    lattice, "e_map" and the degeneracy "u_map" on the map's cells, "cells", "resolution", "origin"
    and "config" (JSON). .png: e over the map. .csv, .png and "u_map" merge several headings by
    their mean information.

    Parameters
    ----------
    target : path
        The file, named *.csv, *.npz or *.png; one that is there is replaced.
    computed : CovarianceField
        The field.

    Raises
    ------
    LocplanError
        If the suffix is another, or the file cannot be written.
    """
    file = FilePath(target)
    check_target(file, *FIELD_FILES)
    if file.suffix.lower() == ".csv":
        _field_csv(file, computed)
    elif file.suffix.lower() == ".npz":
        _field_npz(file, computed)
    else:
        from locplan import plotting

        plotting.save_figure(plotting.field_figure(computed), file)


def _field_csv(file: FilePath, computed: CovarianceField) -> None:
    known = computed.evaluated
    covariance = computed.mean_covariance[known]
    axes = ("x", "y", "heading")[: covariance.shape[-1]]
    major, minor, direction = position_axes(covariance)
    x, y = _positions(computed)
    columns = {"x": x[known], "y": y[known]}
    columns["e"] = computed.scalar("e", headings="mean")[known]
    columns |= {"position_std": major, "minor_position_std": minor, "direction": direction}
    for name in computed.layers:
        columns[name] = computed.scalar(name, headings="mean")[known]
    for i, one in enumerate(axes):
        for j, other in enumerate(axes[i:], start=i):
            columns[f"cov_{one}_{other}"] = covariance[:, i, j]
    write_csv(file, np.column_stack(list(columns.values())), ",".join(columns), "%.9g")


def _field_npz(file: FilePath, computed: CovarianceField) -> None:
    x, y = _positions(computed)
    with replacing(file) as temporary:
        np.savez_compressed(
            temporary,
            **dict[str, Any](computed.values),
            x=x,
            y=y,
            e=computed.e,
            e_map=computed.e_map(),
            u_map=Costmap.from_field(computed.grid, computed).u,
            cells=computed.grid.cells,
            resolution=computed.grid.resolution,
            origin=computed.grid.origin,
            config=json.dumps(computed.config.to_json()),
        )


def _positions(computed: CovarianceField) -> tuple[np.ndarray, np.ndarray]:
    """World x and y of the lattice's points, (h, w) each [m]."""
    h, w = computed.evaluated.shape
    rows, cols = np.mgrid[:h, :w] * computed.stride + 0.5
    return computed.grid.grid_to_world(rows, cols)
