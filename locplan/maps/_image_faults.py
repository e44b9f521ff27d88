"""Errors about the image of a map: given in place of the YAML, or named by a path that is wrong."""

from __future__ import annotations

import os
import re
from pathlib import Path

from locplan._util.checks import printable, shown
from locplan._util.reading import fault_of, opened
from locplan.errors import MapError

SUFFIXES = (".pgm", ".png", ".bmp", ".pbm")
IMAGE = re.compile(
    rb"P[1-6]\s|\x89PNG|BM.{4}\0|\xff\xd8\xff|GIF8|II\*\0|MM\0\*|RIFF.{4}WEBP", re.DOTALL
)
"""First bytes of PGM, PNG, BMP, JPEG, GIF, TIFF and WebP."""
HEADER = """image: {name}
resolution: 0.05
origin: [0.0, 0.0, 0.0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196"""


def check_no_image(file: Path) -> None:
    """Raise a MapError if a map's file is an image; its note is a YAML to save with the image."""
    try:
        with opened(file) as content:
            is_image = IMAGE.match(content.read(16)) is not None
    except (OSError, ValueError):
        return  # what is wrong is said where the file is read
    if not is_image:
        return
    yaml = file.with_suffix(".yaml")
    if yaml.is_file():
        raise fault_of(file, "is an image, not a map's YAML", f"give {yaml.name} next to it")
    remedy = f"save these lines as {yaml.name} next to it, with your resolution in metres per pixel"
    error = fault_of(file, "is an image, not a map's YAML", remedy)
    error.add_note(HEADER.format(name=_yaml_text(printable(file.name))))
    raise error


def missing_image(file: Path, image: str) -> MapError:
    """Return the error of a YAML whose image is not there, with the line that names it."""
    line = _line_of_image(file)
    where = "" if line is None else f"line {line}, "
    name = re.split(r"[/\\]", image)[-1]
    names = [name, *(file.stem + suffix for suffix in SUFFIXES)]
    near = [each for each in names if each and os.path.isfile(file.parent / each)]
    near = near or _alike_images(file.parent, name)
    if near:
        remedy = f"{shown(near[0])} lies next to the YAML: write image: {_yaml_text(near[0])}"
    else:
        remedy = "put the image next to the YAML, and write its name there"
    return fault_of(file, f"{where}image: there is no such file as {shown(image)}", remedy)


def _alike_images(folder: Path, name: str) -> list[str]:
    """Return the folder's images of a name in another case, or with another suffix."""
    try:
        names = sorted(os.listdir(folder))
    except OSError:
        return []
    images = [each for each in names if Path(each).suffix.lower() in SUFFIXES]
    stem = Path(name).stem.lower()
    return [each for each in images if Path(each).stem.lower() == stem]


def _line_of_image(file: Path) -> int | None:
    try:
        with opened(file) as content:
            lines = content.read(2**16).splitlines()
    except OSError:
        return None
    numbers = (n for n, line in enumerate(lines, 1) if re.match(rb"\s*\W?image\W?\s*:", line))
    return next(numbers, None)


def _yaml_text(name: str) -> str:
    """Return a name as YAML reads it: in quotes unless it is plain."""
    return name if re.fullmatch(r"[\w][\w.-]*", name) else "'" + name.replace("'", "''") + "'"
