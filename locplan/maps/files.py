"""Map files: the YAML and the image that ROS's map_server reads and writes."""

from __future__ import annotations

import fnmatch
import io
import math
import os
import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from locplan._support.checks import (
    FARTHEST,
    RESOLUTIONS,
    check_file_path,
    is_file_name,
    make_printable,
    short_repr,
)
from locplan._support.files import write_text
from locplan._support.kernels.arrays import Array, Bools, Ints, Octets, Singles
from locplan._support.output import NEW, compute_file_digest, temporary_folder, write_move_journal
from locplan._support.reading import (
    SCALAR_TAGS,
    compose_yaml,
    dump_yaml,
    extract_reason,
    make_map_error,
    open_plain_file,
    read_content,
)
from locplan._support.runs import record_map
from locplan.errors import MapError
from locplan.maps import environments
from locplan.maps.environments import is_built_in, suggest_built_in_map
from locplan.maps.grid import OccupancyGrid, check_grid
from locplan.maps.occupancy import FREE, OCCUPIED, UNKNOWN

if TYPE_CHECKING:
    from PIL import Image, ImageFile


if TYPE_CHECKING:
    from PIL import Image


SUFFIXES = (".pgm", ".png", ".bmp", ".pbm")
IMAGE_SIGNATURE = re.compile(
    rb"P[1-6]\s|\x89PNG|BM.{4}\0|\xff\xd8\xff|GIF8|II\*\0|MM\0\*|RIFF.{4}WEBP", re.DOTALL
)
"""First bytes of PGM, PNG, BMP, JPEG, GIF, TIFF and WebP."""
HEADER = """image: {name}
resolution: 0.05
origin: [0.0, 0.0, 0.0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196"""


def check_is_no_image(file: Path) -> None:
    """Raise a MapError if a map's file is an image; its note is a YAML to save with the image."""
    try:
        with open_plain_file(file) as content:
            is_image = IMAGE_SIGNATURE.match(content.read(16)) is not None
    except (OSError, ValueError):
        return  # what is wrong is said where the file is read
    if not is_image:
        return
    yaml = file.with_suffix(".yaml")
    if yaml.is_file():
        raise make_map_error(file, "is an image, not a map's YAML", f"give {yaml.name} next to it")
    remedy = f"save these lines as {yaml.name} next to it, with your resolution in metres per pixel"
    error = make_map_error(file, "is an image, not a map's YAML", remedy)
    error.add_note(HEADER.format(name=_quote_for_yaml(make_printable(file.name))))
    raise error


def make_missing_image_error(file: Path, image: str) -> MapError:
    """Return the error about a YAML whose image does not exist, with the line of its name."""
    line = _find_image_line(file)
    line_text = "" if line is None else f"line {line}, "
    name = re.split(r"[/\\]", image)[-1]
    names = [name, *(file.stem + suffix for suffix in SUFFIXES)]
    near = [
        candidate for candidate in names if candidate and os.path.isfile(file.parent / candidate)
    ]
    near = near or _find_similar_images(file.parent, name)
    if near:
        remedy = (
            f"{short_repr(near[0])} lies next to the YAML: write image: {_quote_for_yaml(near[0])}"
        )
    else:
        remedy = "put the image next to the YAML, and write its name there"
    return make_map_error(
        file, f"{line_text}image: there is no such file as {short_repr(image)}", remedy
    )


def _find_similar_images(folder: Path, name: str) -> list[str]:
    """Return the folder's images whose names differ only in case or suffix."""
    try:
        names = sorted(os.listdir(folder))
    except OSError:
        return []
    images = [filename for filename in names if Path(filename).suffix.lower() in SUFFIXES]
    stem = Path(name).stem.lower()
    return [filename for filename in images if Path(filename).stem.lower() == stem]


def _find_image_line(file: Path) -> int | None:
    """Return the number of the line that names the image, or None."""
    try:
        with open_plain_file(file) as content:
            lines = content.read(2**16).splitlines()
    except OSError:
        return None
    numbers = (n for n, line in enumerate(lines, 1) if re.match(rb"\s*\W?image\W?\s*:", line))
    return next(numbers, None)


def _quote_for_yaml(name: str) -> str:
    """Return a name for a YAML file, in quotes unless it is plain."""
    return name if re.fullmatch(r"[\w][\w.-]*", name) else "'" + name.replace("'", "''") + "'"


