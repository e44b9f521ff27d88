"""Decoding of the images of maps, in as little memory as it takes."""

from __future__ import annotations

import io
import re
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from locplan._util.plain_yaml import fault_of, read_content, reason_of
from locplan.maps._source import ROWS

if TYPE_CHECKING:
    from PIL import Image, ImageFile

_GAP = rb"(?:\s|#.*\n)+"  # one way only to match each text, or blanks take exponential time
OTHER_RANGE = re.compile(rb"P[25]%b\d+%b\d+%b(?!255\s)\d" % (_GAP, _GAP, _GAP))
IMAGE_FORMATS = ("PPM", "PNG", "BMP")  # Pillow's PPM also reads PBM and PGM
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
    for name in IMAGE_FORMATS:
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
