"""How a map file is read: the entries of its YAML, as ROS's map_server has them, and its pixels."""

from __future__ import annotations

import io
import math
import os
import re
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from locplan._kernels.arrays import Array, Bools, Ints, Octets, Singles
from locplan._util.checks import FARTHEST, RESOLUTIONS, is_file_name, shown
from locplan._util.reading import SCALAR_TAGS, compose, fault_of, read_content, reason_of
from locplan.maps._image_faults import check_no_image
from locplan.maps._occupancy import FREE, OCCUPIED, UNKNOWN

if TYPE_CHECKING:
    from PIL import Image, ImageFile


MODES = ("trinary", "scale", "raw")
MAX_YAML_BYTES = 2**16
Entry = str | list[str] | None
"""An entry of a map's YAML as text or texts; None is null."""


class Header(NamedTuple):
    """The entries of a map's YAML, as `read_header` checks them."""

    image: str
    resolution: float
    origin: tuple[float, float, float]
    negate: bool
    occupied_thresh: float
    free_thresh: float
    mode: str


def read_header(file: Path) -> Header:
    """Read the entries of a map's YAML; a missing or a wrong one is a MapError."""
    entries = {"negate": "0", "mode": "trinary"} | _read_entries(file)
    image, origin, mode = entries.get("image"), entries.get("origin"), entries["mode"]
    place = [_number(item) for item in origin] if isinstance(origin, list) else []
    negate = {"0": False, "1": True, "false": False, "true": True}.get(
        str(entries["negate"]).lower()
    )
    resolution, occupied, free = (
        _number(entries.get(key)) for key in ("resolution", "occupied_thresh", "free_thresh")
    )
    finite = len(place) == 3 and all(abs(value) <= FARTHEST for value in place)
    named = isinstance(image, str) and is_file_name(image)
    (finest, coarsest), metres = RESOLUTIONS, f"{RESOLUTIONS[0]:g} to {RESOLUTIONS[1]:g} metres"
    for key, rule, example, holds in (
        ("image", "the name of a file", "map.pgm", named),
        ("resolution", metres, "0.05", finest <= resolution <= coarsest),
        ("origin", "three finite numbers x, y, yaw", "[0.0, 0.0, 0.0]", finite),
        ("negate", "0 or 1", "0", negate is not None),
        ("occupied_thresh", "a fraction in 0..1, not per cent", "0.65", 0 <= occupied <= 1),
        ("free_thresh", "a fraction up to the other, not per cent", "0.196", 0 <= free <= occupied),
        ("mode", "trinary, scale or raw", "trinary", mode in MODES),
    ):
        if not holds:
            fault = f"{key} must be {rule}, but is {_shown(entries.get(key))}"
            unit = "is it metres? " if key == "resolution" and 0 < resolution < math.inf else ""
            raise fault_of(file, fault, f"{unit}write e.g. {key}: {example}")
    name, (x, y, yaw) = os.path.expanduser(str(image)), place
    return Header(name, resolution, (x, y, yaw), bool(negate), occupied, free, str(mode))


def _read_entries(file: Path) -> dict[str, Entry]:
    """Read the top level of a map YAML, as nodes only: no tag is obeyed, no alias expanded."""
    check_no_image(file)
    content = read_content(file, MAX_YAML_BYTES, "give a map YAML, which is a few lines")
    remedy = "write lines such as image: map.pgm"
    root = compose(file, content, remedy)
    if root is None or root.id != "mapping":
        raise fault_of(file, "holds no keys", remedy)
    entries: dict[str, Entry] = {}
    for key, value in root.value:
        name = "".join(_plain(key) or "")
        if name in entries:
            raise fault_of(file, f"{_shown(name)} occurs twice", "keep one of the two")
        entries[name] = _plain(value)
    return entries


def _plain(node: Any) -> Entry:
    """Text of a scalar, or the texts of a sequence; ... stands for anything else."""
    if node.tag == "tag:yaml.org,2002:null":
        return None
    if node.id == "scalar" and node.tag in SCALAR_TAGS:
        return str(node.value)
    if node.id != "sequence":
        return ["..."]
    return [str(item.value) if item.id == "scalar" else "..." for item in node.value]


def _number(entry: Entry) -> float:
    """Number in a text (also 5e-2, which PyYAML takes for a string), or else NaN."""
    try:
        return float(entry) if isinstance(entry, str) else math.nan
    except ValueError:
        return math.nan