MODES = ("trinary", "scale", "raw")
MAX_YAML_BYTES = 2**16
YamlValue = str | list[str] | None
"""An entry of a map's YAML as text or texts; None is null."""


class MapHeader(NamedTuple):
    """The checked entries of a map's YAML."""

    image: str
    resolution: float
    origin: tuple[float, float, float]
    negate: bool
    occupied_thresh: float
    free_thresh: float
    mode: str


def read_header(file: Path) -> MapHeader:
    """Read the entries of a map's YAML; a missing or a wrong one is a MapError."""
    yaml_values = {"negate": "0", "mode": "trinary"} | _read_yaml_values(file)
    image, origin, mode = yaml_values.get("image"), yaml_values.get("origin"), yaml_values["mode"]
    place = [_parse_number(coordinate) for coordinate in origin] if isinstance(origin, list) else []
    negate = {"0": False, "1": True, "false": False, "true": True}.get(
        str(yaml_values["negate"]).lower()
    )
    resolution, occupied, free = (
        _parse_number(yaml_values.get(key))
        for key in ("resolution", "occupied_thresh", "free_thresh")
    )
    finite = len(place) == 3 and all(abs(value) <= FARTHEST for value in place)
    has_file_name = isinstance(image, str) and is_file_name(image)
    (finest, coarsest), metres = RESOLUTIONS, f"{RESOLUTIONS[0]:g} to {RESOLUTIONS[1]:g} metres"
    for key, rule, example, holds in (
        ("image", "the name of a file", "map.pgm", has_file_name),
        ("resolution", metres, "0.05", finest <= resolution <= coarsest),
        ("origin", "three finite numbers x, y, yaw", "[0.0, 0.0, 0.0]", finite),
        ("negate", "0 or 1", "0", negate is not None),
        ("occupied_thresh", "a fraction in 0..1, not per cent", "0.65", 0 <= occupied <= 1),
        ("free_thresh", "a fraction up to the other, not per cent", "0.196", 0 <= free <= occupied),
        ("mode", "trinary, scale or raw", "trinary", mode in MODES),
    ):
        if not holds:
            fault = f"{key} must be {rule}, but is {_format_yaml_value(yaml_values.get(key))}"
            unit = "is it metres? " if key == "resolution" and 0 < resolution < math.inf else ""
            raise make_map_error(file, fault, f"{unit}write e.g. {key}: {example}")
    name, (x, y, yaw) = os.path.expanduser(str(image)), place
    return MapHeader(name, resolution, (x, y, yaw), bool(negate), occupied, free, str(mode))


def _read_yaml_values(file: Path) -> dict[str, YamlValue]:
    """Read the top level of a map YAML without obeying tags or expanding aliases."""
    check_is_no_image(file)
    content = read_content(file, MAX_YAML_BYTES, "give a map YAML, which is a few lines")
    remedy = "write lines such as image: map.pgm"
    root = compose_yaml(file, content, remedy)
    if root is None or root.id != "mapping":
        raise make_map_error(file, "holds no keys", remedy)
    yaml_values: dict[str, YamlValue] = {}
    for key, value in root.value:
        name = "".join(_read_node_text(key) or "")
        if name in yaml_values:
            raise make_map_error(
                file, f"{_format_yaml_value(name)} occurs twice", "keep one of the two"
            )
        yaml_values[name] = _read_node_text(value)
    return yaml_values


def _read_node_text(node: Any) -> YamlValue:
    """Return the text of a scalar, or the texts of a sequence; "..." for a mapping."""
    if node.tag == "tag:yaml.org,2002:null":
        return None
    if node.id == "scalar" and node.tag in SCALAR_TAGS:
        return str(node.value)
    if node.id != "sequence":
        return ["..."]
    return [str(child.value) if child.id == "scalar" else "..." for child in node.value]


def _parse_number(yaml_value: YamlValue) -> float:
    """Return the number in a text (also 5e-2, a string for PyYAML), or NaN."""
    try:
        return float(yaml_value) if isinstance(yaml_value, str) else math.nan
    except ValueError:
        return math.nan


