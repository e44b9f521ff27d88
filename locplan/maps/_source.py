"""How a map file's pixels are decoded and read, and what of it can mislead."""

from __future__ import annotations

import io
import re
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from locplan._util.reading import fault_of, read_content, reason_of
from locplan.maps._occupancy import FREE, UNKNOWN
from locplan.maps._yaml import Header

if TYPE_CHECKING:
    from PIL import Image, ImageFile


LIGHT = (0.15, 0.25)
"""Occupancy of light greys, which mean unknown in most maps: map_saver's is 0.196."""
DARK = 0.3
"""Occupancy from which a grey is darker than any that means unknown, but for mid-grey."""
MID_GREY = (0.49, 0.51)
"""Occupancy of mid-grey, which means unknown in maps that were drawn."""
ROWS = 256
"""Number of rows of an image that are looked up at once."""
WIDE = 1.0
"""Width from which on a grey area is the unknown around or between rooms, and no wall [m]."""


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
    """Greatest occupancy that is free, 0..1; map_saver writes 0.196 or 0.25."""
    occupied_thresh: float
    """Least occupancy that is occupied, 0..1; map_saver writes 0.65."""
    pixels: int
    """Number of pixels."""
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

    @classmethod
    def of(
        cls,
        file: str,
        header: Header,
        pixels: NDArray[np.integer[Any]],
        seen: NDArray[np.bool_] | None,
        occupancy: NDArray[np.float32],
        levels: NDArray[np.uint8],
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
        light = (levels == FREE) & _within(occupancy, *LIGHT) & (not raw)
        dark = (levels == UNKNOWN) & (occupancy >= DARK) & ~_within(occupancy, *MID_GREY)
        of_light = np.where(light, counts, 0)
        return cls(
            file=file,
            image=header.image,
            mode=header.mode,
            negate=header.negate,
            free_thresh=header.free_thresh,
            occupied_thresh=header.occupied_thresh,
            pixels=int(counts.sum()),
            saver_grey_free=int(counts[grey]) if levels[grey] == FREE and not raw else 0,
            light_free=int(of_light.sum()),
            light_value=int(of_light.argmax()) if of_light.any() else 0,
            dark_unknown=0 if raw else _as_of_walls(dark, counts, pixels, seen, header.resolution),
            over_100=int(counts[101:].sum()) if raw else 0,
        )


def _counts(
    pixels: NDArray[np.integer[Any]], seen: NDArray[np.bool_] | None, values: int
) -> NDArray[np.int64]:
    """Number of the pixels that are seen of each value, (values,)."""
    counts = np.zeros(values, np.int64)
    for rows in range(0, len(pixels), ROWS):  # bincount takes 8 bytes for each pixel
        some = slice(rows, rows + ROWS)
        counts += np.bincount(
            (pixels[some] if seen is None else pixels[some][seen[some]]).ravel(), None, values
        )
    return counts


def _as_of_walls(
    dark: NDArray[np.bool_],
    counts: NDArray[np.int64],
    pixels: NDArray[np.integer[Any]],
    seen: NDArray[np.bool_] | None,
    resolution: float,
) -> int:
    """Number of pixels of dark values, or 0 if most lie in areas too wide for walls."""
    import cv2

    count = int(counts[dark].sum())
    if not count:
        return 0
    image = np.asarray(dark[pixels] if seen is None else dark[pixels] & seen, np.uint8)
    width = min(int(WIDE / resolution), max(image.shape)) + 1
    wide = cv2.morphologyEx(image, cv2.MORPH_OPEN, np.ones((width, width), np.uint8))
    return 0 if np.count_nonzero(wide) > count / 2 else count


def _within(values: NDArray[Any], low: float, high: float) -> NDArray[np.bool_]:
    return np.asarray((values >= low) & (values <= high))


_GAP = rb"(?:\s|#.*\n)+"  # one way only to match each text, or blanks take exponential time
OTHER_RANGE = re.compile(rb"P[25]%b\d+%b\d+%b(?!255\s)\d" % (_GAP, _GAP, _GAP))
MAX_IMAGE_BYTES, MAX_PIXELS = 2**30, 2**28
PIXELS_PER_BYTE = 8300  # deflate's best is 1032 to 1, with eight 1-bit pixels in a byte
ONE_BYTE = ("1", "L", "P")
"""Images of a byte a pixel; of others, which take several in memory, half as many are read."""


def read_pixels(file: Path) -> tuple[NDArray[Any], NDArray[np.bool_] | None, bool]:
    """Read the grey values, the mask of opaque ones if others are transparent, and whether values
    were rescaled to span all of uint8 or uint16; the top row comes first."""
    content = read_content(file, MAX_IMAGE_BYTES, "correct image: in the YAML")
    try:
        with warnings.catch_warnings(action="ignore"):  # Pillow's, about animation and palettes
            with _opened(content) as image:
                most = MAX_PIXELS if image.mode in ONE_BYTE else MAX_PIXELS // 2
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


def _decode(image: Image.Image) -> tuple[NDArray[Any], NDArray[np.bool_] | None]:
    """Decode some rows at a time: Pillow's conversions and copies take ten bytes a pixel."""
    tops = range(0, image.height, ROWS)
    boxes = [(0, top, image.width, min(top + ROWS, image.height)) for top in tops]
    pixels, opaque = zip(*(_decode_rows(image.crop(box)) for box in boxes), strict=True)
    return np.concatenate(pixels), None if opaque[0] is None else np.concatenate(opaque)


def _decode_rows(image: Image.Image) -> tuple[NDArray[Any], NDArray[np.bool_] | None]:
    if image.mode in ("I", "I;16"):
        pixels = np.asarray(image).astype(np.uint16)
        return pixels, pixels != image.info.get("transparency", -1)
    if image.mode not in ("1", "L", "P", "LA", "PA", "RGB", "RGBA"):
        raise ValueError(f"pixels of type {image.mode}")
    if not image.has_transparency_data:
        return np.asarray(image.convert("L")), None
    colours = image.convert("RGBA")
    return np.asarray(colours.convert("L")), np.asarray(colours.getchannel("A")) == 255
