"""How a map's file should be read: thresholds by its greys, and the resolution by ranges."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path as File

import numpy as np

from locplan.maps import OCCUPIED, MapSource, OccupancyGrid, read_map


@dataclass(frozen=True)
class Reading:
    """How a map's file should be read, and what is to be changed in it."""

    grid: OccupancyGrid
    """The map that is meant."""
    values: Mapping[str, str] = field(default_factory=dict)
    """Entries of its YAML that are to be other ones."""
    reasons: tuple[str, ...] = ()
    """What each change is, and what it does."""
    is_sure: bool = False
    """Whether something is wrong whatever drives say."""
    scale: float = 1.0
    """Factor that its lengths should have."""

    @property
    def title(self) -> str:
        """The changes, in words."""
        return " and ".join(self.reasons)

    def scaled(self, factor: float) -> Reading:
        """The same with another resolution; its grid stays in the lengths of the file."""
        x, y, yaw = self.grid.origin
        resolution = self.grid.resolution * factor
        values = {
            "resolution": f"{resolution:.4g}",
            "origin": f"[{x * factor:.4f}, {y * factor:.4f}, {yaw:g}]",
        }
        said = f"resolution {resolution:.4g}, as the ranges of recorded drives say"
        return replace(
            *(self,),
            values={**self.values, **values},
            reasons=(*self.reasons, said),
            is_sure=True,
            scale=factor,
        )

    def in_metres(self, grid: OccupancyGrid) -> OccupancyGrid:
        """A map in the lengths of the file, in true ones."""
        x, y, yaw = grid.origin
        origin = x * self.scale, y * self.scale, yaw
        return replace(grid, resolution=grid.resolution * self.scale, origin=origin)


def as_meant(grid: OccupancyGrid, source: MapSource | None, *, light: bool = True) -> Reading:
    """The map with dark greys read as walls, and map_saver's grey as unknown, where many are not.

    Parameters
    ----------
    grid : OccupancyGrid
        The map as its file says.
    source : MapSource or None
        How it was read.
    light : bool, default True
        Whether map_saver's grey is looked at.
    """
    if source is None or source.mode != "trinary":
        return Reading(grid)
    walls = np.count_nonzero(grid.cells == OCCUPIED)
    values, reasons = {}, []
    if source.dark_unknown > walls / 2:
        values = {"occupied_thresh": "0.3", "free_thresh": f"{min(source.free_thresh, 0.196):g}"}
        reasons.append("occupied_thresh 0.3, so that dark greys are walls")
    light = light and source.saver_grey_free > 0.01 * source.pixels
    if light:
        values["free_thresh"] = "0.196"
        reasons.append("free_thresh 0.196, so that map_saver's grey is unknown")
    if not values:
        return Reading(grid)
    with tempfile.TemporaryDirectory() as folder:
        file = File(folder) / "map.yaml"
        file.write_text(rewritten(source, values), "utf-8")
        meant = replace(read_map(file)[0], name=grid.name)
    return Reading(meant, values, tuple(reasons), light)


def rewritten(source: MapSource, values: Mapping[str, str]) -> str:
    """A map's YAML with other entries; the image is named in full.

    Parameters
    ----------
    source : MapSource
        How the map was read.
    values : mapping of str to str
        The entries.
    """
    file = File(source.file)
    lines = file.read_text("utf-8").splitlines()
    values = {"image": f'"{(file.parent / source.image).resolve()}"', **values}
    kept = [line for line in lines if not re.match(rf"({'|'.join(values)})\s*:", line)]
    return "\n".join([*kept, *(f"{name}: {value}" for name, value in values.items())]) + "\n"
