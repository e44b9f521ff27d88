"""Faults of the map, and the map that the filter has where they are mended."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from locplan._kernels.arrays import Bools
from locplan.errors import LocplanError
from locplan.field import kept_solidity
from locplan.maps import FREE, MapFaults, OccupancyGrid, faults as faults_of, hollowed, read_map

if TYPE_CHECKING:
    from locplan.explorer._asks import Ask, Work
    from locplan.explorer._session import Session


def faults(session: Session, ask: Ask, work: Work) -> dict[str, object]:
    """Answer the ask for the map's faults: what they are, whether any has a place, and a mend."""
    grid = session.grid
    found = faults_in(session, grid)
    each = [{name: getattr(one, name) for name in ("kind", "sentence", "sure")} for one in found]
    return {
        "faults": each,
        "placed": bool(marked(session, grid, "faults").any()),
        "mends": bool(marked(session, grid, "mended").any()),
        "map": grid.digest,
    }


def faults_in(session: Session, grid: OccupancyGrid) -> MapFaults:
    """The faults of a map, found once; of the file's pixels where it is the map of the file."""

    def made() -> MapFaults:
        source, file = None, session.opening.map_file
        if file and grid.digest == session.original.digest:
            try:
                source = read_map(file)[1]
            except LocplanError:  # the file is gone: its cells are still here
                source = None
        folder = session.opening.cache_dir
        return faults_of(grid, source, check=lambda own: kept_solidity(own, folder))

    key = "faults", grid.digest
    found: MapFaults = session.files.made(key, made, lambda made: made.cells.size)
    return found


def mended(session: Session, grid: OccupancyGrid) -> OccupancyGrid:
    """The map for the filter, as `locplan mend` makes it of the map alone; that of a report first.

    Where an edit has changed the report's map, the filter knows of it.
    """
    report = session.opening.report
    if report is not None and report.filter_map is not None:
        same = grid.cells == session.original.cells
        cells = np.where(same, report.filter_map.cells, grid.cells)
        return dataclasses.replace(grid, cells=cells)
    found = faults_in(session, grid)
    if any(each.kind == "specks" for each in found):
        grid = dataclasses.replace(grid, cells=np.where(found.specks, np.uint8(FREE), grid.cells))
    return hollowed(grid) if found.is_solid else grid


def marked(session: Session, grid: OccupancyGrid, name: str) -> Bools:
    """Cells (H, W) that have a fault, or those that are others on the mended map."""
    if name == "mended":
        return np.asarray(mended(session, grid).cells != grid.cells)
    found = faults_in(session, grid)
    painted = any(each.kind == "painted unknown" for each in found)
    return found.cells | (hollowed(grid).cells != grid.cells) if painted else found.cells
