"""Paths and fields as files that anything reads, and the deviations of a field as a layer."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from locplan import __version__
from locplan._kernels.arrays import Floats
from locplan._util.files import check_target, replacing
from locplan._util.public import needed
from locplan._util.tables import write_csv
from locplan.costs import Costmap, Path
from locplan.export._bags import field_messages, layers_of, map_message, write_messages
from locplan.export._registry import ExportSummary, export_folder
from locplan.field import CovarianceField, position_axes
from locplan.maps import OccupancyGrid


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


def field(path: str | os.PathLike[str], computed: CovarianceField) -> None:
    """Write a field; the suffix chooses the format.

    .csv: a row for each evaluated lattice point, its position, scalars and covariance. .npz: for
    ``numpy.load``, "covariance" on the lattice, its positions "x" and "y" in the world, "e" on the
    lattice, "e_map" and the degeneracy "u_map" on the map's cells, "cells", "resolution", "origin"
    and "config" (JSON). .png: e over the map. .csv, .png and "u_map" merge several headings by
    their mean information.

    Parameters
    ----------
    path : path
        The file, named *.csv, *.npz or *.png; one that is there is replaced.
    computed : CovarianceField
        The field.

    Raises
    ------
    LocplanError
        If the suffix is another, or the file cannot be written.
    """
    from locplan import plotting

    file = FilePath(path)
    check_target(file, ".csv", ".npz", ".png")
    if file.suffix.lower() == ".csv":
        _field_csv(file, computed)
    elif file.suffix.lower() == ".npz":
        _field_npz(file, computed)
    else:
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


def layer(folder: str | FilePath, field: CovarianceField, *, frame: str = "map") -> None:
    """Write the deviations of position and heading as coloured pictures, rasters and a bag.

    position_std.png and heading_std.png show the map's cells as plots do, transparent where
    nothing is known; position_std.tif [m] and heading_std.tif [rad] hold their values. World files
    (.pgw, .tfw) place them, with the map's yaw. The bag has "/locplan/map", nav_msgs/OccupancyGrid,
    "/locplan/field", grid_map_msgs/GridMap, and "/locplan/grid", foxglove_msgs/Grid, as `bag`
    writes them, but position_std and heading_std come first.

    Parameters
    ----------
    folder : path
        The folder; one that holds such an export without changes is replaced.
    field : CovarianceField
        The field; several headings are merged by their mean information. Without rotation there
        is no heading.
    frame : str, default "map"
        The frame of all coordinates.

    Raises
    ------
    LocplanError
        If the package mcap is missing, or the folder cannot be written.
    """
    from locplan.export import _figures as figures
    from locplan.plotting import save_figure

    needed("mcap", "ros", "a layer")
    grid = field.grid
    units = _units_of(field)
    about = {
        "kind": "layer",
        "locplan": __version__,
        "map": {"name": grid.name, "digest": grid.digest},
        "frame": frame,
        "config": field.config.to_json(),
    }
    known = {"map": grid.name or "a map", "units": units, "frame": frame}
    with export_folder(folder, "layer.md", about, **known) as temporary:
        norms = {}
        for name in units:
            values = field.on_map(field.scalar(name, headings="mean"))
            norms[name] = figures.norm_of(field, name, values)
            write_raster(temporary / f"{name}.tif", values)
            figures.write_coloured(temporary / f"{name}.png", values, norms[name])
            for suffix in (".tfw", ".pgw"):
                (temporary / name).with_suffix(suffix).write_text(world_file(grid), "ascii")
        save_figure(figures.legend_figure(field, norms, units), temporary / "legend.png")
        every = layers_of(field)
        layers = {name: every.pop(name) for name in units} | every
        header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": frame}
        content = {"/locplan/map": map_message(grid)} | field_messages(field, layers, header)
        write_messages(temporary / "layer.mcap", content, header, 0)


def _units_of(field: CovarianceField) -> dict[str, str]:
    """The scalars that a layer of this field has, with their units in files."""
    units = {"position_std": "m", "heading_std": "rad"}
    return dict(list(units.items())[: field.covariance.shape[-1] - 1])


def world_file(grid: OccupancyGrid) -> str:
    """The six lines of a world file for a picture whose first row is the map's last one.

    They are the steps of x and y along a row, those down a column, and the centre of the first
    pixel [m].
    """
    step, yaw = grid.resolution, grid.origin[2]
    along = step * np.cos(yaw), step * np.sin(yaw)
    down = step * np.sin(yaw), -step * np.cos(yaw)
    numbers = *along, *down, *grid.cell_to_world(grid.shape[0] - 1, 0)
    return "".join(f"{float(number):.12f}\n" for number in numbers)


def write_raster(file: FilePath, values: Floats) -> None:
    """Write values (H, W) of the map's cells as a TIFF of 32-bit floats, NaN where unknown."""
    from PIL import Image
    from PIL.TiffImagePlugin import ImageFileDirectory_v2

    tags = ImageFileDirectory_v2()
    tags[42113] = "nan"  # GDAL's value of no data
    tags[317] = 3  # the predictor of floats: two thirds of the size
    picture = Image.fromarray(np.ascontiguousarray(values[::-1], np.float32))
    picture.save(file, "tiff", tiffinfo=tags, compression="tiff_adobe_deflate")


def quantiles(field: CovarianceField) -> ExportSummary:
    """The median and the greatest deviations, in the files' units and in those for people."""
    values: dict[str, float] = {}
    rows = []
    for name in _units_of(field):
        known, shown = field.scalar(name, headings="mean")[field.evaluated], field.quantity(name)
        text = "not known anywhere"
        if known.size:
            ends = {f"{name}_median": float(np.median(known)), f"{name}_max": float(known.max())}
            values |= ends
            texts = (f"{shown.factor * value:.3g} {shown.unit}" for value in ends.values())
            text = "median {}, at most {}".format(*texts)
        rows.append((shown.label, text))
    return ExportSummary(values, tuple(rows))