def _shown(entry: Entry) -> str:
    text = f"[{', '.join(entry[:4])}]" if isinstance(entry, list) else entry
    return "missing" if text is None else shown(text)


DARK = 0.3
"""Occupancy from which a grey is darker than any that means unknown, but for mid-grey."""
ROWS = 256
"""Number of rows of an image that are looked up at once."""


@dataclass(frozen=True)
class MapSource:
    """The entries of a map's YAML, and how many pixels they make what; made by `read_map`."""

    file: str
    """Name of the YAML file."""
    image: str
    """Name of the image, as the YAML has it."""
    mode: str
    """Mode of the YAML: "trinary", "scale" or "raw"."""
    negate: bool
    """Whether white is occupied."""
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
    of_costs: int
    """Number of pixels that have a costmap's values for obstacles, 253 and 254, and are read as
    free; 0 unless both are over 1 % of all, as in no map."""

    @property
    def has_dark_walls(self) -> bool:
        """True if dark greys that are read as unknown seem to be walls, being as many as these."""
        return self.mode == "trinary" and self.dark_unknown > self.occupied / 2

    @property
    def has_free_grey(self) -> bool:
        """True if over 1 % of the pixels are map_saver's grey for unknown and are read as free."""
        return self.saver_grey_free > 0.01 * self.pixels

    @property
    def meant_thresholds(self) -> tuple[float, float]:
        """The thresholds, free and occupied, by which dark greys that seem to be walls are such,
        and map_saver's grey is unknown."""
        below_grey = self.has_free_grey or self.has_dark_walls
        free = min(self.free_thresh, 0.196 if below_grey else 1.0)
        return free, DARK if self.has_dark_walls else self.occupied_thresh

    @classmethod
    def of(
        cls,
        file: str,
        header: Header,
        pixels: Array,
        seen: Bools | None,
        occupancy: Singles,
        levels: Octets,
    ) -> MapSource:
        """The source of a map, from its pixels, and the occupancy and level of each value.

        Parameters
        ----------
        file : str
            Name of the YAML file.
        header : Header
            The entries of the YAML.
        pixels : (H, W) array of int
            The image.
        seen : (H, W) array of bool, optional
            The pixels that are not transparent; None if none is.
        occupancy : (n,) array of float32
            Occupancy that each value 0..n - 1 stands for, 0..1, where n is 256, or 65536 for 16
            bits; above 1 there is none, in mode raw.
        levels : (n,) array of uint8
            Level that each value is read as: `FREE`, `UNKNOWN` or `OCCUPIED`.
        """
        raw = header.mode == "raw"
        counts = _counts(pixels, seen, levels.size)
        grey = (50 if header.negate else 205) * ((counts.size - 1) // 255)
        # Light greys mean unknown in most maps, as map_saver's of 0.196; mid-grey in drawn ones.
        light = (levels == FREE) & _within(occupancy, 0.15, 0.25) & (not raw)
        dark = (levels == UNKNOWN) & (occupancy >= DARK) & ~_within(occupancy, 0.49, 0.51)
        of_light = np.where(light, counts, 0)
        return cls(
            *(file, header.image, header.mode, header.negate),
            *(header.free_thresh, header.occupied_thresh),
            pixels=int(counts.sum()),
            occupied=int(counts[levels == OCCUPIED].sum()),
            saver_grey_free=int(counts[grey]) if levels[grey] == FREE and not raw else 0,
            light_free=int(of_light.sum()),
            light_value=int(of_light.argmax()) if of_light.any() else 0,
            dark_unknown=0 if raw else _as_of_walls(dark, counts, pixels, seen, header.resolution),
            over_100=int(counts[101:].sum()) if raw else 0,
            of_costs=_of_costs(counts, levels) if counts.size == 256 and not raw else 0,
        )


def _counts(pixels: Array, seen: Bools | None, values: int) -> Ints:
    """Number of the pixels that are seen of each value, (values,)."""
    counts = np.zeros(values, np.int64)
    for rows in range(0, len(pixels), ROWS):  # bincount takes 8 bytes for each pixel
        some = slice(rows, rows + ROWS)
        counts += np.bincount(
            (pixels[some] if seen is None else pixels[some][seen[some]]).ravel(), None, values
        )
    return counts


def _of_costs(counts: Ints, levels: Octets) -> int:
    """Number of pixels of a costmap's lethal and inscribed costs that are read as free."""
    both = counts[253:255]
    is_costmap = (levels[253:255] == FREE).all() and (both > 0.01 * counts.sum()).all()
    return int(both.sum()) if is_costmap else 0


def _as_of_walls(
    dark: Bools, counts: Ints, pixels: Array, seen: Bools | None, resolution: float
) -> int:
    """Number of pixels of dark values, or 0 if most lie in areas too wide for walls."""
    import cv2

    count = int(counts[dark].sum())
    if not count:
        return 0
    image = np.empty(pixels.shape, np.uint8)
    for rows in range(0, len(pixels), ROWS):  # an index takes 8 bytes for each pixel
        some = slice(rows, rows + ROWS)
        image[some] = dark[pixels[some]] if seen is None else dark[pixels[some]] & seen[some]
    # From 1 m on a grey area is the unknown around or between rooms.
    width = min(int(1.0 / resolution), max(image.shape)) + 1
    wide = cv2.morphologyEx(image, cv2.MORPH_OPEN, np.ones((width, width), np.uint8))
    return 0 if np.count_nonzero(wide) > count / 2 else count


def _within(values: Array, low: float, high: float) -> Bools:
    return np.asarray((values >= low) & (values <= high))


_GAP = rb"(?:\s|#.*\n)+"  # one way only to match each text, or blanks take exponential time
OTHER_RANGE = re.compile(rb"P[25]%b\d+%b\d+%b(?!255\s)\d" % (_GAP, _GAP, _GAP))
MAX_IMAGE_BYTES, MAX_PIXELS = 2**30, 2**28
PIXELS_PER_BYTE = 8300  # deflate's best is 1032 to 1, with eight 1-bit pixels in a byte


def read_pixels(file: Path) -> tuple[Array, Bools | None, bool]:
    """Read the grey values, the mask of opaque ones if others are transparent, and whether values
    were rescaled to span all of uint8 or uint16; the top row comes first."""
    content = read_content(file, MAX_IMAGE_BYTES, "correct image: in the YAML")
    try:
        with warnings.catch_warnings(action="ignore"):  # Pillow's, about animation and palettes
            with _opened(content) as image:
                # Of images that take more than a byte a pixel in memory, half as many are read.
                most = MAX_PIXELS if image.mode in ("1", "L", "P") else MAX_PIXELS // 2
                if image.width * image.height > min(most, PIXELS_PER_BYTE * len(content)):
                    raise ValueError(f"more pixels than its bytes can hold, or than {most}")
                image.verify()  # checks PNG checksums, as decoding does not; uses up the image
            with _opened(content) as image:
                return *_decode(image), OTHER_RANGE.match(content) is not None
    except Exception as error:  # decoders raise almost anything on damaged files
        fault = f"is no intact PGM, PBM, PNG or BMP image ({reason_of(error)})"
        raise fault_of(file, fault, "export it again") from error


def _opened(content: bytes) -> ImageFile.ImageFile:
    """Open an image, of which only the header is read yet.

    Image.open would apply a limit of Pillow's own, which the process may have changed or lifted.
    """
    from PIL import Image

    Image.preinit()  # registers the formats
    # Pillow's PPM also reads PBM and PGM.
    for name in ("PPM", "PNG", "BMP"):
        factory, accepts = Image.OPEN[name]
        if accepts is not None and accepts(content[:16]) is True:
            return factory(io.BytesIO(content), "")
    raise ValueError("its first bytes are those of none of them")


def _decode(image: Image.Image) -> tuple[Array, Bools | None]:
    """Decode some rows at a time: Pillow's conversions and copies take ten bytes a pixel."""
    tops = range(0, image.height, ROWS)
    boxes = [(0, top, image.width, min(top + ROWS, image.height)) for top in tops]
    pixels, opaque = zip(*(_decode_rows(image.crop(box)) for box in boxes), strict=True)
    return np.concatenate(pixels), None if opaque[0] is None else np.concatenate(opaque)


def _decode_rows(image: Image.Image) -> tuple[Array, Bools | None]:
    if image.mode in ("I", "I;16"):
        pixels = np.asarray(image).astype(np.uint16)
        return pixels, pixels != image.info.get("transparency", -1)
    if image.mode not in ("1", "L", "P", "LA", "PA", "RGB", "RGBA"):
        raise ValueError(f"pixels of type {image.mode}")
    if not image.has_transparency_data:
        return np.asarray(image.convert("L")), None
    colours = image.convert("RGBA")
    return np.asarray(colours.convert("L")), np.asarray(colours.getchannel("A")) == 255
