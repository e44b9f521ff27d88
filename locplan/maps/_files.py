"""Occupancy grid maps on disk: the YAML and the image that ROS's map_server reads and writes."""

from __future__ import annotations

import math
import os
import re
import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from locplan._kernels.arrays import Octets, Singles
from locplan._util.checks import file_path, printable
from locplan._util.output import NEW, decide, digest_of, temporary_folder
from locplan._util.reading import dumped, fault_of, opened, reason_of
from locplan._util.runs import note_map
from locplan.errors import MapError
from locplan.maps import environments
from locplan.maps._built_in import is_built_in, remedy_for
from locplan.maps._grid import OccupancyGrid, check_grid
from locplan.maps._image_faults import missing_image
from locplan.maps._occupancy import FREE, OCCUPIED, UNKNOWN
from locplan.maps._source import (
    MAX_YAML_BYTES,
    MODES,
    ROWS,
    Header,
    MapSource,
    read_header,
    read_pixels,
)

if TYPE_CHECKING:
    from PIL import Image


class MapWarning(UserWarning):
    """Warning that a map file was read as written, but probably not as intended."""


def load_map(path: str | os.PathLike[str]) -> OccupancyGrid:
    """Read a map_server YAML and its image (PGM, PBM, PNG or BMP), or return a built-in map.

    Thresholds are compared as in Nav2, ends included. Values between them are unknown, also in
    mode ``scale``; in mode ``raw`` they apply to the pixel's per cent. The image's bottom row
    becomes row 0. The YAML's stem becomes the name, or for a map.yaml its folder's name. The
    origin [m, m, rad] keeps its yaw.

    Parameters
    ----------
    path : path
        The YAML file, a folder with a single map in it, or the name of a built-in map
        (`locplan.maps.environments.names`), with cells of 0.05 m. A path that exists wins over a
        built-in name. The image may have 2^28 pixels.

    Raises
    ------
    MapError
        If a file cannot be read or is damaged, or a key is missing or out of its range.

    Warns
    -----
    MapWarning
        If map_saver's grey for unknown makes over 1 % of the cells free.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_map(OccupancyGrid([[0, 254], [127, 254]], resolution=0.05), folder + "/room.yaml")
    ...     grid = load_map(folder + "/room.yaml")
    >>> grid.name, grid.cells.tolist()
    ('room', [[0, 254], [127, 254]])
    >>> load_map("two_corridors").shape
    (316, 824)
    """
    grid, source = read_map(path)
    note_map(grid.name, lambda: grid.digest)
    if source and source.has_free_grey:
        count = source.saver_grey_free
        fault = (
            f"{count} pixels ({count / grid.cells.size:.0%}) of map_saver's unknown grey are free"
        )
        remedy = f"if unknown is meant, set free_thresh: 0.196 (it is {source.free_thresh})"
        warnings.warn(MapWarning(fault_of(Path(source.file), fault, remedy)), stacklevel=2)
    return grid


def read_map(path: str | os.PathLike[str]) -> tuple[OccupancyGrid, MapSource | None]:
    """Read a map as `load_map` does, without its warning, and tell how its pixels were read.

    Parameters
    ----------
    path : path
        See `load_map`.

    Returns
    -------
    grid, source : OccupancyGrid, MapSource or None
        The map, and the entries of the YAML with the number of pixels that they make what; None
        for a built-in map, which has no file.

    Raises
    ------
    MapError
        As `load_map`.
    """
    file = file_path("a map file", path)
    if os.path.isdir(file):  # unlike Path.is_dir it is False for a name that is too long
        folder = file
        (file, *others) = find_maps(folder)
        if os.path.isdir(file):
            raise fault_of(file, "is a folder without any map", "give a map's YAML")
        if others:
            raise fault_of(folder, f"holds {1 + len(others)} maps", f"name one, such as {file}")
    elif is_built_in(file):
        return environments.make(str(file)), None
    elif not os.path.lexists(file) and file.name == str(file) and not file.suffix:
        raise fault_of(file, "is no file and no built-in map", remedy_for(str(file)))
    return _read(file, read_header(file))


