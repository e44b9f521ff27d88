"""How a map file's pixels were read, and what of it can mislead."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan.maps._occupancy import FREE, UNKNOWN
from locplan.maps._yaml import Header

LIGHT = (0.15, 0.25)
"""Occupancy of light greys, which mean unknown in most maps: map_saver's is 0.196."""
DARK = 0.3
"""Occupancy from which a grey is darker than any that means unknown, but for mid-grey."""
MID_GREY = (0.49, 0.51)
"""Occupancy of mid-grey, which means unknown in maps that were drawn."""


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
    """Number of pixels of dark greys that are read as unknown, mid-grey left out."""
    over_100: int
    """Number of pixels above 100, in mode raw only, in which pixels are per cent."""

    @classmethod
    def of(
        cls,
        file: str,
        header: Header,
        counts: NDArray[np.int64],
        occupancy: NDArray[np.float32],
        levels: NDArray[np.uint8],
    ) -> MapSource:
        """The source of a map, from the number, occupancy and level of each pixel value.

        Parameters
        ----------
        file : str
            Name of the YAML file.
        header : Header
            The entries of the YAML.
        counts : (n,) array of int64
            Number of pixels of each value 0..n - 1, where n is 256, or 65536 for 16 bits.
        occupancy : (n,) array of float32
            Occupancy that each value stands for, 0..1; above 1 there is none, in mode raw.
        levels : (n,) array of uint8
            Level that each value is read as: `FREE`, `UNKNOWN` or `OCCUPIED`.
        """
        raw = header.mode == "raw"
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
            dark_unknown=0 if raw else int(counts[dark].sum()),
            over_100=int(counts[101:].sum()) if raw else 0,
        )


def _within(values: NDArray[Any], low: float, high: float) -> NDArray[np.bool_]:
    return np.asarray((values >= low) & (values <= high))
