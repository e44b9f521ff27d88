"""Faults of the session's maps, and the maps that the filter has where they are mended."""

from __future__ import annotations

import dataclasses

import numpy as np

from locplan._kernels.arrays import Bools
from locplan.errors import LocplanError
from locplan.explorer._scene import Opening
from locplan.explorer._searches import Kept
from locplan.field import kept_solidity
from locplan.maps import MapFaults, OccupancyGrid, faults, read_map


class FaultyMaps:
    """The faults of the opened map and of its edits, each found once.

    Parameters
    ----------
    opening : Opening
        What the session began with.
    original : OccupancyGrid
        The map that was opened.
    files : Kept
        Where what was found is kept.
    """

    def __init__(self, opening: Opening, original: OccupancyGrid, files: Kept) -> None:
        self.opening, self.original, self.files = opening, original, files

    def of(self, grid: OccupancyGrid) -> MapFaults:
        """The faults of a map; of the file's pixels, too, where it is the map of the file."""

        def made() -> MapFaults:
            source, file = None, self.opening.map_file
            if file and grid.digest == self.original.digest:
                try:
                    source = read_map(file)[1]
                except LocplanError:  # the file is gone: its cells are still here
                    source = None
            folder = self.opening.cache_dir
            return faults(grid, source, check=lambda own: kept_solidity(own, folder))

        key = "faults", grid.digest
        found: MapFaults = self.files.made(key, made, lambda made: made.cells.size)
        return found

    def mended(self, grid: OccupancyGrid) -> OccupancyGrid:
        """The map for the filter, as `locplan mend` makes it of the map alone; a report's first.

        Where an edit has changed the report's map, the filter knows of it.
        """
        report = self.opening.report
        if report is not None and report.filter_map is not None:
            same = grid.cells == self.original.cells
            cells = np.where(same, report.filter_map.cells, grid.cells)
            return dataclasses.replace(grid, cells=cells)
        return self.of(grid).mended

    def marked(self, grid: OccupancyGrid, name: str) -> Bools:
        """Cells (H, W) that have a fault ("faults"), or are others on the mended map ("mended")."""
        if name == "mended":
            return np.asarray(self.mended(grid).cells != grid.cells)
        return self.of(grid).cells
