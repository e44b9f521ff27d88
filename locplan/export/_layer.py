"""The deviations of a field as a layer over its map, for QGIS, RViz and Foxglove."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from locplan import __version__
from locplan._util.public import needed
from locplan.export._bags import write_messages
from locplan.export._folders import export_folder
from locplan.export._messages import (
    foxglove_grid,
    grid_map,
    layers_of,
    levels_of,
    occupancy_grid,
)
from locplan.export._registry import ExportSummary
from locplan.field import CovarianceField
from locplan.maps import OccupancyGrid

UNITS = {"position_std": "m", "heading_std": "rad"}
"""The scalars of a layer, with the unit in files."""
BAG, LEGEND = "layer.mcap", "legend.png"
_GDAL_NODATA, _PREDICTOR = 42113, 317


def layer(folder: str | Path, field: CovarianceField, *, frame: str = "map") -> None:
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
    names = names_of(field)
    about = {
        "kind": "layer",
        "locplan": __version__,
        "map": {"name": grid.name, "digest": grid.digest},
        "frame": frame,
        "config": field.config.to_json(),
    }
    title = f"Localizability of {grid.name or 'a map'}"
    with export_folder(Path(folder), title, about, _readme(names, frame)) as temporary:
        norms = {}
        for name in names:
            values = field.on_map(field.scalar(name, headings="mean"))
            norms[name] = figures.norm_of(field, name, values)
            write_raster(temporary / f"{name}.tif", values)
            figures.write_coloured(temporary / f"{name}.png", values, norms[name])
            for suffix in (".tfw", ".pgw"):
                (temporary / name).with_suffix(suffix).write_text(world_file(grid), "ascii")
        save_figure(figures.legend_figure(field, norms, UNITS), temporary / LEGEND)
        _write_bag(temporary / BAG, field, names, frame)


def names_of(field: CovarianceField) -> list[str]:
    """The scalars that a layer of this field has."""
    return list(UNITS)[: field.covariance.shape[-1] - 1]


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


def write_raster(file: Path, values: NDArray[np.float64]) -> None:
    """Write values (H, W) of the map's cells as a TIFF of 32-bit floats, NaN where unknown."""
    from PIL import Image
    from PIL.TiffImagePlugin import ImageFileDirectory_v2

    tags = ImageFileDirectory_v2()
    tags[_GDAL_NODATA] = "nan"
    tags[_PREDICTOR] = 3  # of floats: two thirds of the size
    picture = Image.fromarray(np.ascontiguousarray(values[::-1], np.float32))
    picture.save(file, "tiff", tiffinfo=tags, compression="tiff_adobe_deflate")


def _write_bag(file: Path, field: CovarianceField, names: list[str], frame: str) -> None:
    grid, every = field.grid, layers_of(field)
    layers = {name: every.pop(name) for name in names} | every
    header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": frame}
    content = {
        "/locplan/map": ("nav_msgs/OccupancyGrid", occupancy_grid(grid, levels_of(grid))),
        "/locplan/field": ("grid_map_msgs/GridMap", grid_map(field, layers)),
        "/locplan/grid": ("foxglove_msgs/Grid", foxglove_grid(field, layers, header)),
    }
    write_messages(file, content, header, 0)


def quantiles(field: CovarianceField) -> ExportSummary:
    """The median and the greatest deviations, in the files' units and in those for people."""
    values: dict[str, float] = {}
    rows = []
    for name in names_of(field):
        known = field.scalar(name, headings="mean")[field.evaluated]
        shown = field.quantity(name)
        if known.size:
            median, most = float(np.median(known)), float(known.max())
            values |= {f"{name}_median": median, f"{name}_max": most}
            texts = [f"{shown.factor * value:.3g} {shown.unit}" for value in (median, most)]
            rows.append((shown.label, f"median {texts[0]}, at most {texts[1]}"))
        else:
            rows.append((shown.label, "not known anywhere"))
    return ExportSummary(values, tuple(rows))


def _readme(names: list[str], frame: str) -> list[str]:
    pictures = ", ".join(f"{name}.png" for name in names)
    rasters = ", ".join(f"{name}.tif [{UNITS[name]}]" for name in names)
    topics = "`/locplan/map`, `/locplan/field`, `/locplan/grid`"
    return [
        f"- {pictures}: each cell of the map, transparent where nothing is known; {LEGEND}: their"
        " colours, in cm and degrees and in the files' m and rad.",
        f"- {rasters}: the values, 32-bit floats, NaN where nothing is known. The .pgw and .tfw of"
        f" each place it in the frame {frame} [m], with the map's yaw.",
        f"- {BAG}: a ROS 2 bag with {topics}; its layers begin with {', '.join(names)}"
        f" [{', '.join(UNITS[name] for name in names)}]. export.json: the input.",
        "- QGIS: drag a .tif or .png into a project without a coordinate reference system; the"
        " numbers are metres.",
        f"- RViz: `ros2 bag play --loop {BAG}`; displays Map of `/locplan/map` and, from"
        f" grid_map_rviz_plugin, GridMap of `/locplan/field`; choose {names[0]} as the layer of its"
        f" colours. Fixed frame: {frame}.",
        f"- Foxglove: open {BAG}; in the 3D panel show `/locplan/grid`, coloured by {names[0]}.",
    ]