def as_meant(grid: OccupancyGrid, source: MapSource | None) -> OccupancyGrid:
    """The map with dark greys read as walls, and map_saver's grey as unknown, if it is not so.

    Parameters
    ----------
    grid : OccupancyGrid
        The map as its file says.
    source : MapSource or None
        How it was read; without it the map stays.
    """
    if source is None or source.meant_thresholds == (source.free_thresh, source.occupied_thresh):
        return grid
    file, (free, occupied) = Path(source.file), source.meant_thresholds
    header = read_header(file)._replace(free_thresh=free, occupied_thresh=occupied)
    return replace(_read(file, header)[0], name=grid.name)


def meant_header(source: MapSource, more: Mapping[str, object] | None = None) -> str:
    """A map's YAML with the thresholds of `as_meant`; the image is named in full.

    Parameters
    ----------
    source : MapSource
        How the map was read.
    more : mapping of str to object, optional
        Further entries that are to be other ones.
    """
    file, (free, occupied) = Path(source.file), source.meant_thresholds
    header = read_header(file)._replace(free_thresh=free, occupied_thresh=occupied)
    image = str((file.parent / header.image).resolve())
    return _text_of(header._replace(image=image), more or {})


def _text_of(header: Header, more: Mapping[str, object]) -> str:
    """A map's YAML, with some entries other ones."""
    # ROS 1 does not read true and false.
    entries = header._asdict() | {"negate": int(header.negate), **more}
    return dumped(entries, default_flow_style=None, sort_keys=True, width=math.inf)


def _read(file: Path, header: Header) -> tuple[OccupancyGrid, MapSource]:
    """The map of a file's image under some header, and how its pixels were read."""
    image = file.parent / header.image
    if not os.path.lexists(image):
        raise missing_image(file, header.image)
    pixels, seen, rescaled = read_pixels(image)
    raw = header.mode == "raw"
    if raw and (pixels.dtype != np.uint8 or rescaled):
        raise fault_of(image, "has not 8 bits a pixel, as mode raw needs", "save it as 8-bit grey")
    occupancy, levels = _meaning_of_values(header, int(np.iinfo(pixels.dtype).max))
    cells = np.empty(pixels.shape, np.uint8)
    for rows in range(0, len(cells), ROWS):  # an index takes 8 bytes for each pixel
        cells[rows : rows + ROWS] = levels[pixels[rows : rows + ROWS]]
    seen = None if raw else seen
    if seen is not None:
        cells[~seen] = UNKNOWN
    source = MapSource.of(str(file), header, pixels, seen, occupancy, levels)
    return OccupancyGrid(cells[::-1], header.resolution, header.origin, name_of(file)), source


def name_of(map_file: Path) -> str:
    """Name of the map in a file: the file's stem, or for a map.yaml its folder's name.

    Parameters
    ----------
    map_file : Path
        The YAML file, which need not be there; what cannot be printed in its name becomes U+FFFD.
    """
    return printable(map_file.resolve().parent.name if map_file.stem == "map" else map_file.stem)


def source_files(path: Path) -> list[Path]:
    """Files that a map, or the maps in a folder, are read from, as far as they are known.

    Those of the other maps beside a map file count, too: a picture is easily given their name.

    Parameters
    ----------
    path : path
        The map's file, or a folder.
    """
    if is_built_in(path):
        return []
    beside = [] if os.path.isdir(path) else sorted(path.parent.glob("*.y*ml"))
    maps = [*find_maps(path), *(file for file in beside if _names_an_image(file))]
    return [*maps, *(image for file in maps if (image := _image_of(file)))]


def find_maps(*paths: str | os.PathLike[str]) -> list[Path]:
    """List map files: the given files, and in given folders each YAML that names an image.

    The name of a built-in map is listed as it is.

    Subfolders count, too, but not what was exported there. A folder without any is listed itself,
    so that `load_map` reports it. The order is that of the arguments, in a folder by name.

    Parameters
    ----------
    *paths : path
        Files and folders; files are listed as they are, whether or not they are there.

    Raises
    ------
    LocplanError
        If an argument can be no path.
    """
    found: list[Path] = []
    for path in (file_path("a map file", path) for path in paths):
        files = sorted(path.rglob("*.y*ml")) if os.path.isdir(path) else [path]
        if os.path.isdir(path):
            exported = {file.parent for file in path.rglob("export.json")} - {path}
            files = [file for file in files if file.parent not in exported]
            files = [file for file in files if _names_an_image(file)] or [path]
        found += files
    return list(dict.fromkeys(found))