def _format_yaml_value(yaml_value: YamlValue) -> str:
    """Return a value of a YAML for messages."""
    text = f"[{', '.join(yaml_value[:4])}]" if isinstance(yaml_value, list) else yaml_value
    return "missing" if text is None else short_repr(text)


DARK = 0.3
"""Occupancy from which a grey is darker than any that means unknown, but for mid-grey."""
ROWS = 256
"""Number of rows of an image that are looked up at once."""


@dataclass(frozen=True)
class MapSource:
    """The entries of a map's YAML, with counts of its pixels; made by `read_map`."""

    file: str
    """Name of the YAML file."""
    image: str
    """Name of the image, as the YAML has it."""
    mode: str
    """Mode of the YAML: "trinary", "scale" or "raw"."""
    negate: bool
    """True if white is occupied."""
    free_thresh: float
    """Maximum occupancy that is free, 0..1; map_saver writes 0.196 or 0.25."""
    occupied_thresh: float
    """Minimum occupancy that is occupied, 0..1; map_saver writes 0.65."""
    pixels: int
    """Number of pixels."""
    occupied: int
    """Number of pixels that are read as occupied."""
    saver_grey_free: int
    """Number of pixels of map_saver's grey for unknown that are read as free."""
    light_free: int
    """Number of pixels of that grey, or one much like it, that are read as free."""
    light_value: int
    """Most frequent value of those pixels; 0 without any."""
    dark_unknown: int
    """Number of pixels of dark greys that are read as unknown, mid-grey left out; 0 where most of
    them lie in areas too wide for walls."""
    over_100: int
    """Number of pixels above 100, in mode raw only, in which pixels are per cent."""
    costmap_pixels: int
    """Number of pixels that have a costmap's values for obstacles, 253 and 254, and are read as
    free; 0 unless both are over 1 % of all, as in no map."""

    @property
    def has_dark_walls(self) -> bool:
        """True if dark greys that are read as unknown are as many as the walls."""
        return self.mode == "trinary" and self.dark_unknown > self.occupied / 2

    @property
    def has_free_grey(self) -> bool:
        """True if over 1 % of the pixels are map_saver's grey for unknown and are read as free."""
        return self.saver_grey_free > 0.01 * self.pixels

    @property
    def corrected_thresholds(self) -> tuple[float, float]:
        """Thresholds, free and occupied, by which dark grey walls are occupied and map_saver's grey
        is unknown.
        """
        below_grey = self.has_free_grey or self.has_dark_walls
        free = min(self.free_thresh, 0.196 if below_grey else 1.0)
        return free, DARK if self.has_dark_walls else self.occupied_thresh

    @classmethod
    def from_pixels(
        cls,
        file: str,
        header: MapHeader,
        pixels: Array,
        opaque: Bools | None,
        occupancy: Singles,
        levels: Octets,
    ) -> MapSource:
        """Count a map's pixels, from the occupancy and level of each pixel value.

        Parameters
        ----------
        file : str
            Name of the YAML file.
        header : Header
            The entries of the YAML.
        pixels : (H, W) array of int
            The image.
        opaque : (H, W) array of bool, optional
            The pixels that are not transparent; None if none is.
        occupancy : (n,) array of float32
            Occupancy that each value 0..n - 1 stands for, 0..1, where n is 256, or 65536 for 16
            bits; above 1 there is none, in mode raw.
        levels : (n,) array of uint8
            Level that each value is read as: `FREE`, `UNKNOWN` or `OCCUPIED`.
        """
        raw = header.mode == "raw"
        counts = _count_pixel_values(pixels, opaque, levels.size)
        grey = (50 if header.negate else 205) * ((counts.size - 1) // 255)
        # Light greys mean unknown in most maps, as map_saver's of 0.196; mid-grey in drawn ones.
        light = (levels == FREE) & _is_in_range(occupancy, 0.15, 0.25) & (not raw)
        dark = (levels == UNKNOWN) & (occupancy >= DARK) & ~_is_in_range(occupancy, 0.49, 0.51)
        of_light = np.where(light, counts, 0)
        return cls(
            *(file, header.image, header.mode, header.negate),
            *(header.free_thresh, header.occupied_thresh),
            pixels=int(counts.sum()),
            occupied=int(counts[levels == OCCUPIED].sum()),
            saver_grey_free=int(counts[grey]) if levels[grey] == FREE and not raw else 0,
            light_free=int(of_light.sum()),
            light_value=int(of_light.argmax()) if of_light.any() else 0,
            dark_unknown=0
            if raw
            else _count_wall_pixels(dark, counts, pixels, opaque, header.resolution),
            over_100=int(counts[101:].sum()) if raw else 0,
            costmap_pixels=_count_costmap_pixels(counts, levels)
            if counts.size == 256 and not raw
            else 0,
        )


def _count_pixel_values(pixels: Array, opaque: Bools | None, values: int) -> Ints:
    """Count the opaque pixels of each value, (values,)."""
    counts = np.zeros(values, np.int64)
    for rows in range(0, len(pixels), ROWS):  # bincount takes 8 bytes for each pixel
        band = slice(rows, rows + ROWS)
        counts += np.bincount(
            (pixels[band] if opaque is None else pixels[band][opaque[band]]).ravel(), None, values
        )
    return counts


def _count_costmap_pixels(counts: Ints, levels: Octets) -> int:
    """Count pixels of a costmap's lethal and inscribed costs that are read as free."""
    obstacle_counts = counts[253:255]
    is_costmap = (levels[253:255] == FREE).all() and (obstacle_counts > 0.01 * counts.sum()).all()
    return int(obstacle_counts.sum()) if is_costmap else 0


def _count_wall_pixels(
    dark: Bools, counts: Ints, pixels: Array, opaque: Bools | None, resolution: float
) -> int:
    """Count the pixels of dark values; 0 if most lie in areas too wide for walls."""
    import cv2

    count = int(counts[dark].sum())
    if not count:
        return 0
    image = np.empty(pixels.shape, np.uint8)
    for rows in range(0, len(pixels), ROWS):  # an index takes 8 bytes for each pixel
        band = slice(rows, rows + ROWS)
        image[band] = dark[pixels[band]] if opaque is None else dark[pixels[band]] & opaque[band]
    # From 1 m on a grey area is the unknown around or between rooms.
    width = min(int(1.0 / resolution), max(image.shape)) + 1
    wide = cv2.morphologyEx(image, cv2.MORPH_OPEN, np.ones((width, width), np.uint8))
    return 0 if np.count_nonzero(wide) > count / 2 else count


def _is_in_range(values: Array, low: float, high: float) -> Bools:
    """True for values from low to high."""
    return np.asarray((values >= low) & (values <= high))


_GAP = rb"(?:\s|#.*\n)+"  # one way only to match each text, or blanks take exponential time
OTHER_RANGE = re.compile(rb"P[25]%b\d+%b\d+%b(?!255\s)\d" % (_GAP, _GAP, _GAP))
MAX_IMAGE_BYTES, MAX_PIXELS = 2**30, 2**28
PIXELS_PER_BYTE = 8300  # deflate's best is 1032 to 1, with eight 1-bit pixels in a byte


def read_pixels(file: Path) -> tuple[Array, Bools | None, bool]:
    """Read grey values (top row first), the mask of opaque pixels, and whether values were
    rescaled.
    """
    content = read_content(file, MAX_IMAGE_BYTES, "correct image: in the YAML")
    try:
        with warnings.catch_warnings(action="ignore"):  # Pillow's, about animation and palettes
            with _open_image(content) as image:
                # Of images that take more than a byte a pixel in memory, half as many are read.
                max_pixels = MAX_PIXELS if image.mode in ("1", "L", "P") else MAX_PIXELS // 2
                if image.width * image.height > min(max_pixels, PIXELS_PER_BYTE * len(content)):
                    raise ValueError(f"more pixels than its bytes can hold, or than {max_pixels}")
                image.verify()  # checks PNG checksums, as decoding does not; uses up the image
            with _open_image(content) as image:
                return *_decode_image(image), OTHER_RANGE.match(content) is not None
    except Exception as error:  # decoders raise almost anything on damaged files
        fault = f"is no intact PGM, PBM, PNG or BMP image ({extract_reason(error)})"
        raise make_map_error(file, fault, "export it again") from error


def _open_image(content: bytes) -> ImageFile.ImageFile:
    """Open an image and read only its header.

    Image.open would apply Pillow's limit, and the process may have changed it.
    """
    from PIL import Image

    Image.preinit()  # registers the formats
    # Pillow's PPM also reads PBM and PGM.
    for name in ("PPM", "PNG", "BMP"):
        factory, accepts = Image.OPEN[name]
        if accepts is not None and accepts(content[:16]) is True:
            return factory(io.BytesIO(content), "")
    raise ValueError("its first bytes are those of none of them")


def _decode_image(image: Image.Image) -> tuple[Array, Bools | None]:
    """Decode an image a few rows at a time, because Pillow's conversions take ten bytes a pixel."""
    tops = range(0, image.height, ROWS)
    boxes = [(0, top, image.width, min(top + ROWS, image.height)) for top in tops]
    pixels, opaque = zip(*(_decode_rows(image.crop(box)) for box in boxes), strict=True)
    return np.concatenate(pixels), None if opaque[0] is None else np.concatenate(opaque)


def _decode_rows(image: Image.Image) -> tuple[Array, Bools | None]:
    """Decode the rows of an image at once."""
    if image.mode in ("I", "I;16"):
        pixels = np.asarray(image).astype(np.uint16)
        return pixels, pixels != image.info.get("transparency", -1)
    if image.mode not in ("1", "L", "P", "LA", "PA", "RGB", "RGBA"):
        raise ValueError(f"pixels of type {image.mode}")
    if not image.has_transparency_data:
        return np.asarray(image.convert("L")), None
    colours = image.convert("RGBA")
    return np.asarray(colours.convert("L")), np.asarray(colours.getchannel("A")) == 255


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
        (`locplan.maps.environments.list_environments`), with cells of 0.05 m. A path that exists
        wins over a built-in name. The image may have 2^28 pixels.

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
    record_map(grid.name, lambda: grid.digest)
    if source and source.has_free_grey:
        count = source.saver_grey_free
        fault = (
            f"{count} pixels ({count / grid.cells.size:.0%}) of map_saver's unknown grey are free"
        )
        remedy = f"if unknown is meant, set free_thresh: 0.196 (it is {source.free_thresh})"
        warnings.warn(MapWarning(make_map_error(Path(source.file), fault, remedy)), stacklevel=2)
    return grid


def read_map(path: str | os.PathLike[str]) -> tuple[OccupancyGrid, MapSource | None]:
    """Read a map as `load_map` does, without its warning, and count its pixels.

    Parameters
    ----------
    path : path
        See `load_map`.

    Returns
    -------
    grid, source : OccupancyGrid, MapSource or None
        The map, and the entries of the YAML with counts of the pixels; None for a built-in map.

    Raises
    ------
    MapError
        As `load_map`.
    """
    file = check_file_path("a map file", path)
    if os.path.isdir(file):  # unlike Path.is_dir it is False for a name that is too long
        folder = file
        (file, *further_files) = find_maps(folder)
        if os.path.isdir(file):
            raise make_map_error(file, "is a folder without any map", "give a map's YAML")
        if further_files:
            raise make_map_error(
                folder, f"holds {1 + len(further_files)} maps", f"name one, such as {file}"
            )
    elif is_built_in(file):
        return environments.make(str(file)), None
    elif not os.path.lexists(file) and file.name == str(file) and not file.suffix:
        raise make_map_error(
            file, "is no file and no built-in map", suggest_built_in_map(str(file))
        )
    return _read_with_header(file, read_header(file))


def read_mask(path: str | os.PathLike[str]) -> OccupancyGrid:
    """Read a keepout mask of Nav2: a cell is occupied if the KeepoutFilter reads 100 there.

    Parameters
    ----------
    path : path
        The map YAML. In mode raw the thresholds do not count, since lower values are costs.

    Raises
    ------
    MapError
        As `load_map`.
    """
    file = check_file_path("a mask", path)
    header = read_header(file)
    if header.mode == "raw":
        header = header._replace(occupied_thresh=1.0)
    return _read_with_header(file, header)[0]


def with_corrected_thresholds(grid: OccupancyGrid, source: MapSource | None) -> OccupancyGrid:
    """Return the map with dark grey walls as occupied and map_saver's grey as unknown.

    Parameters
    ----------
    grid : OccupancyGrid
        The map as read from its file.
    source : MapSource or None
        How it was read; without it the map stays.
    """
    if source is None or source.corrected_thresholds == (
        source.free_thresh,
        source.occupied_thresh,
    ):
        return grid
    file, (free, occupied) = Path(source.file), source.corrected_thresholds
    header = read_header(file)._replace(free_thresh=free, occupied_thresh=occupied)
    return replace(_read_with_header(file, header)[0], name=grid.name)


def format_corrected_yaml(source: MapSource, overrides: Mapping[str, object] | None = None) -> str:
    """Return a map's YAML with `MapSource.corrected_thresholds` and the image's full path.

    Parameters
    ----------
    source : MapSource
        How the map was read.
    overrides : mapping of str to object, optional
        Entries to replace.
    """
    file, (free, occupied) = Path(source.file), source.corrected_thresholds
    header = read_header(file)._replace(free_thresh=free, occupied_thresh=occupied)
    image = str((file.parent / header.image).resolve())
    return _format_header(header._replace(image=image), overrides or {})


def _format_header(header: MapHeader, overrides: Mapping[str, object]) -> str:
    """Return a map's YAML, with some entries replaced."""
    # ROS 1 does not read true and false.
    yaml_values = header._asdict() | {"negate": int(header.negate), **overrides}
    return dump_yaml(yaml_values, default_flow_style=None, sort_keys=True, width=math.inf)


def _read_with_header(file: Path, header: MapHeader) -> tuple[OccupancyGrid, MapSource]:
    """Read a map's image under a given header, and count its pixels."""
    image = file.parent / header.image
    if not os.path.lexists(image):
        raise make_missing_image_error(file, header.image)
    pixels, opaque, rescaled = read_pixels(image)
    raw = header.mode == "raw"
    if raw and (pixels.dtype != np.uint8 or rescaled):
        raise make_map_error(
            image, "has not 8 bits a pixel, as mode raw needs", "save it as 8-bit grey"
        )
    occupancy, levels = _classify_pixel_values(header, int(np.iinfo(pixels.dtype).max))
    cells = np.empty(pixels.shape, np.uint8)
    for rows in range(0, len(cells), ROWS):  # an index takes 8 bytes for each pixel
        cells[rows : rows + ROWS] = levels[pixels[rows : rows + ROWS]]
    opaque = None if raw else opaque
    if opaque is not None:
        cells[~opaque] = UNKNOWN
    source = MapSource.from_pixels(str(file), header, pixels, opaque, occupancy, levels)
    return OccupancyGrid(
        cells[::-1], header.resolution, header.origin, map_name_from_file(file)
    ), source


def map_name_from_file(map_file: Path) -> str:
    """Return the name of the map in a file: its stem, or for a map.yaml its folder's name.

    Parameters
    ----------
    map_file : Path
        The YAML file, which need not be there; what cannot be printed in its name becomes U+FFFD.
    """
    return make_printable(
        map_file.resolve().parent.name if map_file.stem == "map" else map_file.stem
    )


def list_source_files(path: Path) -> list[Path]:
    """List the files of a map, or of all maps in a folder.

    The files of all maps in the folder of a map file count, because a picture may get the same
    name.

    Parameters
    ----------
    path : path
        The map's file, or a folder.
    """
    if is_built_in(path):
        return []
    neighbour_files = [] if os.path.isdir(path) else sorted(path.parent.glob("*.y*ml"))
    maps = [*find_maps(path), *(file for file in neighbour_files if _has_image_entry(file))]
    return [*maps, *(image for file in maps if (image := _find_image(file)))]


def find_maps(*paths: str | os.PathLike[str]) -> list[Path]:
    """List map files: the given files, and in given folders each YAML that names an image.

    The name of a built-in map is listed as it is.

    Subfolders count, except for exported files. A folder without a map is listed itself, so that
    `load_map` reports it. Files keep the order of the arguments; in a folder they are
    sorted by name.

    Parameters
    ----------
    *paths : path
        Files and folders; files are listed as they are, whether or not they are there.

    Raises
    ------
    LocplanError
        If an argument can be no path.
    """
    map_files: list[Path] = []
    for path in (check_file_path("a map file", path) for path in paths):
        files: list[Path] = []
        if os.path.isdir(path):
            files = sorted(
                Path(folder, name)
                for folder, _, names in os.walk(path)  # skips folders that vanish on the way
                if Path(folder) == path or "export.json" not in names
                for name in fnmatch.filter(names, "*.y*ml")
            )
        map_files += [file for file in files if _has_image_entry(file)] or [path]
    return list(dict.fromkeys(map_files))


def save_map(
    grid: OccupancyGrid,
    path: str | os.PathLike[str],
    *,
    mode: Literal["trinary", "scale", "raw"] = "trinary",
    image_format: Literal["pgm", "png"] = "pgm",
    negate: bool = False,
) -> None:
    """Write a map_server YAML (.yaml) and its image, with the same stem, in the same folder.

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
        "pgm" or "png"; PNG files are smaller.
    negate : bool, default False
        True if white is occupied, which is rare; it has no effect in mode "raw".

    Raises
    ------
    MapError
        If an option does not fit, or the files cannot be written.
    """
    check_grid(grid)
    file = check_file_path("a map file", path)
    if file.suffix not in (".yaml", ".yml"):
        raise make_map_error(file, "is no name for a map", "end it in .yaml")
    if mode not in MODES:
        raise make_map_error(file, "mode is unknown", "use trinary, scale or raw")
    if image_format not in ("pgm", "png"):
        raise make_map_error(file, "image_format is unknown", "use pgm or png")
    if mode == "scale" and image_format == "pgm":
        raise make_map_error(file, "mode scale needs transparency", "use image_format png")
    image = file.with_suffix(f".{image_format}")
    # Readers disagree on what negate does to raw values, so that it is never set there.
    negate = bool(negate) and mode != "raw"
    header = MapHeader(image.name, grid.resolution, grid.origin, negate, 0.65, 0.196, mode)
    try:
        _replace_map_files(file, _format_header(header, {}), image, _render_image(grid, header))
    except (OSError, ValueError) as error:
        remedy = "choose a name in an existing, writable folder"
        raise make_map_error(
            file, f"cannot be written ({extract_reason(error)})", remedy
        ) from error


def _classify_pixel_values(header: MapHeader, top: int) -> tuple[Singles, Octets]:
    """Return occupancy and level of each pixel value from 0 to `top`; in mode raw the occupancy has
    no upper limit.
    """
    raw = header.mode == "raw"
    occupancy = np.arange(top + 1, dtype=np.float32) / np.float32(100 if raw else top)
    if not (raw or header.negate):
        occupancy = 1 - occupancy
    level = np.full(occupancy.size, UNKNOWN, np.uint8)
    level[occupancy <= np.float32(header.free_thresh)] = FREE
    level[occupancy >= np.float32(header.occupied_thresh)] = OCCUPIED
    level[101 if raw else occupancy.size :] = UNKNOWN
    return occupancy, level


def _render_image(grid: OccupancyGrid, header: MapHeader) -> Image.Image:
    """Return the image of a map."""
    from PIL import Image

    values = {"trinary": (254, 205, 0), "scale": (255, 205, 0), "raw": (0, 255, 100)}
    value_of_level = np.zeros(256, np.uint8)
    value_of_level[[FREE, UNKNOWN, OCCUPIED]] = values[header.mode]
    cells = grid.cells[::-1]
    pixels = (255 - value_of_level if header.negate else value_of_level)[cells]
    if header.mode == "scale":
        pixels = np.dstack([pixels, np.where(cells == UNKNOWN, 0, 255).astype(np.uint8)])
    return Image.fromarray(pixels)


def _replace_map_files(file: Path, text: str, image: Path, picture: Image.Image) -> None:
    """Replace both files or neither, without leaving temporary files."""
    with temporary_folder(file.parent) as staging:
        new = staging / NEW
        new.mkdir()
        picture.save(new / image.name, "PNG" if image.suffix == ".png" else "PPM")
        write_text(new / file.name, text)
        write_move_journal(
            staging, {target.name: compute_file_digest(target) for target in (image, file)}
        )


def _find_image(file: Path) -> Path | None:
    """Return the image that a YAML names, if it exists."""
    try:
        return file.parent / read_header(file).image
    except MapError:
        return None


def _has_image_entry(file: Path) -> bool:
    """True if a YAML file names an image."""
    try:
        with open_plain_file(file) as content:
            return bool(re.search(rb"(?m)^\s*image\s*:", content.read(MAX_YAML_BYTES)))
    except OSError:
        return False