def save_map(
    grid: OccupancyGrid,
    path: str | os.PathLike[str],
    *,
    mode: Literal["trinary", "scale", "raw"] = "trinary",
    image_format: Literal["pgm", "png"] = "pgm",
    negate: bool = False,
) -> None:
    """Write a map_server YAML (.yaml), with its image beside it under the same stem.

    `load_map` reads the same grid again. Either both files are replaced or neither.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    path : path
        The YAML file, named .yaml or .yml, in a folder that is there.
    mode : str, default "trinary"
        "trinary", which every stack reads; "scale", in which unknown cells are transparent, so
        that it needs png; or "raw", in which pixels are per cent.
    image_format : str, default "pgm"
        "pgm", or "png", which is smaller.
    negate : bool, default False
        Whether white is occupied, which few maps have; it has no effect in mode "raw".

    Raises
    ------
    MapError
        If an option does not fit, or the files cannot be written.
    """
    check_grid(grid)
    file = file_path("a map file", path)
    if file.suffix not in (".yaml", ".yml"):
        raise fault_of(file, "is no name for a map", "end it in .yaml")
    if mode not in MODES:
        raise fault_of(file, "mode is unknown", "use trinary, scale or raw")
    if image_format not in ("pgm", "png"):
        raise fault_of(file, "image_format is unknown", "use pgm or png")
    if mode == "scale" and image_format == "pgm":
        raise fault_of(file, "mode scale needs transparency", "use image_format png")
    image = file.with_suffix(f".{image_format}")
    # Readers disagree on what negate does to raw values, so that it is never set there.
    negate = bool(negate) and mode != "raw"
    header = Header(image.name, grid.resolution, grid.origin, negate, 0.65, 0.196, mode)
    try:
        _replace_both(file, _text_of(header, {}), image, _draw(grid, header))
    except (OSError, ValueError) as error:
        remedy = "choose a name in an existing, writable folder"
        raise fault_of(file, f"cannot be written ({reason_of(error)})", remedy) from error


def _meaning_of_values(header: Header, top: int) -> tuple[Singles, Octets]:
    """Occupancy and level of each pixel value 0..top; above 1 there is none, in mode raw."""
    raw = header.mode == "raw"
    occupancy = np.arange(top + 1, dtype=np.float32) / np.float32(100 if raw else top)
    if not (raw or header.negate):
        occupancy = 1 - occupancy
    level = np.full(occupancy.size, UNKNOWN, np.uint8)
    level[occupancy <= np.float32(header.free_thresh)] = FREE
    level[occupancy >= np.float32(header.occupied_thresh)] = OCCUPIED
    level[101 if raw else occupancy.size :] = UNKNOWN
    return occupancy, level


def _draw(grid: OccupancyGrid, header: Header) -> Image.Image:
    from PIL import Image

    values = {"trinary": (254, 205, 0), "scale": (255, 205, 0), "raw": (0, 255, 100)}
    value_of_level = np.zeros(256, np.uint8)
    value_of_level[[FREE, UNKNOWN, OCCUPIED]] = values[header.mode]
    cells = grid.cells[::-1]
    pixels = (255 - value_of_level if header.negate else value_of_level)[cells]
    if header.mode == "scale":
        pixels = np.dstack([pixels, np.where(cells == UNKNOWN, 0, 255).astype(np.uint8)])
    return Image.fromarray(pixels)


def _replace_both(file: Path, text: str, image: Path, picture: Image.Image) -> None:
    """Replace both files or neither, and leave no other file behind."""
    with temporary_folder(file.parent) as staging:
        new = staging / NEW
        new.mkdir()
        picture.save(new / image.name, "PNG" if image.suffix == ".png" else "PPM")
        (new / file.name).write_text(text, encoding="utf-8")
        decide(staging, {each.name: digest_of(each) for each in (image, file)})


def _image_of(file: Path) -> Path | None:
    try:
        return file.parent / read_header(file).image
    except MapError:
        return None


def _names_an_image(file: Path) -> bool:
    try:
        with opened(file) as content:
            return bool(re.search(rb"(?m)^\s*image\s*:", content.read(MAX_YAML_BYTES)))
    except OSError:
        return False
